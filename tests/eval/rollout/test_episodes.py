"""The episode loop: on robots that only count, on an environment written by hand, alone and side by side."""

import gymnasium as gym
import numpy as np
import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription, ResidualBase
from push_recovery.controllers.policies.mlp import Mlp, Normalisation
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import VARIANTS
from push_recovery.envs.pendulum.env import PendulumEnv
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.envs.wrappers import ActionHold, ResidualAction
from push_recovery.eval.cli.score import Evaluate
from push_recovery.eval.rollout import TABLE_VARIANTS
from push_recovery.eval.rollout import episodes as loop
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import Observer, rollout
from push_recovery.eval.rollout.load_policy import load_policy, policy_names
from push_recovery.eval.rollout.outcome import Ending
from push_recovery.eval.rollout.policy_source import policy_sources
from push_recovery.eval.rollout.workers import SLOTS, Runner
from push_recovery.eval.score.suites import get_suite

PENDULUM = "PushRecovery/Pendulum-v0"


def test_holds_within_holds_multiply_and_a_residual_within_one_is_found():
    env = make_env(PENDULUM)
    residual = ResidualAction(env, "stage-1")
    for wrapped, expected in (
        (ActionHold(ActionHold(env, 2), 3), (6, None)),
        (ActionHold(residual, 2), (2, residual)),
    ):
        rule = loop.action_rule(wrapped)
        assert rule is not None
        assert (rule.hold, rule.residual) == expected
        assert rule.env is env.unwrapped


class Counting:
    """Robots that end after as many steps as their scenario's id says; slot k observes its own count."""

    def __init__(self, n):
        self.n = n
        self.left = np.zeros(n, np.int64)
        self.calls = []

    def begin(self, k, scenario):
        self.left[k] = int(scenario.id)
        self.calls.append(("begin", k, scenario.id))

    def rest(self, k):
        self.calls.append(("rest", k))

    def observe(self, rows):
        return self.left[rows]

    def step(self, rows, actions):
        assert (actions == 10 * self.left[rows]).all()
        self.left[rows] -= 1
        return rows[self.left[rows] == 0].tolist()

    def ending(self, k):
        return Ending(k == 1, 0.1 * k, None, "low" if k == 1 else None, -1.0)


class Remembering:
    """Its state counts the steps of each robot; notes what it was handed."""

    def __init__(self):
        self.handed = []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        count = np.zeros(len(observation), np.int64) if state is None else state[0]
        assert len(count) == len(observation)
        count = np.where(episode_start, 1, count + 1)
        self.handed.append((observation.tolist(), episode_start.tolist(), count.tolist()))
        return 10 * observation, (count,)


def test_a_free_robot_begins_the_next_scenario():
    robots, policy = Counting(2), Remembering()
    found = list(loop.run_episodes(robots, policy, [Scenario(str(steps)) for steps in (2, 1, 3)], "p"))
    told = [(k, out.scenario_id, out.env_steps, out.failure_reason, out.survived) for k, out in found]
    assert told == [(1, "1", 1, "low", False), (0, "2", 2, None, True), (2, "3", 3, "low", False)]
    assert robots.calls == [
        ("begin", 0, "2"), ("begin", 1, "1"), ("begin", 1, "3"), ("rest", 0), ("rest", 1),
    ]  # fmt: skip
    assert policy.handed == [
        ([2, 1], [True, True], [1, 1]),
        ([1, 3], [False, True], [2, 1]),
        ([2], [False], [2]),  # robot 0 rests, and its row of the state is gone
        ([1], [False], [3]),
    ]


def test_more_robots_than_scenarios():
    robots = Counting(3)
    assert [n for n, _ in loop.run_episodes(robots, Remembering(), [Scenario("1")], "p")] == [0]
    assert robots.calls == [("begin", 0, "1"), ("rest", 1), ("rest", 2), ("rest", 0)]
    assert list(loop.run_episodes(Counting(2), Remembering(), [], "p")) == []


class Noting(Observer):
    """Notes each call, and how many steps the robots had left at that moment."""

    def __init__(self):
        self.notes = []

    def begin(self, robots, k, scenario):
        self.notes.append(("begin", k, scenario.id, robots.left[k]))

    def after_step(self, robots, rows):
        self.notes.append(("step", rows.tolist(), robots.left[rows].tolist()))

    def end(self, robots, k, outcome):
        self.notes.append(("end", k, outcome.scenario_id, outcome.env_steps, robots.left[k]))


def test_an_observer_sees_each_start_step_and_end_before_the_robot_begins_anew():
    noting = Noting()
    list(loop.run_episodes(Counting(2), Remembering(), [Scenario(name) for name in "213"], "p", noting))
    assert noting.notes == [
        ("begin", 0, "2", 2), ("begin", 1, "1", 1),
        ("step", [0, 1], [1, 0]), ("end", 1, "1", 1, 0), ("begin", 1, "3", 3),
        ("step", [0, 1], [0, 2]), ("end", 0, "2", 2, 0),
        ("step", [1], [1]), ("step", [1], [0]), ("end", 1, "3", 3, 0),
    ]  # fmt: skip


def test_an_episode_that_never_ends_is_named(monkeypatch):
    monkeypatch.setattr(loop, "MAX_STEPS", 4)
    assert len(list(loop.run_episodes(Counting(1), Remembering(), [Scenario("4")], "p"))) == 1
    with pytest.raises(InvalidValueError, match="'5' did not end within 4 steps"):
        list(loop.run_episodes(Counting(2), Remembering(), [Scenario("1"), Scenario("5")], "p"))


def test_a_watch_sees_the_start_and_every_step():
    env, seen = make_env("PushRecovery/Pendulum-v0"), []
    policy = load_policy("passive", env)
    scenario = Scenario("short", duration=0.05)
    watched = rollout(env, policy, scenario, "p", lambda one: seen.append((one.info["time"], one.ended)))
    np.testing.assert_allclose([time for time, _ in seen], 0.01 * np.arange(6), atol=1e-12)
    assert [ended for _, ended in seen] == [False] * 5 + [True]
    assert watched == rollout(env, policy, scenario, "p")


class Scripted(gym.Env):
    """Ends at its third step, as it is told."""

    def __init__(self, terminated, truncated, info):
        self.end, self.info, self.count = (terminated, truncated), info, 0

    def reset(self, *, seed=None, options=None):
        self.count, self.seed, self.scenario = 0, seed, options["scenario"]
        return np.zeros(1), {}

    def step(self, action):
        self.count += 1
        ended = self.end if self.count == 3 else (False, False)
        return np.zeros(1), 0.5 * self.count, *ended, self.info if self.count == 3 else {}


class Still:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return 0.0, state


@pytest.mark.parametrize(
    ("terminated", "truncated", "survived"), [(True, False, False), (False, True, True), (True, True, False)]
)
def test_a_fall_is_what_terminates(terminated, truncated, survived):
    env = Scripted(terminated, truncated, {"recovered_at": 0.02, "failure_reason": "low"})
    found = rollout(env, Still(), Scenario("a", noise_seed=7), "p")
    assert (found.survived, found.recovered) == (survived, survived)
    assert found.failure_reason == (None if survived else "low")
    assert (found.env_steps, found.total_reward, found.recovered_at) == (3, 0.5 + 1.0 + 1.5, 0.02)
    assert (env.seed, env.scenario.id) == (7, "a")


def test_time_is_what_the_environment_tells_or_its_steps_take():
    assert loop.planning_period(Scripted(False, True, {})) == 0.01
    plain, slow, told = (Scripted(False, True, info) for info in ({}, {}, {"time": 9.0}))
    slow.dt = 0.05
    for env, time in ((plain, 0.03), (slow, 0.15), (told, 9.0)):
        assert rollout(env, Still(), Scenario("a"), "p").end_time == pytest.approx(time)


class Seeded:
    """Notes what begins it."""

    def __init__(self):
        self.notes = []

    def reset(self, seed=None):
        self.notes.append(seed)

    def begin_scenario(self, scenario):
        self.notes.append(scenario.id)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.notes.append(episode_start.item())
        return 0.0, state


def test_a_policy_begins_each_episode_with_the_scenario_and_its_noise_seed():
    policy = Seeded()
    for name, seed in (("a", 7), ("b", 0)):
        rollout(Scripted(False, True, {}), policy, Scenario(name, noise_seed=seed), "p")
    assert policy.notes == [7, "a", True, False, False, 0, "b", True, False, False]


class Alone:
    """Takes all that there is, and gives the action alone."""

    def predict(self, observation, **known):
        assert list(known) == ["state", "episode_start", "deterministic"]
        assert known["state"] is None
        return 0.0


def test_a_policy_that_takes_all_may_give_the_action_alone():
    outcome = rollout(Scripted(False, True, {}), Alone(), Scenario("a"), "p")
    assert outcome == rollout(Scripted(False, True, {}), Seeded(), Scenario("a"), "p")


BIPED, RESIDUAL = "PushRecovery/Biped-v0", "PushRecovery/BipedResidual-v0"
LATE = polar_push(150.0, 2.0, 0.2, GaitEvent(2, "right", 0.5))
SCENARIOS = (
    Scenario("none", duration=0.5),
    Scenario("hard", (polar_push(1500.0, -1.0, 0.1, 0.3),)),
    Scenario("three", (polar_push(90.0, 1.0, 0.1, 0.2), LATE, polar_push(60.0, 3.0, 0.1, 1.1)), Command(0.3)),
    Scenario("right", (LATE,), Command(0.1, -0.1), "right"),
    Scenario("calm", (), Command(0.2), settle_time=2.0),
    *get_suite("standard").scenarios[:4],
)


def network_policy(env, hold=1, base=None, env_id=PENDULUM):
    """A network of random weights, alone or on a base."""
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(8, 36)).astype(np.float32), rng.normal(size=(7, 8)).astype(np.float32)
    network = Mlp(weights, (np.zeros(8, np.float32), np.zeros(7, np.float32)))
    about = PolicyDescription(env_id, env.robot, env.limits, base, hold=hold)
    return NetworkPolicy(network, Normalisation(np.zeros(36), np.ones(36)), about)


def residual_policy(env, hold, gate):
    """A residual of random weights."""
    return network_policy(env, hold, ResidualBase("two-stage", env.preset, (0.1,) * 7, gate=gate))


def outcomes(env, policy, scenarios, slots):
    rule = loop.action_rule(env)
    assert rule is not None
    episodes = loop.batch_episodes(rule.env, slots)
    assert episodes is not None
    return {out.scenario_id: out for out in loop.rollout_batch(episodes, policy, scenarios, "p", rule)}


def singles(env, policy, scenarios):
    return {s.id: rollout(env, policy, s, "p") for s in scenarios}


@pytest.mark.parametrize("name", ["two-stage", "random", "residual", "held residual"])
def test_outcomes_are_those_of_rollout_in_any_packing(name):
    env = make_env(PENDULUM)
    if "residual" in name:
        hold, gate = (3, None) if "held" in name else (1, (0.02, 0.05))
        policy = residual_policy(env.unwrapped, hold, gate)
    else:
        policy = load_policy(name, env)
    alone = singles(env, policy, SCENARIOS)
    assert {out.survived for out in alone.values()} >= {False}
    for slots, order in [(1, SCENARIOS), (3, SCENARIOS[::-1]), (20, SCENARIOS)]:
        assert outcomes(env, policy, order, slots) == alone


@pytest.mark.parametrize("kwargs", [{"preset": "double-support"}, {"control_hz": 50.0}, {"robot": True}])
def test_slots_are_those_of_the_environment(kwargs):
    if "robot" in kwargs:
        kwargs = {"robot": RobotModel(com_height=0.9)}
    env = make_env(PENDULUM, **kwargs)
    e = env.unwrapped
    policy = make_policy("two-stage", e.robot, e.limits, e.preset)  # type: ignore[attr-defined]
    assert outcomes(env, policy, SCENARIOS[:5], 3) == singles(env, policy, SCENARIOS[:5])


def test_biped_outcomes_are_those_of_rollout():
    env = make_env(BIPED)
    policy = load_policy("two-stage", env)
    short = [Scenario("short", (LATE,), Command(0.1), settle_time=0.5), *SCENARIOS[:2]]
    assert outcomes(env, policy, short, 2) == singles(env, policy, short)


@pytest.mark.parametrize(("base", "hold", "gate"), [("two-stage", 1, None), ("stage-1", 3, (0.02, 0.05))])
def test_residual_environments_run_side_by_side(base, hold, gate):
    """A network that acts alone on a wrapped environment, its action held and added to a planner's."""
    env = ActionHold(ResidualAction(make_env(PENDULUM), base, gate=gate), hold)
    policy = network_policy(env.unwrapped, hold=2)
    alone = singles(env, policy, SCENARIOS)
    assert {out.survived for out in alone.values()} == {True, False}
    steps = {out.scenario_id: out.env_steps for out in alone.values()}
    assert steps["none"] == -(-50 // hold)
    for slots, order in [(2, SCENARIOS), (20, SCENARIOS[::-1])]:
        assert outcomes(env, policy, order, slots) == alone


def test_the_registered_residual_runs_side_by_side(tmp_path):
    env = make_env(RESIDUAL, hold=2, gate=[0.001, 0.02])
    policy = network_policy(env.unwrapped, env_id=RESIDUAL)
    short = [Scenario("short", (LATE,), Command(0.1), settle_time=0.5), *SCENARIOS[:2]]
    assert outcomes(env, policy, short, 2) == singles(env, policy, short)
    path = str(policy.save(tmp_path / "policy"))
    assert Runner(RESIDUAL).chunk(path) == SLOTS


def test_outcomes_in_the_order_of_the_scenarios(tmp_path):
    env = make_env(PENDULUM)
    policy = load_policy("stage-1", env)
    assert loop.rollout_all(env, policy, SCENARIOS, "p", 3) == list(singles(env, policy, SCENARIOS).values())
    env = make_env(toy.ENV_ID)
    policy = load_policy(toy.save_policy(tmp_path / "toy.safetensors", 2.0), env)
    alone = singles(env, policy, SCENARIOS[:2])
    assert loop.rollout_all(env, policy, SCENARIOS[:2], "p", 3) == list(alone.values())


def test_scenarios_are_taken_when_a_slot_is_free():
    env = make_env(PENDULUM)
    episodes, policy, taken = loop.batch_episodes(env, 2), load_policy("passive", env), []
    assert episodes is not None

    def scenarios():
        for i, duration in enumerate((0.1, 0.32, 0.1, 0.1)):
            taken.append(i)
            yield Scenario(str(i), duration=duration)

    run = loop.rollout_batch(episodes, policy, scenarios(), "p")
    seen = [(out.scenario_id, len(taken)) for out in run]
    assert seen == [("0", 2), ("2", 3), ("3", 4), ("1", 4)]
    assert list(loop.rollout_batch(episodes, policy, [], "p")) == []


def test_actions_that_are_not_finite_are_refused():
    episodes = loop.batch_episodes(make_env(PENDULUM), 2)
    assert episodes is not None

    class Broken:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.full((len(observation), 7), np.nan), None

    with pytest.raises(InvalidValueError, match=r"actions must be finite"):
        list(loop.rollout_batch(episodes, Broken(), [Scenario("short", duration=0.1)], "p"))


def test_only_known_policies_and_wrappers_run_side_by_side(tmp_path):
    class Mine(type(make_policy("passive"))):
        pass

    assert loop.plans_batches(make_policy("random"))
    assert not loop.plans_batches(Mine())
    env = make_env(PENDULUM)
    for other in (gym.wrappers.TimeLimit(env, 10), make_env(toy.ENV_ID), ResidualAction(env, Mine())):
        assert loop.action_rule(other) is None
    assert loop.action_rule(ResidualAction(ActionHold(env, 2))) is None  # the planner acts every other period
    assert loop.action_rule(ResidualAction(ResidualAction(env))) is None

    class Shaken(ResidualAction):
        def step(self, action):
            return super().step(-action)

    assert loop.action_rule(Shaken(env)) is None
    for other in (ResidualAction(env), make_env(toy.ENV_ID)):
        assert loop.batch_episodes(other, 2) is None
    runner = Runner(toy.ENV_ID)
    policy = toy.save_policy(tmp_path / "toy.safetensors", 2.0)
    assert runner.chunk(policy) == 1
    assert list(runner.run_all(policy, SCENARIOS[:2])) == [runner.run((policy, s)) for s in SCENARIOS[:2]]
    assert Runner(PENDULUM).chunk("two-stage") == SLOTS


class FromOutside:
    """A policy of a kind that the package does not know, which says that it acts for many robots at once."""

    batchable = True

    def predict(self, observation):
        return np.float32(0.1) * np.asarray(observation)[..., :7]


def test_a_policy_kind_from_outside_is_batched_where_it_says_so_itself():
    class Heir(FromOutside):
        pass

    sources = policy_sources({"outside": FromOutside(), "heir": Heir()})
    runner = Runner(PENDULUM, sources)
    assert (runner.chunk("outside"), runner.chunk("heir")) == (SLOTS, 1)
    found = {out.scenario_id: out for out in runner.run_all("outside", SCENARIOS)}
    assert found == {scenario.id: runner.run(("outside", scenario)) for scenario in SCENARIOS}


def test_a_policy_below_that_remembers_runs_alone():
    env = make_env(PENDULUM)
    below = network_policy(env.unwrapped)
    assert loop.plans_batches(below)
    assert loop.action_rule(ResidualAction(env, below)) is None
    assert loop.action_rule(ResidualAction(env, "random")) is not None


def test_an_environment_that_acts_in_its_own_way_runs_alone():
    class Shaken(PendulumEnv):
        def step(self, action):
            return super().step(-action)

    class Named(PendulumEnv):
        pass

    assert loop.batch_episodes(Shaken(), 2) is None
    episodes = loop.batch_episodes(Named(control_hz=50.0, robot=RobotModel(com_height=0.9)), 3)
    assert episodes is not None
    assert (episodes.n, episodes.control_hz, episodes.robot.com_height) == (3, 50.0, 0.9)


def test_a_table_leaves_out_what_falls_without_a_push():
    assert set(VARIANTS) - set(TABLE_VARIANTS) == {"passive", "raibert", "herdt", "fixed-time"}
    assert Evaluate().policies == TABLE_VARIANTS
    assert "passive" in policy_names()  # for those who ask for it
