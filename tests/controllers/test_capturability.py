import math

import numpy as np
import pytest
from push_recovery.controllers.capturability import (
    capture_margin,
    max_recoverable_force,
    recoverable_offset,
    step_start_dcm,
)
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.limits import GaitLimits
from push_recovery.controllers.nominal_gait import nominal_gait
from push_recovery.controllers.robot import RobotModel
from scipy.optimize import linprog

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


def trajectory_limit(axis, sign, foot, flywheel, dt=0.01, steps=8):
    """Largest push [N] along one axis, by a linear program over step places, CoP and trunk trajectories.

    The last step only has to keep the DCM within 1 m of the foot: after `steps` steps that costs 1e-3 N.
    """
    omega, growth = ROBOT.omega, math.exp(ROBOT.omega * dt)
    per_step, gain = round(LIMITS.duration_min / dt), ROBOT.cmp_per_trunk_acceleration
    nodes = per_step * steps
    start = step_start_dcm(nominal_gait(ROBOT, LIMITS), ROBOT.pelvis_width, omega)[axis]
    half = (LIMITS.cop_x_max, LIMITS.cop_y_max)[axis] * foot
    push = LIMITS.trunk_acceleration_max * flywheel
    # variables: shift of the first DCM, CoP (nodes), trunk acceleration (nodes), footholds (steps)
    size = 1 + 2 * nodes + steps
    acceleration = 1 + nodes
    footholds = 1 + 2 * nodes
    end = np.zeros(size)  # DCM after the last step, times growth^-nodes
    end[0] = 1.0
    weight = (growth - 1.0) * growth ** -(np.arange(nodes) + 1.0)
    end[1 : 1 + nodes] = -weight
    end[acceleration : acceleration + nodes] = -weight * gain
    for j in range(steps):  # the foot of step j moves all later CoPs and, at last, the reference
        end[footholds + j] = -weight[(j + 1) * per_step :].sum() - growth**-nodes
    rows, bounds_up = [end, -end], [growth**-nodes - start, growth**-nodes + start]
    angle = np.zeros((nodes, size))
    for k in range(nodes):
        lag = np.arange(k, -1, -1) + 0.5
        angle[k, acceleration : acceleration + k + 1] = lag * dt * dt
    rows += [*angle, *-angle]
    bounds_up += [ROBOT.trunk_angle_max] * (2 * nodes)
    box = [(None, None), *[(-half, half)] * nodes, *[(-push, push)] * nodes]
    for j in range(steps):
        side = 1 if j % 2 == 0 else -1
        wide = sorted((side * LIMITS.width_min, side * LIMITS.width_max))
        box.append((LIMITS.length_min, LIMITS.length_max) if axis == 0 else tuple(wide))
    objective = np.zeros(size)
    objective[0] = -sign
    result = linprog(objective, A_ub=np.array(rows), b_ub=np.array(bounds_up), bounds=box, method="highs")
    assert result.status == 0
    return sign * result.x[0] * ROBOT.mass * omega**2 / -math.expm1(-omega * 0.1)


@pytest.mark.parametrize(("foot", "flywheel"), [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize(("psi", "axis", "sign"), [(0, 0, 1), (-90, 1, 1), (90, 1, -1)])
def test_equals_a_linear_program_over_trajectories(psi, axis, sign, foot, flywheel):
    closed = max_recoverable_force(ROBOT, math.radians(psi), 0.1, foot, flywheel)
    assert trajectory_limit(axis, sign, foot, flywheel) == pytest.approx(closed, abs=1.0)


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


def test_a_trunk_too_fast_to_stop_costs_margin():
    resting = capture_margin(ROBOT, LIMITS, 0.0, (0.4, 0.1))
    slamming = capture_margin(ROBOT, LIMITS, 0.0, (0.4, 0.1), (1.0, 0.0), (6.0, 0.0))
    assert slamming < resting


@pytest.mark.parametrize("bad", [(math.nan, 0.1), (0.0, 0.0)])
def test_bad_push(bad):
    with pytest.raises(InvalidValueError):
        max_recoverable_force(ROBOT, *bad)
