"""Rules of what a robot learns of itself, on numbers written by hand."""

import math

import numpy as np
import pytest
from push_recovery.controllers.estimation import self_model as rules
from push_recovery.controllers.estimation.self_model import (
    LAST,
    QUIET,
    WEIGHT,
    empty_self_model,
    end_step,
    forget,
    show_drift,
    show_push,
    weigh,
)
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.envs.biped.core import BIPED_GAIT

LEFT, RIGHT = -1.0, 1.0  # sign of the canonical y on a stance foot


def fresh(n: int = 2):
    """Robots that know nothing yet; robot 1 is the one that learns."""
    known = empty_self_model(n)
    for k in range(n):
        forget(known, k, BIPED_GAIT, 0.8)
    return known


def walk_step(known, x: float, y: float, weight: float = 0.25) -> list[float]:
    """A step whose mean drift is (x, y) is over; returns the drift that is known then."""
    known.step[1, :2], known.step[1, WEIGHT] = (weight * x, weight * y), weight
    end_step(known, 1)
    assert not known.step[1, : WEIGHT + 1].any()
    return known.drift[1].tolist()


def test_the_mean_of_two_steps_is_taken_over_by_halves():
    known = fresh()
    assert walk_step(known, 0.01, -0.03) == [0.0, 0.0]  # one step alone may be one-sided
    assert known.step[1, LAST : LAST + 2].tolist() == [0.01, -0.03]
    assert walk_step(known, 0.03, 0.01) == pytest.approx([0.5 * 0.02, 0.5 * -0.01])
    assert walk_step(known, 0.03, 0.01) == pytest.approx([0.01 + 0.5 * 0.02, -0.005 + 0.5 * 0.015])
    assert not known.drift[0].any()


def test_a_step_with_a_push_and_the_one_after_it_teach_nothing():
    known = fresh()
    walk_step(known, 0.02, 0.0)
    walk_step(known, 0.02, 0.0)
    before = known.drift[1].tolist()
    known.step[1, QUIET] = -1.0  # pushed
    assert walk_step(known, 0.09, 0.09) == before
    assert walk_step(known, 0.09, 0.09) == before  # it still recovers
    assert walk_step(known, 0.04, 0.02) == before  # the first of two
    assert walk_step(known, 0.04, 0.02) == pytest.approx([before[0] + 0.5 * (0.04 - before[0]), 0.01])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_drift_changes_slowly_and_has_a_bound(sign):
    known, drifts = fresh(), []
    for _ in range(12):
        drifts.append(walk_step(known, sign * 0.3, -sign * 0.3)[0])
    np.testing.assert_allclose(np.diff(drifts)[:4], sign * 0.02, atol=1e-15)  # half of at most 4 cm
    assert drifts[-1] == sign * 0.1
    assert known.drift[1, 1] == -sign * 0.1


def test_a_model_counts_for_half_a_second_of_weighing():
    """A tenth of a second 20 % heavier: (0.5 e^-0.2 m g + 0.1 x 1.2 m g) over (0.5 e^-0.2 + 0.1) m g."""
    known, weight = fresh(), BIPED_GAIT.mass * GRAVITY
    weigh(known, 1, BIPED_GAIT, 0.1 * 1.2 * weight, 0.0, 0.1)
    past = 0.5 * math.exp(-0.2)
    assert known.mass[1] == pytest.approx((past + 0.12) / (past + 0.1))
    assert known.mass[0] == 1.0
    weigh(known, 1, BIPED_GAIT, 1e6, 0.0, 0.1)
    assert known.mass[1] == 2.0  # no more is believed
    known = fresh()
    weigh(known, 1, BIPED_GAIT, 0.1 * 1.02 * weight, 0.0, 0.1)
    assert known.mass[1] == 1.0  # within a percent, by its 0.4 %


def test_a_climbing_robot_is_not_a_heavier_one():
    known, mass = fresh(), BIPED_GAIT.mass
    weigh(known, 1, BIPED_GAIT, mass * (0.1 * GRAVITY + 0.5), 0.5, 0.1)
    assert known.mass[1] == 1.0


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_jumps_are_those_in_the_heading_frame(stance):
    """A steady push is seen with the other sign after a touchdown, and has not jumped."""
    known, seen = fresh(), np.zeros(36)
    known.felt[1] = 0.1, 0.2, 0.05
    seen[34:36] = 0.1, stance * 0.2
    show_push(known, 1, stance, 0.01, seen)
    assert known.felt[1] == pytest.approx([0.1, 0.2, 0.04])  # less noise than was believed
    assert seen[34:36].tolist() == [0.1, stance * 0.2]  # above twice 0.04 m
    seen[34:36] = 0.1, stance * 0.3
    show_push(known, 1, stance, 0.01, seen)
    assert known.felt[1] == pytest.approx([0.1, 0.3, 0.05])


@pytest.mark.parametrize(
    ("noise", "size", "shown"), [(0.05, 0.06, False), (0.05, 0.11, True), (0.02, 0.01, True)]
)
def test_a_push_is_shown_above_twice_its_noise_or_where_there_is_hardly_any(noise, size, shown):
    known, seen = fresh(), np.zeros(36)
    known.felt[1] = 0.6 * size, 0.8 * size, noise
    seen[34:36] = 0.6 * size, 0.8 * size
    show_push(known, 1, RIGHT, 0.0, seen)  # no time has passed: nothing is learned
    assert known.felt[1].tolist() == [0.6 * size, 0.8 * size, noise]
    assert bool(seen[34:36].any()) == shown


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_what_is_planned_on_is_moved_by_a_drift_that_counts(stance):
    known, seen = fresh(), np.zeros(36)
    known.drift[1] = 0.9 * rules.DRIFT_KNOWN, 0.0
    show_drift(known, 1, stance, seen)
    assert not seen.any()
    known.drift[1] = 0.03, 0.02
    show_drift(known, 1, stance, seen)
    expected = np.zeros(36)
    expected[[1, 3]], expected[[2, 4]] = 0.03, stance * 0.02
    expected[34], expected[35] = -0.03, -stance * 0.02
    np.testing.assert_array_equal(seen, expected)
