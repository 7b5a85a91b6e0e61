import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm
from push_recovery.controllers.model.robot import RobotModel

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
