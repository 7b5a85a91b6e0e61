import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.capturability import (
    capture_constants,
    capture_margin,
    max_recoverable_force,
    max_recoverable_impulse,
    n_step_offset,
    recoverable_offset,
    transfer_margin_kernel,
)
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.model.robot import RobotModel

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)
ANGLES = range(-90, 91, 15)
POINT_FOOT = [316, 327, 365, 447, 632, 693, 670, 332, 172, 122, 99, 89, 86]
ALL = [641, 664, 741, 907, 1283, 1159, 1120, 1159, 823, 582, 475, 426, 412]


@pytest.mark.parametrize(("both", "table"), [(False, POINT_FOOT), (True, ALL)])
def test_limits_of_the_papers_robot(both, table):
    forces = [
        max_recoverable_force(ROBOT, math.radians(psi), 0.1, foot=both, flywheel=both) for psi in ANGLES
    ]
    assert forces == pytest.approx(table, abs=1.01)


def test_margin_vanishes_at_the_bounds_and_is_largest_inside():
    bounds = recoverable_offset(ROBOT, LIMITS, 0.2)
    middle = 0.5 * (bounds.low + bounds.high)
    for axis in range(2):
        for edge in (bounds.low, bounds.high):
            dcm = middle.copy()
            dcm[axis] = edge[axis]
            assert capture_margin(ROBOT, LIMITS, 0.2, dcm) == pytest.approx(0.0, abs=1e-12)
    assert capture_margin(ROBOT, LIMITS, 0.2, middle) > 0.1
    assert capture_margin(ROBOT, LIMITS, 0.2, bounds.high + 0.1) == pytest.approx(-0.1)


def test_bounds_grow_as_the_earliest_touchdown_comes_nearer():
    early, late = (recoverable_offset(ROBOT, LIMITS, t).high for t in (0.0, 0.3))
    growth = math.exp(ROBOT.omega * LIMITS.duration_min)
    reserve = (
        recoverable_offset(ROBOT, LIMITS).high
        - recoverable_offset(ROBOT, LIMITS, foot=False, flywheel=False).high
    )
    assert late - reserve == pytest.approx(growth * (early - reserve))


def test_trunk_reserve_equals_dense_integration_of_the_fastest_swing():
    gain, push, top = ROBOT.cmp_per_trunk_acceleration, 18.75, ROBOT.trunk_angle_max
    for angle, rate in ((0.0, 0.0), (-0.4, 1.0), (0.3, -2.0), (0.5, 3.0)):
        speed = math.sqrt(push * (top - angle) + 0.5 * rate**2)
        dt, t, total, a, r = 1e-5, 0.0, 0.0, angle, rate
        while t < (speed - rate) / push + speed / push:
            u = push if t < (speed - rate) / push else -push
            total += gain * u * ROBOT.omega * math.exp(-ROBOT.omega * (t + dt / 2)) * dt
            a, r, t = a + r * dt + u * dt * dt / 2, r + u * dt, t + dt
        assert a == pytest.approx(top, abs=1e-3)
        with_trunk = recoverable_offset(ROBOT, LIMITS, 0.0, (angle, 0.0), (rate, 0.0)).high[0]
        without = recoverable_offset(ROBOT, LIMITS, flywheel=False).high[0]
        assert with_trunk - without == pytest.approx(total, abs=1e-4)


def test_a_trunk_too_fast_to_stop_costs_what_its_brake_and_its_stop_push_back():
    """It brakes until it meets the stop at theta_max, which takes the rest of its speed at once."""
    gain, push, top = ROBOT.cmp_per_trunk_acceleration, 18.75, ROBOT.trunk_angle_max
    for angle, rate in ((0.3, 8.0), (top - 0.05, 6.0)):
        dt, t, total, a, r = 1e-6, 0.0, 0.0, angle, rate
        while a < top:
            total -= gain * push * ROBOT.omega * math.exp(-ROBOT.omega * (t + dt / 2)) * dt
            a, r, t = a + r * dt, r - push * dt, t + dt
        total -= gain * ROBOT.omega * math.exp(-ROBOT.omega * t) * r
        with_trunk = recoverable_offset(ROBOT, LIMITS, 0.0, (angle, 0.0), (rate, 0.0)).high[0]
        without = recoverable_offset(ROBOT, LIMITS, flywheel=False).high[0]
        assert r > 1.0
        assert with_trunk - without == pytest.approx(total, abs=1e-4)
    resting = capture_margin(ROBOT, LIMITS, 0.0, (0.4, 0.1))
    assert capture_margin(ROBOT, LIMITS, 0.0, (0.4, 0.1), (1.0, 0.0), (6.0, 0.0)) < resting


def test_a_late_step_can_come_at_once_and_no_sooner():
    """Where even the narrowest step lands beyond c, the DCM must have come so far by the latest touchdown."""
    limits = replace(LIMITS, width_min=0.3, width_max=0.35, duration_min=0.6, duration_max=0.8)
    growth = math.exp(ROBOT.omega * 0.6)
    assert (growth * 0.3 - 0.35) / (growth**2 - 1.0) > 0.0
    slow = math.exp(ROBOT.omega * 0.8)
    wide = (0.35 - 0.3 / slow) / (growth - 1.0 / slow)
    low = [recoverable_offset(ROBOT, limits, t, foot=False, flywheel=False).low[1] for t in (0.0, 0.8, 1.0)]
    assert low == pytest.approx([(0.3 - wide) / slow, 0.3 - wide, 0.3 - wide])


@pytest.mark.parametrize("left", [0.0, 0.05, 0.3])
def test_a_foot_that_still_stands_moves_the_bounds_towards_it(left):
    """By other (1 - exp(-omega left)), on the side where it stands alone."""
    constants, rest = capture_constants(ROBOT, LIMITS), np.zeros(2)
    bounds, reach = recoverable_offset(ROBOT, LIMITS), 1.0 - math.exp(-ROBOT.omega * left)
    middle = 0.5 * (bounds.low + bounds.high)
    for other in ((0.1, 0.25), (-0.1, 0.25), (0.1, -0.25)):
        low = bounds.low + reach * np.minimum(other, 0.0)
        high = bounds.high + reach * np.maximum(other, 0.0)
        for axis, end in ((0, low), (0, high), (1, low), (1, high)):
            dcm = middle.copy()
            dcm[axis] = end[axis]
            found = transfer_margin_kernel(0.0, left, np.array(other), dcm, rest, rest, constants)
            assert found == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("bad", [(math.nan, 0.1), (0.0, 0.0)])
def test_bad_push(bad):
    with pytest.raises(InvalidValueError):
        max_recoverable_force(ROBOT, *bad)


@pytest.mark.parametrize(("axis", "missing"), [(0, "trunk_pitch"), (1, "trunk_roll")])
def test_the_trunk_gives_nothing_about_an_axis_that_the_waist_lacks(axis, missing):
    limits = GaitLimits.of(RobotModel(**{missing: False}))
    state = 0.1, (0.2, -0.1), (0.5, 0.7)
    found = recoverable_offset(ROBOT, limits, *state)
    whole = recoverable_offset(ROBOT, LIMITS, *state)
    rigid = recoverable_offset(ROBOT, LIMITS, *state, flywheel=False)
    for end in ("low", "high"):
        assert getattr(found, end)[axis] == getattr(rigid, end)[axis]
        assert getattr(found, end)[1 - axis] == getattr(whole, end)[1 - axis]


def test_bounds_of_few_steps_by_hand():
    point, decay = {"foot": False, "flywheel": False}, math.exp(-0.3 * ROBOT.omega)
    back = n_step_offset(ROBOT, replace(LIMITS, length_min=-0.3), 2, **point)
    reach = decay * (1.0 + decay)
    assert (back.low[0], back.high[0]) == pytest.approx((-0.3 * reach, 0.5 * reach))
    late = n_step_offset(ROBOT, LIMITS, 1, 0.5, **point)  # later than T_min nothing grows any more
    assert [*late.low, *late.high] == pytest.approx([-0.5, 0.0, 0.5, 0.4])
    stiff = n_step_offset(ROBOT, GaitLimits.of(RobotModel(trunk_roll=False)), 0)
    assert stiff.high[1] == 0.05 < 0.1 < stiff.high[0]


def test_a_gait_beyond_the_bounds_bears_no_push():
    gait = replace(nominal_gait(ROBOT, LIMITS), offset_x=2.0)
    assert max_recoverable_force(ROBOT, 0.0, gait=gait) == 0.0
    assert max_recoverable_impulse(ROBOT, 0.0, gait=gait) == 0.0


@pytest.mark.parametrize(("most", "used"), [(10.0, 10.0), (30.0, 18.75)])  # tau / j = 18.75
def test_the_trunk_gives_what_box_and_torque_both_allow(most, used):
    limits, omega = replace(LIMITS, trunk_acceleration_max=most), ROBOT.omega
    swing = math.exp(-omega * math.sqrt(ROBOT.trunk_angle_max / used))
    gives = recoverable_offset(ROBOT, limits).high - recoverable_offset(ROBOT, limits, flywheel=False).high
    assert gives == pytest.approx(ROBOT.cmp_per_trunk_acceleration * used * (1.0 - swing) ** 2)
