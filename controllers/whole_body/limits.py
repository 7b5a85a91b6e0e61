"""Limits that planner and control may meet, and the least deviation from the tasks that keeps them.

A motor drives with its full torque up to a share of its speed without load, then with one that falls linearly
to zero there; against its motion it always has its full torque. The model's actuators hold both numbers
(forcerange and user). The speeds are those of the robot H1 of Unitree, which has about these torques and
this mass (`velocity` of the joints in its published URDF): hip and waist 23, knee 14, ankle 9 rad/s.

The exact solution of the tasks, (wrench w, torque tau), changes linearly with a deviation d (14,) from them:
CoM acceleration x, y, z; turning of the pelvis x, y, z; swing sole linear and angular; waist pitch and roll,

    w(d) = w + W_d d,   tau(d) = tau + T_d d,     min  d' Q d   s.t.  tau in its range,  CoP in the sole,
                                                     |(f_x, f_y)| <= mu f_z,  |M_z about the CoP| <= nu f_z.

With v = Q^(1/2) d it is a least-distance problem for DAQP, every row soft, so that it always has an answer.

Whole-body control follows the CoM's acceleration that the planned CMP asks for, and the CoP makes up for the
angular momentum of all other tasks: a braking swing leg alone takes the CMP 0.3 m beyond the CoP. As a rule
that keeps the CoM on the plan. But a CoP planned at the edge says that the sole has less to give than the DCM
needs; there the CoP shall not be taken back for what the legs add. With the CoP c that the tasks ask for, the
planned one p, the edge e, and the CMP m that the DCM lacks until touchdown, the CMP moves by

    s = min((p - c) |p| / e, m),    m = (xi e^(w t) - xi_T) / (e^(w t) - 1) - cmp,

where both point the way of p. It takes a force of -f_z s / z more, which stays well within friction. The
legs turn with the CoM, which takes the CoP 8 % farther; `keep_bounds` ends that at the edge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba.np.numpy_support import carray

from ..array_table import Floats1, Floats2, Ints1
from ..jit import njit
from ..math3 import ZERO, Vector, stack_floats
from ..qp import LeastDistance, solve_least_distance
from .kinematics import NU, NV, TASKS, Array, Heading, Legs, Physics, write_deviation_maps

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

# In the order in which those of one moment are reported
LIMIT_NAMES = (
    "step_length",  # planned, at its bound
    "step_width",  # planned, at its bound
    "step_time",  # planned T at T_min, or the least that the swing foot needs
    "cop",  # planned, at the edge of where the planner may put it
    "trunk_torque",  # planned acceleration at its bound
    "trunk_angle",  # within 5 % of the largest
    "leg_reach",  # the foothold was moved within reach, or the CoM is asked to its lowest
    "joint_torque",  # a motor gives all it can
    "sole_edge",  # CoP that whole-body control asks for at its bound
    "contact",  # friction, yaw moment or least load at its bound
    "touchdown_error",  # the stance foot landed off its plan, or the swing foot is late
    "dcm_tracking",  # the DCM moved as under another CMP than the planned one
)
(
    STEP_LENGTH, STEP_WIDTH, STEP_TIME, COP_EDGE, TRUNK_TORQUE, TRUNK_LEAN, LEG_REACH, JOINT_TORQUE,
    SOLE_EDGE, CONTACT, TOUCHDOWN_ERROR, DCM_TRACKING,
) = (1 << i for i in range(len(LIMIT_NAMES)))  # fmt: skip
LANDED_OFF = 0.03  # a touchdown this far from the planned place counts as an error [m]
LANDED_LATE = 0.03  # or this far from the planned time [s]


FULL_TORQUE_SHARE = 0.7  # of the speed without load, up to which a motor drives with its full torque


@njit(cache=True, forceinline=True)
def driving_share(speed: float, free_speed: float) -> float:
    """Share of its torque with which a motor drives at a speed in the torque's direction [rad/s]."""
    share = (1.0 - speed / free_speed) / (1.0 - FULL_TORQUE_SHARE)
    return min(max(share, 0.0), 1.0)


@njit(cache=True, forceinline=True)
def write_torque_range(phys: Physics, k: int, motors: Array, torque_range: Array) -> None:
    """Write the least and the largest torque of every motor of robot k, (2, 14) [N m]."""
    for i in range(NU):
        top, free_speed, speed = motors[0, i], motors[1, i], phys.qvel[k, NV - NU + i]
        torque_range[0, i] = -top * driving_share(-speed, free_speed)
        torque_range[1, i] = top * driving_share(speed, free_speed)


@njit(cache=True, forceinline=True)
def clip_torque(torque: Array, torque_range: Array) -> None:
    """Clip torques (14,) to what the motors can give."""
    for i in range(NU):
        torque[i] = min(max(torque[i], torque_range[0, i]), torque_range[1, i])


FACES = 8  # of the friction cone
WRENCH_ROWS = 7 + FACES
ROWS = NU + WRENCH_ROWS
FREE = 1e6  # a bound that never binds, in the units of the rows
FORCE_UNIT, MOMENT_UNIT, TORQUE_UNIT = 300.0, 20.0, 100.0  # scale of the rows [N], [N m], [N m]
NEVER = 1e8  # torque [N m] or speed [rad/s] that no motor reaches
SHARE_PRICE = 1e-4  # of (1 N)^2 or (1 N m)^2 that one foot takes over from the other
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
    matrix: Floats2  # (ROWS, TASKS); on two feet with WRENCH_ROWS more
    lower: Floats1  # (ROWS,)
    upper: Floats1  # (ROWS,)
    solution: Floats1  # (TASKS,) v
    grip: Floats1  # (1,) friction that the robot in hand counts on


def make_bounds(
    settings: BoundSettings, motors: Array, two_feet: bool = False
) -> tuple[Bounds, LeastDistance]:
    """Bounds for one thread of control, and the owner of the solver's memory, to be kept as long.

    On two feet there are the rows of both soles, and, in place of the swing sole, what the other one takes.
    """
    swing = (SHARE_PRICE, SHARE_PRICE) if two_feet else (settings.swing_price, settings.swing_turn_price)
    price = np.repeat(
        [settings.com_price, settings.height_price, settings.pelvis_price, settings.heading_price,
         *swing, settings.waist_price],
        [2, 1, 2, 1, 3, 3, 2],
    )  # fmt: skip
    rows = ROWS + WRENCH_ROWS if two_feet else ROWS
    problem = LeastDistance(np.ones((rows, TASKS)), np.full(rows, settings.row_price))
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
def yaw_grip(x: float, y: float, bounds: Bounds) -> float:
    """Bound of |M_z| / f_z about a CoP (x, y) of the sole [m].

    A sole of half sizes X, Y gives mu (X + Y - |x| - |y|) without a tangential force (Caron, Pham and
    Nakamura 2015): nothing at a corner. On two feet, where the CoP stays at corners for long, the bound is no
    larger; on one foot it is `yaw_friction` everywhere.
    """
    s = bounds.settings
    if bounds.matrix.shape[0] == ROWS:
        return s.yaw_friction
    return min(s.yaw_friction, bounds.grip[0] * max(s.cop_x_max + s.cop_y_max - abs(x) - abs(y), 0.0))


@njit(cache=True, forceinline=True)
def sole_bears(wrench: Array, axis: Heading, bounds: Bounds) -> bool:
    """Whether CoP, yaw moment and friction of a wrench (6,) that presses are what a sole can give."""
    s = bounds.settings
    x, y = centre_of_pressure(wrench, axis)
    if abs(x) > s.cop_x_max or abs(y) > s.cop_y_max:
        return False
    most = yaw_grip(x, y, bounds)
    x, y = clipped_cop_in_world(wrench, axis, s)
    if abs(wrench[5] - x * wrench[1] + y * wrench[0]) > most * wrench[2]:
        return False
    return not math.hypot(wrench[0], wrench[1]) > bounds.grip[0] * wrench[2]


@njit(cache=True, forceinline=True)
def motors_give(torque: Array, bounds: Bounds) -> bool:
    """Whether the motors can give torques (14,) at their present speeds."""
    excess = 0.0
    for i in range(NU):
        low, high = bounds.torque_range[0, i], bounds.torque_range[1, i]
        excess = max(excess, low - torque[i], torque[i] - high)
    return excess <= 0.0


@njit(cache=True, forceinline=True)
def within_bounds(wrench: Array, torque: Array, axis: Heading, bounds: Bounds) -> bool:
    """Whether the exact solution of the tasks passes no bound."""
    if wrench[2] < bounds.settings.force_min:
        return False
    return sole_bears(wrench, axis, bounds) and motors_give(torque, bounds)


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
        along, aside = centre_of_pressure(wrench, axis)
        if yaw_grip(along, aside, bounds) < s.yaw_friction:  # on the side of the sole that the CoP is on
            ahead, left = math.copysign(grip, along), math.copysign(grip, aside)
            P[row + 2, 2] = -grip * (s.cop_x_max + s.cop_y_max) / MOMENT_UNIT
            P[row + 2, 3] = (ahead * axis[1] + left * axis[0]) / MOMENT_UNIT
            P[row + 2, 4] = (left * axis[1] - ahead * axis[0]) / MOMENT_UNIT
    asked = math.atan2(wrench[1], wrench[0])
    for face in range(FACES):
        angle = asked + 2.0 * math.pi / FACES * face
        write_row(P, 6 + face, (math.cos(angle), math.sin(angle), -grip), ZERO, FORCE_UNIT)
    write_row(P, WRENCH_ROWS - 1, (0.0, 0.0, -1.0), ZERO, FORCE_UNIT)


@njit(cache=True, forceinline=True)
def write_torque_problem(Td: Array, bounds: Bounds, torque: Array) -> None:
    """Write the first rows of the least-distance problem: torques in range."""
    for i in range(NU):
        for c in range(TASKS):
            bounds.matrix[i, c] = Td[i, c] * bounds.scale[c] / TORQUE_UNIT
        bounds.lower[i] = (bounds.torque_range[0, i] - torque[i]) / TORQUE_UNIT
        bounds.upper[i] = (bounds.torque_range[1, i] - torque[i]) / TORQUE_UNIT


@njit(cache=True, forceinline=True)
def write_wrench_problem(Wd: Array, axis: Heading, bounds: Bounds, wrench: Array, first: int) -> None:
    """Write the rows from `first` on: P wrench <= 0, for a sole whose wrench the deviation changes by W_d."""
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
            bounds.matrix[first + row, c] = total * bounds.scale[c]
        bounds.lower[first + row], bounds.upper[first + row] = -FREE, -value


@njit(cache=True)
def limits_met(wrench: Array, torque: Array, axis: Heading, cop: tuple[float, float], bounds: Bounds) -> int:
    """Bits of LIMIT_NAMES that a wrench (6,) and torques (14,) are at the bounds of.

    `cop` (world axes, from the sole's centre) is the point that the yaw moment counts about [m].
    """
    s, vertical, met = bounds.settings, wrench[2], 0
    x, y = centre_of_pressure(wrench, axis)
    if min(s.cop_x_max - abs(x), s.cop_y_max - abs(y)) * vertical < AT_BOUND * MOMENT_UNIT:
        met |= SOLE_EDGE
    yaw = wrench[5] - cop[0] * wrench[1] + cop[1] * wrench[0]
    grip = bounds.grip[0] * vertical - math.hypot(wrench[0], wrench[1])
    if (
        yaw_grip(x, y, bounds) * vertical - abs(yaw) < AT_BOUND * MOMENT_UNIT
        or min(grip, vertical - s.force_min) < AT_BOUND * FORCE_UNIT
    ):
        met |= CONTACT
    for i in range(NU):
        low, high = bounds.torque_range[0, i], bounds.torque_range[1, i]
        if min(torque[i] - low, high - torque[i]) < AT_BOUND * TORQUE_UNIT:
            met |= JOINT_TORQUE
    return met


@njit(cache=True, forceinline=True)
def deviate(per_deviation: Array, bounds: Bounds, values: Array) -> None:
    """Add what the solution makes of values (m,) that follow the deviation by (m, 14)."""
    for c in range(TASKS):
        d = bounds.scale[c] * bounds.solution[c]
        for i in range(values.shape[0]):
            values[i] += per_deviation[i, c] * d


@njit(cache=True, forceinline=False)
def keep_bounds(
    phys: Physics, k: int, legs: Legs, axis: Heading, bounds: Bounds, wrench: Array, torque: Array
) -> int:
    """Replace wrench (6,) and torque (14,) by those of the least deviation that keeps the bounds.

    Returns the bits of `limits_met` that they are at the bounds of.
    """
    Wd, Td = carray(stack_floats(84), (6, TASKS)), carray(stack_floats(196), (NU, TASKS))
    write_deviation_maps(phys, k, legs, Wd, Td)
    write_torque_problem(Td, bounds, torque)
    write_wrench_problem(Wd, axis, bounds, wrench, NU)
    bounds.upper[ROWS - 1] -= bounds.settings.force_min / FORCE_UNIT
    cop = clipped_cop_in_world(wrench, axis, bounds.settings)
    if solve_least_distance(bounds.handle) <= 0:
        return limits_met(wrench, torque, axis, cop, bounds)
    deviate(Wd, bounds, wrench)
    deviate(Td, bounds, torque)
    return limits_met(wrench, torque, axis, cop, bounds)


SHARE_OF_GRIP = 0.8  # of the friction counted on; up to there the force may grow
SHORTEST = 1e-3  # least e^(w t) - 1


@njit(cache=True, forceinline=True)
def missing_cmp(dcm: float, goal: float, cmp: float, growth: float) -> float:
    """How far beyond a CMP another one lies, which takes the DCM to its goal at touchdown [m].

    `growth` is exp(omega t) for the time t to touchdown; all from the sole's centre [m].
    """
    return (growth * dcm - goal) / max(growth - 1.0, SHORTEST) - cmp


@njit(cache=True, forceinline=True)
def kept_cop(planned: float, cop: float, edge: float, missing: float) -> float:
    """How far [m] the CoP moves towards the edge that it is planned at, from where the tasks ask for it."""
    side = math.copysign(1.0, planned)
    wanted = min(abs(planned), edge)
    return side * max(min((wanted - side * cop) * wanted / edge, side * missing), 0.0)


@njit(cache=True, forceinline=True)
def share_within(x: float, y: float, dx: float, dy: float, radius: float) -> float:
    """Largest share (0 to 1) with (x, y) + share (dx, dy) within a radius; 0 where (x, y) is not."""
    a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius * radius
    if c >= 0.0 or a == 0.0:
        return 0.0
    return min((math.sqrt(b * b - a * c) - b) / a, 1.0)


@njit(cache=True, forceinline=True)
def full_sole_force(
    wrench: Array, axis: Heading, planned: Heading, missing: Heading, height: float, bounds: Bounds
) -> Heading:
    """Horizontal force, world axes [N], that keeps the CoP where it is planned at the edge.

    `planned` CoP and `missing` CMP along the foot's axes [m], `height` of the CoM over the sole [m].
    """
    s, vertical = bounds.settings, wrench[2]
    if vertical <= 0.0:
        return 0.0, 0.0
    x, y = centre_of_pressure(wrench, axis)
    x = kept_cop(planned[0], x, s.cop_x_max, missing[0])
    y = kept_cop(planned[1], y, s.cop_y_max, missing[1])
    gain = -vertical / height
    fx, fy = gain * (axis[0] * x - axis[1] * y), gain * (axis[1] * x + axis[0] * y)
    share = share_within(wrench[0], wrench[1], fx, fy, SHARE_OF_GRIP * bounds.grip[0] * vertical)
    return share * fx, share * fy
