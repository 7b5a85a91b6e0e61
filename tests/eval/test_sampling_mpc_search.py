"""Sampling MPC on futures that are known: when it checks, what it tries, which plan it takes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.envs.scenario.push import Kick
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.sampling_mpc import NEVER, Memory, SamplingMpcPolicy, SamplingMpcSettings
from push_recovery.eval.search import Future

FEW = SamplingMpcSettings(population=16, elites=4, steps=2)
SHAPE = (2, 7)
NOW = SimpleNamespace(time=0.43, scenario=Scenario("s", noise_seed=5))


class Told:
    """Copies of a robot whose futures are known; `tried` is what they were asked about."""

    def __init__(self, *futures: Future):
        self.futures, self.tried = list(futures), []

    def run(self, now, corrections) -> Future:
        self.tried.append(corrections.copy())
        return self.futures.pop(0)


def future(values, stands=()) -> Future:
    found = np.zeros(len(values), np.bool_)
    found[list(stands)] = True
    return Future(np.array(values, np.float64), found)


@pytest.fixture(scope="module")
def env():
    return make_env("PushRecovery/Biped-v0")


def policy_told(env, *futures: Future, settings=FEW, one: Future | None = None) -> SamplingMpcPolicy:
    policy = SamplingMpcPolicy(env, settings)
    policy._many, policy._one = Told(*futures), Told(*([] if one is None else [one]))
    return policy


def memory(plan=0.0, mean=0.0, spread=0.8, since=0, stands=False, elapsed=0.1) -> Memory:
    rows = np.full(SHAPE, plan, np.float32)
    return Memory(rows, elapsed, np.zeros(41), since, stands, np.full(SHAPE, mean), np.full(SHAPE, spread))


def test_the_best_attempt_becomes_the_plan_and_the_best_few_are_drawn_about(env):
    values = np.random.default_rng(0).permutation(16) / 100.0
    policy = policy_told(env, future(values))
    found = policy._searched(memory(plan=0.25), NOW)
    (tried,) = policy._many.tried
    assert tried.shape == (16, 2, 7)
    assert SamplingMpcSettings(population=4, elites=4).size == 28  # all may be elites
    assert (tried[0] == 0.25).all()
    assert (tried[1] == 0.0).all()
    assert not found.stands
    np.testing.assert_array_equal(found.plan, tried[np.flatnonzero(values == 0.15)[0]])
    elites = tried[np.argsort(values)[-4:]].astype(np.float64)
    np.testing.assert_allclose(found.mean, elites.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(found.spread, np.maximum(elites.std(axis=0), 0.1), rtol=1e-5)


@pytest.mark.parametrize("stands", [(5,), (5, 9)])
def test_an_attempt_that_stands_is_worth_more_than_any_other(env, stands):
    values = np.full(16, 0.5)
    values[[5, 9]] = 0.1, 0.2
    policy = policy_told(env, future(values, stands))
    found = policy._searched(memory(), NOW)
    assert found.stands
    np.testing.assert_array_equal(found.plan, policy._many.tried[0][stands[-1]])


def test_generations_go_on_until_one_stands_and_keep_the_best(env):
    first, second, third = np.linspace(0.0, 0.3, 16), np.full(16, 0.1), np.full(16, 0.2)
    settings = replace(FEW, generations=4)
    policy = policy_told(env, future(first), future(second), future(third, (7,)), settings=settings)
    found = policy._searched(memory(), NOW)
    one, two, three = policy._many.tried
    np.testing.assert_array_equal(two[0], one[15])
    np.testing.assert_array_equal(three[0], one[15])
    assert (three[1] == 0.0).all()
    np.testing.assert_array_equal(found.plan, three[7])
    policy = policy_told(env, future(first), future(second), settings=replace(FEW, generations=2))
    found = policy._searched(memory(), NOW)
    assert not found.stands
    np.testing.assert_array_equal(found.plan, one[15])


def test_a_search_goes_on_where_it_was_and_a_new_one_begins_about_the_plan(env):
    fallen, none = future([0.0]), future(np.zeros(16))
    policy = policy_told(env, none, one=fallen)
    policy._checked(memory(plan=0.5, mean=0.3, spread=1e-9), NOW)
    np.testing.assert_allclose(policy._many.tried[0][2:], 0.3, atol=1e-4)
    np.testing.assert_array_equal(policy._one.tried[0], np.full((1, *SHAPE), 0.5, np.float32))
    policy = policy_told(env, none, one=fallen)
    policy._checked(memory(plan=0.5, mean=-0.9, spread=1e-9, stands=True), NOW)
    drawn = policy._many.tried[0][2:]
    inside = drawn[np.abs(drawn) < 1.0]
    assert 0.2 < inside.mean() < 0.5  # of N(0.5, 0.8) within (-1, 1): 0.33
    assert 0.4 < inside.std() < 0.6  # 0.49


def test_a_plan_that_stands_stays(env):
    policy = policy_told(env, one=future([0.1], (0,)))
    found = policy._checked(memory(plan=0.5), NOW)
    assert found.stands
    assert policy._many.tried == []
    np.testing.assert_array_equal(found.plan, np.full(SHAPE, 0.5, np.float32))


def test_draws_hang_on_the_settings_the_scenario_and_the_time(env):
    def drawn(now=NOW, settings=FEW):
        policy = policy_told(env, future(np.zeros(16)), settings=settings)
        policy._searched(memory(), now)
        return policy._many.tried[0].tolist()

    later = SimpleNamespace(time=0.44, scenario=NOW.scenario)
    other = SimpleNamespace(time=0.43, scenario=Scenario("s", noise_seed=6))
    ways = [drawn(), drawn(later), drawn(other), drawn(settings=replace(FEW, seed=1))]
    assert drawn() == ways[0]
    assert len({str(way) for way in ways}) == 4


def test_a_robot_that_was_pushed_is_looked_at_for_two_seconds(env):
    """While it is pushed and right after it, then every 0.1 s; always where no plan is known to stand."""
    policy, periods = SamplingMpcPolicy(env, FEW), [*range(300), NEVER]
    for stands, expected in ((True, [0, 1, *range(10, 201, 10)]), (False, list(range(201)))):
        found = [since for since in periods if policy._has_to_check(memory(since=since, stands=stands))]
        assert found == expected


@pytest.mark.parametrize(("elapsed", "moves"), [(0.2, True), (0.0, False)])
def test_at_the_end_of_a_step_plan_and_search_move_on(env, elapsed, moves):
    env.reset(options={"scenario": Scenario("s")})
    policy = SamplingMpcPolicy(env, FEW)
    rows = np.arange(14.0).reshape(SHAPE) / 20.0
    before = Memory(rows.astype(np.float32), elapsed, np.zeros(41), 3, True, rows + 1, rows + 2)
    after = policy._moved_on(before, 0.0)
    for name, fill in (("plan", 0.0), ("mean", 0.0), ("spread", 0.8)):
        found, was = getattr(after, name), getattr(before, name)
        expected = np.concatenate([was[1:], np.full((1, 7), fill)]) if moves else was
        np.testing.assert_array_equal(found, expected.astype(found.dtype))
    assert after.elapsed == 0.0
    assert after.since_push == 0  # it is not at zero, where it was to be


def test_another_robot_at_another_rate(monkeypatch):
    """Unpushed the planner's actions on G1 at 50 Hz; a kick is felt at once, and then for 2 s every 0.1 s."""
    env = make_env("PushRecovery/G1-v0", control_hz=50.0)
    policy = SamplingMpcPolicy(env, replace(FEW, outlast=0.5, scale=0.5))
    assert (policy._every, policy._watch) == (5, 100)
    assert [one._periods for one in (policy._one, policy._many)] == [75, 75]
    assert [one._outlast for one in (policy._one, policy._many)] == [0.5, 0.5]
    calm = Scenario("calm", duration=1.0)
    rows = [{**rollout(env, one, calm, "").to_dict()} for one in (policy, load_policy("two-stage", env))]
    assert rows[0] == rows[1]
    kicked = replace(calm, kicks=(Kick((0.2, 0.1, 0.0), 0.3),), duration=3.0)
    seen, _ = env.reset(options={"scenario": kicked})
    state, since = None, []
    for _ in range(40):
        action, state = policy.predict(seen, state)
        seen, *_ = env.step(action)
        since.append(state.since_push)
    assert since == 16 * [NEVER] + list(range(24))
    rule = policy._rule._rule.scale / SamplingMpcPolicy(env, FEW)._rule._rule.scale
    np.testing.assert_allclose(rule, 0.5)
