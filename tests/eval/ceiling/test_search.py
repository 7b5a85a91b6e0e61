"""Attempts and searches on pushes far from any limit: light ones, and one that nobody answers."""

from dataclasses import replace

import numpy as np
import pytest
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import HARDWARE, Command, Scenario
from push_recovery.eval.hindsight import (
    RECOVERED,
    CeilingSettings,
    Searcher,
    Sequence,
    SequencePolicy,
    generator_of,
    moment_of_push,
    run_attempts,
)
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.search import LEAST, MOST

LIGHT = Scenario(
    "light", (polar_push(150.0, 1.0, 0.1, GaitEvent(1, "right", 0.4)),), Command(0.1), settle_time=2.0
)
HOPELESS = Scenario("hopeless", (polar_push(6000.0, 1.0, 0.1, 0.31),))
SETTINGS = CeilingSettings(population=4, generations=2, elites=2)


@pytest.fixture(scope="module")
def searcher() -> Searcher:
    return Searcher(make_env("PushRecovery/Biped-v0"), SETTINGS)


@pytest.fixture(scope="module")
def walker() -> BipedEpisodes:
    return BipedEpisodes(1)


@pytest.mark.parametrize("scenario", [LIGHT, HOPELESS, HARDWARE.applied(LIGHT)])
def test_the_moment_is_the_period_in_which_the_push_begins(searcher, walker, scenario):
    snapshot, period = moment_of_push(walker, searcher.rule, scenario)
    assert snapshot.time == pytest.approx(0.01 * period)
    walker.restore(0, snapshot)
    assert walker.core.pushes.delivered[0].tolist() == [[0.0, 0.0, 0.0]]
    walker.step(np.zeros((1, 7), np.float32))
    assert snapshot.time <= walker.core.pushes.start[0, 0] < snapshot.time + 0.01


def test_there_is_no_moment_without_a_push(searcher, walker):
    assert moment_of_push(walker, searcher.rule, Scenario("calm", duration=0.5)) is None
    late = replace(LIGHT, duration=0.2)
    assert moment_of_push(walker, searcher.rule, late) is None
    row = searcher.row(late)
    assert (row["attempts"], row["corrections"], row["recovered"]) == (0, None, False)


@pytest.mark.parametrize("profile", ["exact", "hardware"])
def test_attempts_are_the_ordinary_rollouts_of_their_sequences(searcher, walker, profile):
    """Outcome of every attempt, and its worth from what the environment's info says of the margin."""
    scenario = LIGHT if profile == "exact" else HARDWARE.applied(LIGHT)
    moment = moment_of_push(walker, searcher.rule, scenario)
    corrections = np.random.default_rng(1).uniform(-1, 1, (4, 4, 7)).astype(np.float32)
    corrections[0] = 0.0
    robots = BipedEpisodes(6)
    came = run_attempts(robots, searcher.rule, moment.snapshot, [scenario] * 4, corrections)
    assert came.outcomes[0].recovered
    assert not all(outcome.recovered for outcome in came.outcomes)
    for rows, outcome, value in zip(corrections, came.outcomes, came.values, strict=True):
        worth = []

        def watch(robot, worth=worth):
            if robot.info["time"] > moment.snapshot.time + 1e-9 and robot.info["failure_reason"] is None:
                worth.append(min(max(robot.info["capture_margin"], LEAST), MOST) - LEAST)

        sequences = {scenario.id: Sequence(moment.period, rows.astype(float).tolist())}
        replay = SequencePolicy(*searcher._planner, sequences)
        whole = rollout(searcher.env, replay, scenario, "attempt", watch)
        assert whole.env_steps == outcome.env_steps + moment.period
        from_there = {"env_steps", "total_reward", "measures"}  # what counts from where an attempt begins
        same = replace(whole, **{name: getattr(outcome, name) for name in from_there})
        assert same == outcome
        assert value == pytest.approx(0.01 * sum(worth) + RECOVERED * outcome.recovered)


def test_a_push_that_the_planner_recovers_is_answered_without_corrections(searcher):
    row = searcher.row(LIGHT)
    assert row["recovered"]
    assert row["attempts"] == SETTINGS.population
    assert np.abs(row["corrections"]).max() == 0.0
    assert row["neighbours"] == 24


def test_a_search_without_an_answer_spends_its_budget_and_keeps_its_best(searcher):
    row = searcher.row(HOPELESS)
    assert not row["recovered"]
    assert (row["attempts"], row["neighbours"]) == (SETTINGS.budget, None)
    assert np.shape(row["corrections"]) == (4, 7)
    assert row == searcher.row(HOPELESS)


def test_draws_hang_on_the_scenario_and_the_seed_alone():
    first = generator_of(0, LIGHT).random(4).tolist()
    assert generator_of(0, replace(LIGHT)).random(4).tolist() == first
    for other in (generator_of(1, LIGHT), generator_of(0, replace(LIGHT, noise_seed=1))):
        assert other.random(4).tolist() != first
