"""The undisturbed walk starts where it comes back to: the pendulum integrated over a step, numerically."""

import math
from itertools import pairwise

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model import nominal_gait as nominal_gaits
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, nominal_start, step_start_dcm
from push_recovery.controllers.model.robot import RobotModel
from scipy.integrate import solve_ivp

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)


@pytest.mark.parametrize(
    ("velocity", "duration"),
    [
        ((0, 0), 0.65),
        ((0.5, 0), 0.65),
        ((1.0, 0), 0.4),
        ((-1, 0), 0.4),
        ((0, 0.2), 0.4),
        ((0, -0.2), 0.4),
        ((0.5, -0.2), 0.4),
        ((0, 0.125), 0.55),
        ((0, -0.125), 0.55),
    ],
)
def test_duration_is_the_middle_of_the_feasible_range(velocity, duration):
    assert nominal_gait(ROBOT, LIMITS, velocity).duration == pytest.approx(duration)


@pytest.mark.parametrize("velocity", [(0, 0), (0.5, 0), (-0.25, 0.0), (0.0, 0.2), (0.3, -0.1), (0.0, -0.2)])
@pytest.mark.parametrize("delay", [0.0, 0.03])
def test_gait_is_periodic_over_two_steps_and_keeps_the_speed(velocity, delay):
    this = nominal_gait(ROBOT, LIMITS, velocity, delay)
    following = nominal_gait(ROBOT, LIMITS, (velocity[0], -velocity[1]), delay)
    period = this.duration + delay
    growth = math.exp(ROBOT.omega * period)
    dcm = np.array(step_start_dcm(this, ROBOT.pelvis_width, ROBOT.omega, delay))
    offset = dcm * growth - [this.length, this.width]
    assert offset == pytest.approx(this.offset, abs=1e-12)
    nxt = np.array(step_start_dcm(following, ROBOT.pelvis_width, ROBOT.omega, delay))
    assert nxt == pytest.approx(offset * [1, -1], abs=1e-12)
    assert this.length / period == pytest.approx(velocity[0])
    assert (this.width - following.width) / (2 * period) == pytest.approx(velocity[1])


def test_a_command_beyond_the_box_saturates():
    gait = nominal_gait(ROBOT, LIMITS, (3.0, 2.0))
    assert gait.duration == LIMITS.duration_min
    assert gait.length == LIMITS.length_max
    assert LIMITS.width_min <= gait.width <= LIMITS.width_max


def test_aside_it_saturates_at_the_same_sway_to_both_sides():
    """The swing side has less room than its opposite or more; the step after has the other."""
    out, back = (nominal_gait(ROBOT, LIMITS, (0.0, sign * 2.0)) for sign in (1.0, -1.0))
    room = min(LIMITS.width_max - ROBOT.pelvis_width, ROBOT.pelvis_width - LIMITS.width_min)
    assert room > 0.0
    assert out.width - ROBOT.pelvis_width == pytest.approx(room)
    assert back.width - ROBOT.pelvis_width == pytest.approx(-room)
    assert out.duration == back.duration == LIMITS.duration_min


@pytest.mark.parametrize("velocity", [(0.0,), (math.nan, 0.0), (math.inf, 0.0)])
def test_bad_velocity(velocity):
    with pytest.raises(InvalidValueError, match="velocity"):
        nominal_gait(ROBOT, LIMITS, velocity)


def test_pelvis_outside_the_box():
    with pytest.raises(InvalidValueError, match="pelvis_width"):
        nominal_gait(RobotModel(pelvis_width=0.6), LIMITS)


@pytest.mark.parametrize("double_support", [0.0, 0.1])
@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.4, 0.1), (-0.2, -0.15)])
def test_after_a_step_the_com_is_where_the_next_one_starts(velocity, double_support):
    """x'' = omega^2 (x - z), z from the old foot to the new one in double support, then there."""
    this, following = (
        nominal_gait(ROBOT, LIMITS, (velocity[0], sign * velocity[1]), 0.0, double_support)
        for sign in (1.0, -1.0)
    )
    start, after = (
        nominal_start(gait, ROBOT.pelvis_width, ROBOT.omega, 0.0, double_support)
        for gait in (this, following)
    )
    np.testing.assert_allclose(start.swing, [-this.length, following.width])

    def motion(time, state):
        share = max(1.0 - time / double_support, 0.0) if double_support else 0.0
        return np.concatenate([state[2:], ROBOT.omega**2 * (state[:2] - share * start.swing)])

    state, ends = np.concatenate([start.com, start.com_velocity]), (0.0, double_support, this.duration)
    for begin, end in pairwise(ends):
        if end > begin:
            state = solve_ivp(motion, (begin, end), state, rtol=1e-11, atol=1e-13).y[:, -1]
    # the next frame lies at the new sole, its y mirrored
    np.testing.assert_allclose((state[:2] - [this.length, this.width]) * [1.0, -1.0], after.com, atol=1e-8)
    np.testing.assert_allclose(state[2:] * [1.0, -1.0], after.com_velocity, atol=1e-8)


@pytest.mark.parametrize(("delay", "double_support"), [(0.0, 0.0), (0.03, 0.0), (0.0, 0.1)])
@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.4, 0.1), (-0.2, -0.15)])
def test_less_its_transfer_the_dcm_is_what_drifts_to_the_end_of_the_step(velocity, delay, double_support):
    """From the old foot at p: xi_0 - p kappa(0) = (u_T + b) exp(-omega (T + delay))."""
    gait = nominal_gait(ROBOT, LIMITS, velocity, delay, double_support)
    dcm = np.array(step_start_dcm(gait, ROBOT.pelvis_width, ROBOT.omega, delay, double_support))
    old_foot = np.array([-gait.length, 2 * ROBOT.pelvis_width - gait.width])
    left = dcm - old_foot * nominal_gaits.transfer_weight(0.0, double_support, ROBOT.omega)
    np.testing.assert_allclose(
        nominal_gaits.drifting_dcm_kernel(gait.row, ROBOT.omega, delay), left, atol=1e-14
    )


def test_backward_it_saturates_too():
    gait = nominal_gait(ROBOT, LIMITS, (-3.0, 0.0))
    assert (gait.length, gait.duration) == (-0.5, 0.3)
    growth = math.exp(0.3 * math.sqrt(9.81 / 0.8))
    assert gait.offset_x == pytest.approx(-0.5 / (growth - 1.0))
