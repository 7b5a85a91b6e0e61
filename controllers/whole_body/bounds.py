"""The least deviation from the whole-body tasks that keeps torques, CoP, friction and yaw moment in bounds.

The exact solution of the tasks, (wrench w, torque tau), changes linearly with a deviation d (14,) from them:
CoM acceleration x, y, z; turning of the pelvis x, y, z; swing sole linear and angular; waist pitch and roll,

    w(d) = w + W_d d,   tau(d) = tau + T_d d,     min  d' Q d   s.t.  tau in its range,  CoP in the sole,
                                                     |(f_x, f_y)| <= mu f_z,  |M_z about the CoP| <= nu f_z.

With v = Q^(1/2) d it is a least-distance problem for DAQP, every row soft, so that it always has an answer.
"""

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba.np.numpy_support import carray

from ..compiled.array_table import Floats1, Floats2, Ints1
from ..compiled.kernels import njit
from ..compiled.stack_array import stack_floats
from ..compiled.vector_3 import ZERO, Vector
from ..solvers.least_distance import LeastDistance, solve_least_distance
from .bounds_met import CONTACT, JOINT_TORQUE, SOLE_EDGE
from .deviation_maps import TASKS, Legs, write_deviation_maps
from .kinematics import NU, Array, Heading, Physics

FACES = 8  # of the friction cone
WRENCH_ROWS = 7 + FACES
ROWS = NU + WRENCH_ROWS
FREE = 1e6  # a bound that never binds, in the units of the rows
FORCE_UNIT, MOMENT_UNIT, TORQUE_UNIT = 300.0, 20.0, 100.0  # scale of the rows [N], [N m], [N m]
NEVER = 1e8  # torque [N m] or speed [rad/s] that no motor reaches
AT_BOUND = 1e-4  # in these units, from where a bound counts as met


class BoundSettings(NamedTuple):
    """Bounds of the stance wrench and the price of each deviation from the tasks."""

    cop_x_max: float  # [m], from the centre of the sole
    cop_y_max: float  # [m]
    yaw_friction: float  # bound of |M_z| / f_z about the CoP [m]
    friction: float  # bound of |(f_x, f_y)| / f_z, until the foot has slipped with less
    force_min: float  # lowest vertical force [N]
    com_price: float  # of (1 m/s^2)^2, horizontal
    height_price: float  # of (1 m/s^2)^2
    pelvis_price: float  # of (1 rad/s^2)^2, pitch and roll
    heading_price: float  # of (1 rad/s^2)^2
    swing_price: float  # of (1 m/s^2)^2
    swing_turn_price: float  # of (1 rad/s^2)^2
    waist_price: float  # of (1 rad/s^2)^2
    row_price: float  # of a bound passed by one unit of its row


class Bounds(NamedTuple):
    """Bounds and the workspace of one least-distance problem; rewritten by every solve."""

    settings: BoundSettings
    motors: Floats2  # (2, 14) torque limit [N m] and speed without load [rad/s]
    torque_range: Floats2  # (2, 14) least and largest torque at the present speeds [N m]
    scale: Floats1  # (14,) Q^(-1/2)
    handle: Ints1  # of the solver
    matrix: Floats2  # (ROWS, TASKS)
    lower: Floats1  # (ROWS,)
    upper: Floats1  # (ROWS,)
    solution: Floats1  # (TASKS,) v
    grip: Floats1  # (1,) friction that the robot in hand counts on


def make_bounds(settings: BoundSettings, motors: Array) -> tuple[Bounds, LeastDistance]:
    """Bounds for one thread of control, and the owner of the solver's memory, to be kept as long."""
    price = np.repeat(
        [settings.com_price, settings.height_price, settings.pelvis_price, settings.heading_price,
         settings.swing_price, settings.swing_turn_price, settings.waist_price],
        [2, 1, 2, 1, 3, 3, 2],
    )  # fmt: skip
    problem = LeastDistance(np.ones((ROWS, TASKS)), np.full(ROWS, settings.row_price))
    bounds = Bounds(
        settings, motors, np.zeros((2, NU)), 1.0 / np.sqrt(price), problem.handle, problem.M, problem.lower,
        problem.upper, problem.x, np.array([settings.friction]),
    )  # fmt: skip
    return bounds, problem


@njit(cache=True, forceinline=True)
def centre_of_pressure(wrench: Array, axis: Heading) -> tuple[float, float]:
    """CoP in the foot's axes [m]; far outside where nothing presses on the floor."""
    vertical = max(wrench[2], 1e-3)
    x = (axis[1] * wrench[3] - axis[0] * wrench[4]) / vertical
    return x, (axis[0] * wrench[3] + axis[1] * wrench[4]) / vertical


@njit(cache=True, forceinline=True)
def clipped_cop_in_world(wrench: Array, axis: Heading, settings: BoundSettings) -> tuple[float, float]:
    """CoP [m] from the centre of the sole, moved into the sole, world axes."""
    x, y = centre_of_pressure(wrench, axis)
    x = min(max(x, -settings.cop_x_max), settings.cop_x_max)
    y = min(max(y, -settings.cop_y_max), settings.cop_y_max)
    return x * axis[0] - y * axis[1], x * axis[1] + y * axis[0]


@njit(cache=True, forceinline=True)
def within_bounds(wrench: Array, torque: Array, axis: Heading, bounds: Bounds) -> bool:
    """Whether the exact solution of the tasks passes no bound."""
    s = bounds.settings
    if wrench[2] < s.force_min:
        return False
    x, y = centre_of_pressure(wrench, axis)
    if abs(x) > s.cop_x_max or abs(y) > s.cop_y_max:
        return False
    x, y = clipped_cop_in_world(wrench, axis, s)
    if abs(wrench[5] - x * wrench[1] + y * wrench[0]) > s.yaw_friction * wrench[2]:
        return False
    if math.hypot(wrench[0], wrench[1]) > bounds.grip[0] * wrench[2]:
        return False
    excess = 0.0
    for i in range(NU):
        low, high = bounds.torque_range[0, i], bounds.torque_range[1, i]
        excess = max(excess, low - torque[i], torque[i] - high)
    return excess <= 0.0


@njit(cache=True, forceinline=True)
def write_row(P: Array, row: int, force: Vector, moment: Vector, unit: float) -> None:
    """Row of P: its product with the wrench is force . f + moment . M in `unit`."""
    for i in range(3):
        P[row, i], P[row, 3 + i] = force[i] / unit, moment[i] / unit


@njit(cache=True, forceinline=True)
def write_wrench_rows(wrench: Array, axis: Heading, bounds: Bounds, P: Array) -> None:
    """Fifteen rows: CoP x, y (4), yaw moment (2), friction (8), vertical force (1), (15, 6).

    The faces of friction touch the cone, one of them where the asked force points.
    """
    s, grip = bounds.settings, bounds.grip[0]
    cop_x, cop_y = clipped_cop_in_world(wrench, axis, s)
    for side in range(2):
        sign, row = 1.0 - 2.0 * side, 3 * side
        x, y = sign * axis[0], sign * axis[1]
        # CoP forward = -(moment to the left) / f_z, and to the left = (moment forward) / f_z
        write_row(P, row, (0.0, 0.0, -s.cop_x_max), (y, -x, 0.0), MOMENT_UNIT)
        write_row(P, row + 1, (0.0, 0.0, -s.cop_y_max), (x, y, 0.0), MOMENT_UNIT)
        write_row(P, row + 2, (sign * cop_y, -sign * cop_x, -s.yaw_friction), (0.0, 0.0, sign), MOMENT_UNIT)
    asked = math.atan2(wrench[1], wrench[0])
    for face in range(FACES):
        angle = asked + 2.0 * math.pi / FACES * face
        write_row(P, 6 + face, (math.cos(angle), math.sin(angle), -grip), ZERO, FORCE_UNIT)
    write_row(P, WRENCH_ROWS - 1, (0.0, 0.0, -1.0), ZERO, FORCE_UNIT)


@njit(cache=True, forceinline=True)
def write_problem(Wd: Array, Td: Array, axis: Heading, bounds: Bounds, wrench: Array, torque: Array) -> None:
    """Write the least-distance problem: torques in range, then P wrench <= 0, of the load <= -force_min."""
    for i in range(NU):
        for c in range(TASKS):
            bounds.matrix[i, c] = Td[i, c] * bounds.scale[c] / TORQUE_UNIT
        bounds.lower[i] = (bounds.torque_range[0, i] - torque[i]) / TORQUE_UNIT
        bounds.upper[i] = (bounds.torque_range[1, i] - torque[i]) / TORQUE_UNIT
    P = carray(stack_floats(90), (WRENCH_ROWS, 6))
    write_wrench_rows(wrench, axis, bounds, P)
    for row in range(WRENCH_ROWS):
        value = 0.0
        for i in range(6):
            value += P[row, i] * wrench[i]
        for c in range(TASKS):
            total = 0.0
            for i in range(6):
                total += P[row, i] * Wd[i, c]
            bounds.matrix[NU + row, c] = total * bounds.scale[c]
        bounds.lower[NU + row], bounds.upper[NU + row] = -FREE, -value
    bounds.upper[ROWS - 1] -= bounds.settings.force_min / FORCE_UNIT


@njit(cache=True)
def bounds_met(wrench: Array, torque: Array, axis: Heading, cop: tuple[float, float], bounds: Bounds) -> int:
    """Bits of `bounds_record` that a wrench (6,) and torques (14,) are at the bounds of.

    `cop` (world axes, from the sole's centre) is the point that the yaw moment counts about [m].
    """
    s, vertical, met = bounds.settings, wrench[2], 0
    x, y = centre_of_pressure(wrench, axis)
    if min(s.cop_x_max - abs(x), s.cop_y_max - abs(y)) * vertical < AT_BOUND * MOMENT_UNIT:
        met |= SOLE_EDGE
    yaw = wrench[5] - cop[0] * wrench[1] + cop[1] * wrench[0]
    grip = bounds.grip[0] * vertical - math.hypot(wrench[0], wrench[1])
    if (
        s.yaw_friction * vertical - abs(yaw) < AT_BOUND * MOMENT_UNIT
        or min(grip, vertical - s.force_min) < AT_BOUND * FORCE_UNIT
    ):
        met |= CONTACT
    for i in range(NU):
        low, high = bounds.torque_range[0, i], bounds.torque_range[1, i]
        if min(torque[i] - low, high - torque[i]) < AT_BOUND * TORQUE_UNIT:
            met |= JOINT_TORQUE
    return met


@njit(cache=True, forceinline=False)
def keep_bounds(
    phys: Physics, k: int, legs: Legs, axis: Heading, bounds: Bounds, wrench: Array, torque: Array
) -> int:
    """Replace wrench (6,) and torque (14,) by those of the least deviation that keeps the bounds.

    Returns the bits of `bounds_met` that they are at the bounds of.
    """
    Wd, Td = carray(stack_floats(84), (6, TASKS)), carray(stack_floats(196), (NU, TASKS))
    write_deviation_maps(phys, k, legs, Wd, Td)
    write_problem(Wd, Td, axis, bounds, wrench, torque)
    cop = clipped_cop_in_world(wrench, axis, bounds.settings)
    if solve_least_distance(bounds.handle) <= 0:
        return bounds_met(wrench, torque, axis, cop, bounds)
    for c in range(TASKS):
        d = bounds.scale[c] * bounds.solution[c]
        for i in range(6):
            wrench[i] += Wd[i, c] * d
        for i in range(NU):
            torque[i] += Td[i, c] * d
    return bounds_met(wrench, torque, axis, cop, bounds)
