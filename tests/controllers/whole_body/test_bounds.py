"""Bounds of the stance wrench, off heading 0, at each of their sides."""

import math

import numpy as np
import pytest
from push_recovery.controllers.whole_body.kinematics import NU
from push_recovery.controllers.whole_body.limits import (
    CONTACT,
    JOINT_TORQUE,
    SOLE_EDGE,
    bounds_met,
    centre_of_pressure,
    make_bounds,
    within_bounds,
)
from push_recovery.envs.biped.core import BIPED_BOUNDS

S = BIPED_BOUNDS._replace(cop_x_max=0.06, cop_y_max=0.04, yaw_friction=0.02, friction=0.8, force_min=30.0)
HEADING, LOAD = 0.7, 600.0
AXIS = (math.cos(HEADING), math.sin(HEADING))
SMALL = 5e-3


def turned(x: float, y: float) -> np.ndarray:
    """A vector of the foot's axes in the world."""
    return np.array([AXIS[0] * x - AXIS[1] * y, AXIS[1] * x + AXIS[0] * y, 0.0])


def wrench_at(cop=(0.0, 0.0), force=(0.0, 0.0), yaw=0.0, load=LOAD) -> np.ndarray:
    """Wrench (6,) about the sole's centre of a force at a CoP and a yaw moment about it, foot's axes."""
    push = turned(*force) + [0.0, 0.0, load]
    return np.concatenate([push, np.cross(turned(*cop), push) + [0.0, 0.0, yaw]])


def judged(wrench, torque=None) -> tuple[bool, int]:
    bounds, _memory = make_bounds(S, np.full((2, NU), 1.0))
    bounds.torque_range[:] = [[-50.0] * NU, [80.0] * NU]
    torque = np.zeros(NU) if torque is None else torque
    x, y = centre_of_pressure(wrench, AXIS)
    cop = turned(np.clip(x, -S.cop_x_max, S.cop_x_max), np.clip(y, -S.cop_y_max, S.cop_y_max))
    return within_bounds(wrench, torque, AXIS, bounds), bounds_met(
        wrench, torque, AXIS, (cop[0], cop[1]), bounds
    )


def test_the_cop_is_where_the_force_acts():
    wrench = wrench_at((0.03, -0.02), (40.0, -25.0), 3.0)
    assert centre_of_pressure(wrench, AXIS) == pytest.approx((0.03, -0.02), abs=1e-12)


YAW = S.yaw_friction * LOAD
CASES = [
    ("cop forward", lambda k: {"cop": (k * S.cop_x_max, 0.0)}, SOLE_EDGE),
    ("cop backward", lambda k: {"cop": (-k * S.cop_x_max, 0.0)}, SOLE_EDGE),
    ("cop left", lambda k: {"cop": (0.0, k * S.cop_y_max)}, SOLE_EDGE),
    ("cop right", lambda k: {"cop": (0.0, -k * S.cop_y_max)}, SOLE_EDGE),
    (
        "yaw",
        lambda k: {"yaw": k * YAW, "cop": (0.03, 0.02), "force": (50.0, 90.0)},
        CONTACT,
    ),
    (
        "yaw back",
        lambda k: {"yaw": -k * YAW, "cop": (0.0, 0.03), "force": (90.0, 0.0)},
        CONTACT,
    ),
    ("friction", lambda k: {"force": (0.6 * k * S.friction * LOAD, -0.8 * k * S.friction * LOAD)}, CONTACT),
    ("load", lambda k: {"load": (2.0 - k) * S.force_min}, CONTACT),
]


@pytest.mark.parametrize(("case", "meets"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_each_bound_of_the_wrench_ends_where_it_says(case, meets):
    assert judged(wrench_at(**case(1.0 - SMALL))) == (True, 0)
    within, met = judged(wrench_at(**case(1.0 + SMALL)))
    assert not within
    assert met & meets
    assert not met & JOINT_TORQUE


@pytest.mark.parametrize("motor", [0, NU - 1])
@pytest.mark.parametrize(("edge", "out"), [(-50.0, -1.0), (80.0, 1.0)])
def test_each_motor_has_a_least_and_a_largest_torque(motor, edge, out):
    torque = np.zeros(NU)
    torque[motor] = edge - 0.5 * out
    assert judged(wrench_at(), torque) == (True, 0)
    torque[motor] = edge + 0.5 * out
    assert judged(wrench_at(), torque) == (False, JOINT_TORQUE)
