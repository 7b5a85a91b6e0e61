"""When a row of a sequence acts, on observations written by hand."""

import pickle

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.observation import ELAPSED
from push_recovery.controllers.policies.residual import default_residual_scale
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.hindsight import Sequence, SequencePolicy
from push_recovery.eval.search import SequenceRule, begun

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
    ("period", "rows"),
    [(0, "0011122"), (1, "-011122"), (2, "--00011"), (5, "-----00"), (9, "-------")],
)
def test_each_row_lasts_a_step_from_its_period_on(seen, period, rows):
    policy = SequencePolicy(*PLANNER, 1.0, {"s": Sequence(period, ROWS.tolist())})
    policy.begin_scenario(Scenario("s"))
    expected = [ROWS[int(one)] if one in "01" else np.zeros(7) for one in rows]
    np.testing.assert_array_equal(replayed(policy, seen), corrected(seen, expected))


def test_without_a_sequence_the_planner_acts_bit_for_bit(seen):
    policy = SequencePolicy(*PLANNER, 1.0, {"s": Sequence(0, ROWS.tolist())})
    policy.begin_scenario(Scenario("other"))
    np.testing.assert_array_equal(replayed(policy, seen), POLICY.predict(seen)[0])


def test_the_scale_multiplies_the_correction_and_the_box_holds_it(seen):
    policy = SequencePolicy(*PLANNER, 3.0, {"s": Sequence(0, ROWS.tolist())})
    policy.begin_scenario(Scenario("s"))
    actions = replayed(policy, seen[:1])
    np.testing.assert_array_equal(actions, corrected(seen[:1], ROWS[:1], 3.0))
    assert np.abs(actions).max() <= 1.0


def test_a_policy_starts_anew_with_an_episode_and_pickles(seen):
    policy = SequencePolicy(*PLANNER, 1.0, {"s": Sequence(0, ROWS.tolist())})
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


@pytest.mark.parametrize(
    "rows",
    [[[0.0] * 6], [[1.5] + [0.0] * 6], [[NAN] * 7], [0.0] * 7, [[0.0] * 7, [0.0]], [["a"] * 7], 10**400],
)
def test_impossible_sequences_are_refused(rows):
    with pytest.raises(InvalidValueError, match=r"rows of 7 numbers in \[-1, 1\]"):
        Sequence(0, rows)


@pytest.mark.parametrize("period", [-1, 1.5, "3", 10**12])
def test_an_impossible_period_is_refused(period):
    with pytest.raises(InvalidValueError, match="the period of a sequence must be an integer"):
        Sequence(period, ROWS.tolist())
