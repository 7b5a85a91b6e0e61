"""Sequences on observations written by hand; attempts and searches on pushes far from any limit."""

import pickle
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.observation import ELAPSED
from push_recovery.controllers.policies.residual import default_residual_scale
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import HARDWARE, Command, Scenario
from push_recovery.eval import hindsight
from push_recovery.eval.hindsight import Sequence
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.search import BEST_MARGIN, WORST_MARGIN, CrossEntropy, SequenceRule, begun

PUSH = polar_push(500.0, np.radians(170.0), 0.1, GaitEvent(4, "left", 0.3))
SCENARIO = Scenario("s", (PUSH, Push((0.0, 100.0, -50.0), 0.2, 3.0, "trunk")), Command(0.2), noise_seed=3)


def test_neighbours_are_a_grid_about_the_push_without_itself():
    found = hindsight.neighbours(SCENARIO)
    assert len(found) == hindsight.NEIGHBOURS == 24
    assert len({one.id for one in found}) == 24
    forces = [np.hypot(*one.pushes[0].force[:2]) / 500.0 for one in found]
    turns = [np.degrees(one.pushes[0].direction) for one in found]
    turns = [turn % 360.0 - 170.0 for turn in turns]
    grid = {(round(force, 9), round(turn, 9)) for force, turn in zip(forces, turns, strict=True)}
    whole = set(product((0.98, 0.99, 1.0, 1.01, 1.02), (-2, -1, 0, 1, 2)))
    assert grid == whole - {(1.0, 0)}
    for one in found:  # all pushes change alike, and nothing else does
        first, second = one.pushes
        ratio = np.hypot(*first.force[:2]) / 500.0
        assert second.force[2] == pytest.approx(-50.0 * ratio)
        assert np.hypot(*second.force[:2]) == pytest.approx(100.0 * ratio)
        turn = (first.direction - PUSH.direction + np.pi) % (2 * np.pi) - np.pi
        assert second.direction == pytest.approx(np.pi / 2 + turn)
        assert (second.duration, second.start, second.body) == (0.2, 3.0, "trunk")
        assert (one.command, one.noise_seed) == (SCENARIO.command, SCENARIO.noise_seed)


PLANNER = "two-stage", BIPED, BIPED_LIMITS, "biped"
POLICY = make_policy(*PLANNER)
ELAPSES = (0.30, 0.31, 0.01, 0.02, 0.03, 0.0, 0.01)  # steps end before the third and the sixth look
ROWS = np.zeros((2, 7), np.float32)
ROWS[0, 0], ROWS[1, 2] = 0.5, -0.25


@pytest.fixture(scope="module")
def seen() -> np.ndarray:
    """Observations (7, 36) of one robot, at the times of ELAPSES."""
    episodes = BipedEpisodes(1)
    episodes.begin(0, Scenario("s"))
    rows = np.repeat(episodes.core.observation, len(ELAPSES), axis=0)
    rows[:, ELAPSED] = ELAPSES
    return rows


def replayed(policy, seen) -> np.ndarray:
    state, out = None, []
    for row in seen:
        action, state = policy.predict(row, state)
        out.append(action)
    return np.array(out)


def corrected(seen, rows, scale: float = 1.0) -> np.ndarray:
    base = POLICY.predict(seen)[0]
    shift = default_residual_scale(BIPED_LIMITS, scale) * np.array(rows, np.float32)
    return np.where(shift == 0.0, base, np.clip(base + shift, -1, 1))


@pytest.mark.parametrize(
    ("period", "rows"), [(0, "0011122"), (1, "-011122"), (2, "--00011"), (5, "-----00"), (9, "-------")]
)
def test_each_row_lasts_a_step_from_its_period_on(seen, period, rows):
    policy = hindsight.SequencePolicy(
        SequenceRule(*PLANNER, 1.0), {"s": hindsight.Sequence(period, ROWS.tolist())}
    )
    policy.begin_scenario(Scenario("s"))
    expected = [ROWS[int(one)] if one in "01" else np.zeros(7) for one in rows]
    np.testing.assert_array_equal(replayed(policy, seen), corrected(seen, expected))


def test_the_scale_multiplies_the_correction_and_the_box_holds_it(seen):
    policy = hindsight.SequencePolicy(
        SequenceRule(*PLANNER, 3.0), {"s": hindsight.Sequence(0, ROWS.tolist())}
    )
    policy.begin_scenario(Scenario("s"))
    actions = replayed(policy, seen[:1])
    np.testing.assert_array_equal(actions, corrected(seen[:1], ROWS[:1], 3.0))
    assert np.abs(actions).max() <= 1.0
    policy.begin_scenario(Scenario("other"))  # without a sequence the planner acts, bit for bit
    np.testing.assert_array_equal(replayed(policy, seen), POLICY.predict(seen)[0])


def test_a_policy_starts_anew_with_an_episode_and_pickles(seen):
    policy = hindsight.SequencePolicy(
        SequenceRule(*PLANNER, 1.0), {"s": hindsight.Sequence(0, ROWS.tolist())}
    )
    copied = pickle.loads(pickle.dumps(policy))  # noqa: S301
    for one in (policy, copied):
        one.begin_scenario(Scenario("s"))
        _, state = one.predict(seen[1])
        action, _ = one.predict(seen[2], state, episode_start=np.array([True]))
        np.testing.assert_array_equal(action, corrected(seen[2:3], ROWS[:1])[0])


def test_robots_of_a_batch_are_in_their_own_steps(seen):
    rule = SequenceRule(*PLANNER, 1.0)
    corrections = np.stack([ROWS, -ROWS])
    progress = begun(corrections)
    _, progress = rule.act(np.stack([seen[1], seen[1]]), progress)
    actions, progress = rule.act(np.stack([seen[2], seen[1]]), progress)
    np.testing.assert_array_equal(actions[0], corrected(seen[2:3], ROWS[1:])[0])
    np.testing.assert_array_equal(actions[1], corrected(seen[1:2], -ROWS[:1])[0])
    assert progress.step.tolist() == [1, 0]


NAN = float("nan")
WRONG = [[0.0] * 6], [[1.5] + [0.0] * 6], [[NAN] * 7], [0.0] * 7, [[0.0] * 7, [0.0]], [["a"] * 7], 10**400


@pytest.mark.parametrize(
    ("period", "rows", "words"),
    [(0, rows, r"rows of 7 numbers in \[-1, 1\]") for rows in WRONG]
    + [(period, ROWS.tolist(), "the period of .* must be an integer") for period in (-1, 1.5, "3", 10**12)],
)
def test_impossible_sequences_are_refused(period, rows, words):
    with pytest.raises(InvalidValueError, match=words):
        Sequence(period, rows)


LIGHT = Scenario(
    "light", (polar_push(150.0, 1.0, 0.1, GaitEvent(1, "right", 0.4)),), Command(0.1), settle_time=2.0
)
HOPELESS = Scenario("hopeless", (polar_push(6000.0, 1.0, 0.1, 0.31),))
SETTINGS = hindsight.CeilingSettings(population=4, generations=2, elites=2)


@pytest.fixture(scope="module")
def searcher() -> hindsight.Searcher:
    return hindsight.Searcher(make_env("PushRecovery/Biped-v0"), SETTINGS)


@pytest.fixture(scope="module")
def walker() -> BipedEpisodes:
    return BipedEpisodes(1)


@pytest.mark.parametrize("scenario", [LIGHT, HOPELESS, HARDWARE.applied(LIGHT)])
def test_the_moment_is_the_period_in_which_the_push_begins(searcher, walker, scenario):
    snapshot, period = hindsight.moment_of_push(walker, searcher.rule, scenario)
    assert snapshot.time == pytest.approx(0.01 * period)
    walker.restore(0, snapshot)
    assert walker.core.pushes.delivered[0].tolist() == [[0.0, 0.0, 0.0]]
    walker.step(np.zeros((1, 7), np.float32))
    assert snapshot.time <= walker.core.pushes.start[0, 0] < snapshot.time + 0.01


def test_there_is_no_moment_without_a_push(searcher, walker):
    late = replace(LIGHT, duration=0.2)
    for scenario in (Scenario("calm", duration=0.5), late):
        assert hindsight.moment_of_push(walker, searcher.rule, scenario) is None
    row = searcher.row(late)
    assert (row["attempts"], row["corrections"], row["recovered"]) == (0, None, False)


@pytest.mark.parametrize("profile", ["exact", "hardware"])
def test_attempts_are_the_ordinary_rollouts_of_their_sequences(searcher, walker, profile):
    """Outcome of every attempt, and its worth from what the environment's info says of the margin."""
    scenario = LIGHT if profile == "exact" else HARDWARE.applied(LIGHT)
    snapshot, period = hindsight.moment_of_push(walker, searcher.rule, scenario)
    corrections = np.random.default_rng(1).uniform(-1, 1, (4, 4, 7)).astype(np.float32)
    corrections[0] = 0.0
    robots = BipedEpisodes(6)
    came = hindsight.run_attempts(robots, searcher.rule, snapshot, [scenario] * 4, corrections)
    assert came.outcomes[0].recovered
    assert not all(outcome.recovered for outcome in came.outcomes)
    for rows, outcome, value in zip(corrections, came.outcomes, came.values, strict=True):
        worth = []

        def watch(robot, worth=worth):
            if robot.info["time"] > snapshot.time + 1e-9 and robot.info["failure_reason"] is None:
                margin = robot.info["capture_margin"]
                worth.append(min(max(margin, WORST_MARGIN), BEST_MARGIN) - WORST_MARGIN)

        sequences = {scenario.id: hindsight.Sequence(period, rows.astype(float).tolist())}
        replay = hindsight.SequencePolicy(searcher.rule, sequences)
        whole = rollout(searcher.env, replay, scenario, "attempt", watch)
        assert whole.env_steps == outcome.env_steps + period
        from_there = {"env_steps", "total_reward", "measures"}  # what counts from where an attempt begins
        assert replace(whole, **{name: getattr(outcome, name) for name in from_there}) == outcome
        assert value == pytest.approx(0.01 * sum(worth) + hindsight.RECOVERED * outcome.recovered)


def test_a_push_that_the_planner_recovers_is_answered_without_corrections(searcher):
    row = searcher.row(LIGHT)
    assert (row["recovered"], row["attempts"], row["neighbours"]) == (True, SETTINGS.population, 24)
    assert np.abs(row["corrections"]).max() == 0.0


def test_a_search_without_an_answer_spends_its_budget_and_keeps_its_best(searcher):
    row = searcher.row(HOPELESS)
    assert (row["recovered"], row["attempts"], row["neighbours"]) == (False, SETTINGS.budget, None)
    assert np.shape(row["corrections"]) == (4, 7)
    assert row == searcher.row(HOPELESS)


class ToldAttempts:
    """Attempts whose values and recoveries are known, generation by generation; notes what was tried."""

    def __init__(self, *generations):
        self.generations, self.tried = list(generations), []

    def __call__(self, robots, rule, snapshot, scenarios, corrections) -> hindsight.Attempts:
        self.tried.append(corrections.copy())
        values, recovered = self.generations.pop(0)
        outcomes = [SimpleNamespace(recovered=k in recovered) for k in range(len(scenarios))]
        return hindsight.Attempts(outcomes, np.array(values))  # type: ignore[arg-type]


def test_the_first_generation_that_recovers_gives_the_answer_with_the_least_corrections(
    searcher, monkeypatch
):
    told = ToldAttempts(([0.1, 0.4, 0.2, 0.3], ()), ([1.0, 9.0, 2.0, 3.0], (1, 2, 3)))
    monkeypatch.setattr(hindsight, "run_attempts", told)
    best, recovered, attempts = searcher.search(None, LIGHT)
    first, second = told.tried
    assert not first[0].any()
    assert first[1:].any(axis=(1, 2)).all()
    assert second.any(axis=(1, 2)).all()
    effort = np.square(second.astype(float)).sum(axis=(1, 2))
    np.testing.assert_array_equal(best, second[1:][effort[1:].argmin()])
    assert (recovered, attempts) == (True, 8)
    method = CrossEntropy(hindsight.generator_of(0, LIGHT), np.zeros(28), np.full(28, 0.8), SETTINGS)
    np.testing.assert_array_equal(first.reshape(4, 28)[1:], method.ask()[1:])
    method.tell(first.reshape(4, 28), np.array([0.1, 0.4, 0.2, 0.3]))
    np.testing.assert_array_equal(second.reshape(4, 28), method.ask())


@pytest.mark.parametrize(("second", "generation", "best"), [([0.0, 0.5, 0.1, 0.2], 1, 1), ([0.1] * 4, 0, 2)])
def test_without_a_recovery_the_best_attempt_of_all_generations_is_kept(
    searcher, monkeypatch, second, generation, best
):
    told = ToldAttempts(([0.1, 0.2, 0.3, 0.0], ()), (second, ()))
    monkeypatch.setattr(hindsight, "run_attempts", told)
    found, recovered, attempts = searcher.search(None, LIGHT)
    np.testing.assert_array_equal(found, told.tried[generation][best])
    assert (recovered, attempts) == (False, SETTINGS.budget)


def test_draws_hang_on_the_scenario_and_the_seed_alone():
    first = hindsight.generator_of(0, LIGHT).random(4).tolist()
    assert hindsight.generator_of(0, replace(LIGHT)).random(4).tolist() == first
    for other in (hindsight.generator_of(1, LIGHT), hindsight.generator_of(0, replace(LIGHT, noise_seed=1))):
        assert other.random(4).tolist() != first


def test_neighbours_count_where_the_same_corrections_recover_them(searcher, monkeypatch):
    attempts = ToldAttempts(([0.0] * 24, (0, 3, 23)))
    monkeypatch.setattr(hindsight, "run_attempts", attempts)
    assert searcher.neighbours_recovered(None, LIGHT, ROWS) == 3
    np.testing.assert_array_equal(attempts.tried[0], np.stack([ROWS] * 24))
