"""The least deviation from the whole-body tasks that keeps torques, CoP, friction and yaw moment in bounds.

The exact solution of the tasks, (wrench w, torque tau), changes linearly with a deviation d (14,) from them:
CoM acceleration x, y, z; turning of the pelvis x, y, z; swing sole linear and angular; waist pitch and roll,

    w(d) = w + W_d d,   tau(d) = tau + T_d d,     min  d' Q d   s.t.  |tau| <= tau_max,  CoP in the sole,
                                                     |f_x|, |f_y| <= mu f_z,  |M_z about the CoP| <= nu f_z.

With v = Q^(1/2) d it is a least-distance problem for DAQP, every row soft, so that it always has an answer.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..controllers.least_distance import LeastDistance, solve_least_distance
from .biped_kinematics import NU, NV, WAIST_DOF, Array, Ints, cross_into
from .small_matrix import gauss_solve

TASKS = 14
ROWS = NU + 11
FREE = 1e6  # a bound that never binds, in the units of the rows
FORCE_UNIT, MOMENT_UNIT, TORQUE_UNIT = 300.0, 20.0, 100.0  # scale of the rows [N], [N m], [N m]


class BoundSettings(NamedTuple):
    """Bounds of the stance wrench and the price of each deviation from the tasks."""

    cop_x_max: float = 0.0791  # [m], from the centre of the sole
    cop_y_max: float = 0.0401  # [m]
    yaw_friction: float = 0.0294  # bound of |M_z| / f_z about the CoP [m]
    friction: float = 0.821  # bound of |f_x| / f_z and |f_y| / f_z
    force_min: float = 100.0  # lowest vertical force [N]
    com_price: float = 1.0  # of (1 m/s^2)^2, horizontal
    height_price: float = 0.254  # of (1 m/s^2)^2
    pelvis_price: float = 0.0158  # of (1 rad/s^2)^2, pitch and roll
    heading_price: float = 0.005  # of (1 rad/s^2)^2
    swing_price: float = 0.02  # of (1 m/s^2)^2
    swing_turn_price: float = 0.00173  # of (1 rad/s^2)^2
    waist_price: float = 0.00441  # of (1 rad/s^2)^2
    row_price: float = 1e4  # of a bound passed by one unit of its row


class Bounds(NamedTuple):
    """Bounds and the workspace of one least-distance problem; rewritten by every solve."""

    settings: BoundSettings
    torque_max: Array  # (14,) [N m]
    scale: Array  # (14,) Q^(-1/2)
    handle: Ints  # of the solver
    matrix: Array  # (ROWS, TASKS)
    lower: Array  # (ROWS,)
    upper: Array  # (ROWS,)
    solution: Array  # (TASKS,) v


def make_bounds(settings: BoundSettings, torque_max: Array) -> tuple[Bounds, LeastDistance]:
    """Bounds for one thread of control, and the owner of the solver's memory, to be kept as long."""
    price = np.repeat(
        [settings.com_price, settings.height_price, settings.pelvis_price, settings.heading_price,
         settings.swing_price, settings.swing_turn_price, settings.waist_price],
        [2, 1, 2, 1, 3, 3, 2],
    )  # fmt: skip
    problem = LeastDistance(np.ones((ROWS, TASKS)), np.full(ROWS, settings.row_price))
    bounds = Bounds(
        settings, torque_max, 1.0 / np.sqrt(price), problem.handle, problem.M, problem.lower, problem.upper,
        problem.x,
    )  # fmt: skip
    return bounds, problem


class TaskMaps(NamedTuple):
    """How accelerations and wrench follow from the base acceleration and the swing leg."""

    mass_matrix: Array  # (20, 20)
    base: Array  # (20, 7) qdd = base (x, 1)
    wrench: Array  # (6, 7) w = wrench (x, 1)
    swing_inverse: Array  # (6, 6)
    stance_jacobian: Array  # (6, 6)
    stance_dof: int
    swing_dof: int


@njit(cache=True)
def centre_of_pressure(wrench: Array, axes: Array, settings: BoundSettings) -> Array:
    """CoP in the foot's axes, (2,) [m]; far outside where nothing presses on the floor."""
    out = np.empty(2)
    vertical = max(wrench[2], 1e-3)
    out[0] = -(axes[1, 0] * wrench[3] + axes[1, 1] * wrench[4]) / vertical
    out[1] = (axes[0, 0] * wrench[3] + axes[0, 1] * wrench[4]) / vertical
    return out


@njit(cache=True)
def clipped_cop_in_world(wrench: Array, axes: Array, settings: BoundSettings) -> Array:
    """CoP (2,) [m] from the centre of the sole, moved into the sole, world axes."""
    cop = centre_of_pressure(wrench, axes, settings)
    x = min(max(cop[0], -settings.cop_x_max), settings.cop_x_max)
    y = min(max(cop[1], -settings.cop_y_max), settings.cop_y_max)
    cop[0] = x * axes[0, 0] + y * axes[1, 0]
    cop[1] = x * axes[0, 1] + y * axes[1, 1]
    return cop


@njit(cache=True)
def within_bounds(wrench: Array, torque: Array, axes: Array, bounds: Bounds) -> bool:
    """Whether the exact solution of the tasks passes no bound."""
    s = bounds.settings
    if wrench[2] < s.force_min:
        return False
    cop = centre_of_pressure(wrench, axes, s)
    if abs(cop[0]) > s.cop_x_max or abs(cop[1]) > s.cop_y_max:
        return False
    world = clipped_cop_in_world(wrench, axes, s)
    if abs(wrench[5] - world[0] * wrench[1] + world[1] * wrench[0]) > s.yaw_friction * wrench[2]:
        return False
    for axis in range(2):
        if abs(axes[axis, 0] * wrench[0] + axes[axis, 1] * wrench[1]) > s.friction * wrench[2]:
            return False
    return bool(np.all(np.abs(torque) <= bounds.torque_max))


@njit(cache=True)
def deviation_maps(maps: TaskMaps, R: Array, arm: Array) -> tuple[Array, Array]:
    """W_d (6, 14) and T_d (14, 14): how wrench and torque follow a deviation from the tasks."""
    M = maps.mass_matrix
    own = np.zeros((NV, 8))  # qdd of swing sole and waist alone, at rest base
    for i in range(6):
        for c in range(6):
            own[maps.swing_dof + i, c] = maps.swing_inverse[i, c]
    own[WAIST_DOF, 6] = own[WAIST_DOF + 1, 7] = 1.0
    Wd = np.zeros((6, TASKS))
    base, moment = np.empty(6), np.empty(3)
    for c in range(8):
        base[:] = 0.0
        for j in range(NV):
            if own[j, c] != 0.0:
                for i in range(6):
                    base[i] += M[i, j] * own[j, c]
        cross_into(arm, base[:3], moment)
        for i in range(3):
            Wd[i, 6 + c] = base[i]
            Wd[3 + i, 6 + c] = (
                moment[i] + R[3 * i] * base[3] + R[3 * i + 1] * base[4] + R[3 * i + 2] * base[5]
            )
    A, E = np.zeros((6, 6)), np.zeros((6, TASKS))
    for i in range(3):
        for c in range(6):
            A[i, c] = maps.wrench[i, c]
        A[3 + i, 3 + i] = 1.0
        E[i, i] = M[0, 0]
        E[3 + i, 3 + i] = 1.0
        for c in range(8):
            E[i, 6 + c] = -Wd[i, 6 + c]
    gauss_solve(A, E)
    qdd = np.zeros((NV, TASKS))
    for c in range(TASKS):
        for r in range(6):
            for i in range(6):
                Wd[i, c] += maps.wrench[i, r] * E[r, c]
            for j in range(NV):
                qdd[j, c] += maps.base[j, r] * E[r, c]
        if c >= 6:
            for j in range(NV):
                qdd[j, c] += own[j, c - 6]
    Td = np.zeros((NU, TASKS))
    for i in range(NU):
        for j in range(NV):
            m = M[6 + i, j]
            if m != 0.0:
                for c in range(TASKS):
                    Td[i, c] += m * qdd[j, c]
    for i in range(6):
        for r in range(6):
            for c in range(TASKS):
                Td[maps.stance_dof - 6 + i, c] -= maps.stance_jacobian[r, i] * Wd[r, c]
    return Wd, Td


@njit(cache=True)
def write_row(
    bounds: Bounds, row: int, p: Array, Wd: Array, wrench: Array, low: float, high: float, unit: float
) -> None:
    """Row low <= p . w(d) <= high of the least-distance problem, divided by its unit."""
    value = 0.0
    for i in range(6):
        value += p[i] * wrench[i]
    for c in range(TASKS):
        total = 0.0
        for i in range(6):
            total += p[i] * Wd[i, c]
        bounds.matrix[row, c] = total * bounds.scale[c] / unit
    bounds.lower[row] = (low - value) / unit if low > -FREE else -FREE
    bounds.upper[row] = (high - value) / unit if high < FREE else FREE


@njit(cache=True)
def write_wrench_rows(Wd: Array, wrench: Array, axes: Array, bounds: Bounds) -> None:
    """Eleven rows: CoP x, y (4), friction x, y (4), yaw moment (2), vertical force (1)."""
    s = bounds.settings
    cop = clipped_cop_in_world(wrench, axes, s)
    p = np.zeros(6)
    row = NU
    for axis in range(2):
        u, other = axes[axis], axes[1 - axis]
        turn = -1.0 if axis == 0 else 1.0
        edge = s.cop_x_max if axis == 0 else s.cop_y_max
        for side in range(2):
            sign = 1.0 - 2.0 * side
            p[:] = 0.0
            p[3], p[4], p[2] = sign * turn * other[0], sign * turn * other[1], -edge
            write_row(bounds, row, p, Wd, wrench, -FREE, 0.0, MOMENT_UNIT)
            p[:] = 0.0
            p[0], p[1], p[2] = sign * u[0], sign * u[1], -s.friction
            write_row(bounds, row + 1, p, Wd, wrench, -FREE, 0.0, FORCE_UNIT)
            row += 2
    for side in range(2):
        sign = 1.0 - 2.0 * side
        p[:] = 0.0
        p[5], p[1], p[0], p[2] = sign, -sign * cop[0], sign * cop[1], -s.yaw_friction
        write_row(bounds, row, p, Wd, wrench, -FREE, 0.0, MOMENT_UNIT)
        row += 1
    p[:] = 0.0
    p[2] = 1.0
    write_row(bounds, row, p, Wd, wrench, s.force_min, FREE, FORCE_UNIT)


@njit(cache=True)
def keep_bounds(
    maps: TaskMaps, R: Array, arm: Array, axes: Array, bounds: Bounds, wrench: Array, torque: Array
) -> None:
    """Replace wrench (6,) and torque (14,) by those of the least deviation that keeps the bounds.

    R (9,) are the axes of the pelvis, arm (3,) its place from the stance sole.
    """
    Wd, Td = deviation_maps(maps, R, arm)
    for i in range(NU):
        for c in range(TASKS):
            bounds.matrix[i, c] = Td[i, c] * bounds.scale[c] / TORQUE_UNIT
        bounds.lower[i] = (-bounds.torque_max[i] - torque[i]) / TORQUE_UNIT
        bounds.upper[i] = (bounds.torque_max[i] - torque[i]) / TORQUE_UNIT
    write_wrench_rows(Wd, wrench, axes, bounds)
    if solve_least_distance(bounds.handle) <= 0:
        return
    for c in range(TASKS):
        d = bounds.scale[c] * bounds.solution[c]
        for i in range(6):
            wrench[i] += Wd[i, c] * d
        for i in range(NU):
            torque[i] += Td[i, c] * d
