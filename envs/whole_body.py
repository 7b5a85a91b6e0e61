"""Whole-body control: exact inverse dynamics of the floating-base biped on one flat stance foot.

The accelerations of stance foot, swing foot, waist, pelvis and CoM determine all generalised accelerations,

    M(q) qdd + h(q, qd) = S' tau + J_s' w,      J_i qdd = a_i - Jdot_i qd   for both feet,

so nothing is left to optimise as long as no bound is met. With the base acceleration x = (a, alpha) as the
unknown, qdd = c + D x, and the contact wrench at the stance sole, w = w0 + W x, follows from the six rows of
the base. The CoM obeys the pendulum, acc = omega^2 (com - cmp); the CoP absorbs the swing leg's momentum.
Where a torque, the CoP, friction or the yaw moment would pass its bound, `wrench_bounds` finds the least
deviation from the tasks that keeps it.
"""

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.np.numpy_support import carray

from ..controllers.robot import GRAVITY
from .biped_kinematics import (
    FOOT_BODY,
    LEG_DOF,
    NU,
    NV,
    PELVIS,
    WAIST_DOF,
    Array,
    Ints,
    Physics,
    SoleMotion,
    base_angular_velocity,
    cross_into,
    sole_motion,
    upright_error,
)
from .small_matrix import cholesky_solve, gauss_solve
from .stack_array import stack_floats
from .wrench_bounds import Bounds, TaskMaps, keep_bounds, within_bounds


class Gains(NamedTuple):
    """Gains of the whole-body tasks, stiffness [1/s^2] and damping [1/s]."""

    stance_kp: float = 300.0  # levels the stance foot
    stance_kd: float = 35.0
    swing_kp: float = 329.0  # sole position
    swing_kd: float = 36.3
    swing_max: float = 72.6  # bound of the acceleration asked of the swing sole [m/s^2]
    swing_turn_kp: float = 400.0  # sole orientation
    swing_turn_kd: float = 40.0
    pelvis_kp: float = 108.0  # upright
    pelvis_kd: float = 20.8
    heading_kp: float = 205.0
    heading_kd: float = 28.6
    height_kp: float = 100.0  # CoM height
    height_kd: float = 20.0
    damping: float = 1e-6  # of the leg inverse near a straight knee


class Task(NamedTuple):
    """What one robot shall do now, in world axes."""

    stance: int  # 0 left, 1 right
    com_acceleration: Array  # (2,) [m/s^2]
    height: float  # of the CoM above the stance sole [m]
    heading: float  # [rad]
    swing: Array  # (9,) position, velocity, acceleration of the swing sole
    waist: Array  # (2,) acceleration of the waist's pitch and roll joints [rad/s^2]


@njit(cache=True)
def dense_mass_matrix(phys: Physics, k: int, index: Ints, M: Array) -> None:
    """Write M(q), (20, 20), from the sparse entries."""
    M[:] = 0.0
    for e in range(index.shape[0]):
        i, j = index[e, 0], index[e, 1]
        M[i, j] = phys.mass_matrix[k, e]
        M[j, i] = phys.mass_matrix[k, e]


@njit(cache=True)
def stance_acceleration(phys: Physics, k: int, foot: SoleMotion, task: Task, gains: Gains) -> Array:
    """Acceleration (6,) that keeps the stance foot still and level."""
    error = np.empty(3)
    upright_error(phys.xmat[k, FOOT_BODY[task.stance]], task.heading, error)
    out = -gains.stance_kd * foot.twist
    out[3] += gains.stance_kp * error[0]
    out[4] += gains.stance_kp * error[1]
    return out


@njit(cache=True)
def swing_acceleration(phys: Physics, k: int, foot: SoleMotion, task: Task, gains: Gains) -> Array:
    """Acceleration (6,) that follows the swing reference with a level sole along the heading."""
    error = np.empty(3)
    upright_error(phys.xmat[k, FOOT_BODY[1 - task.stance]], task.heading, error)
    out = np.empty(6)
    for i in range(3):
        out[i] = task.swing[6 + i] + gains.swing_kp * (task.swing[i] - foot.position[i])
        out[i] += gains.swing_kd * (task.swing[3 + i] - foot.twist[i])
        out[3 + i] = gains.swing_turn_kp * error[i] - gains.swing_turn_kd * foot.twist[3 + i]
    size = np.sqrt(out[0] ** 2 + out[1] ** 2)
    if size > gains.swing_max:
        out[0] *= gains.swing_max / size
        out[1] *= gains.swing_max / size
    return out


@njit(cache=True)
def base_angular_acceleration(phys: Physics, k: int, omega: Array, task: Task, gains: Gains) -> Array:
    """Angular acceleration (3,) that keeps the pelvis upright and along the heading."""
    out = np.empty(3)
    upright_error(phys.xmat[k, PELVIS], task.heading, out)
    for i in range(2):
        out[i] = gains.pelvis_kp * out[i] - gains.pelvis_kd * omega[i]
    out[2] = gains.heading_kp * out[2] - gains.heading_kd * omega[2]
    return out


@njit(cache=True)
def add_leg_rows(
    foot: SoleMotion, asked: Array, base: Array, dof: int, damping: float, map_: Array, inverse: Array
) -> None:
    """Rows of [D | c] (20, 7) for a leg: J_leg qdd_leg = asked - drift - B x, by the damped inverse.

    B maps the base acceleration x to the sole: linear a + alpha x d, angular alpha, d = sole - base.
    Writes the damped inverse (J'J + damping I)^-1 J', (6, 6), too.
    """
    J = foot.jacobian
    A, rhs = carray(stack_floats(36), (6, 6)), carray(stack_floats(42), (6, 7))
    A[:], rhs[:] = 0.0, 0.0
    for i in range(6):
        rhs[i, i] = -1.0
        rhs[i, 6] = asked[i] - foot.drift[i]
    d0, d1, d2 = foot.position[0] - base[0], foot.position[1] - base[1], foot.position[2] - base[2]
    rhs[0, 4], rhs[0, 5] = -d2, d1
    rhs[1, 3], rhs[1, 5] = d2, -d0
    rhs[2, 3], rhs[2, 4] = -d1, d0
    for i in range(6):
        for r in range(6):
            inverse[i, r] = J[r, i]
            for c in range(i + 1):
                A[i, c] += J[r, i] * J[r, c]
        A[i, i] += damping
    cholesky_solve(A, inverse)
    for i in range(6):
        for c in range(7):
            for r in range(6):
                map_[dof + i, c] += inverse[i, r] * rhs[r, c]


@njit(cache=True)
def wrench_map(phys: Physics, k: int, M: Array, map_: Array, sole: Array, out: Array) -> None:
    """[W | w0] (6, 7): force and moment about the stance sole as a function of the base acceleration."""
    base = carray(stack_floats(42), (6, 7))
    base[:] = 0.0
    for i in range(6):
        base[i, 6] = phys.bias[k, i]
        for j in range(NV):
            m = M[i, j]
            if m != 0.0:
                for c in range(7):
                    base[i, c] += m * map_[j, c]
    R = phys.xmat[k, PELVIS]
    arm, force = carray(stack_floats(3), (3,)), carray(stack_floats(3), (3,))
    moment = carray(stack_floats(3), (3,))
    for i in range(3):
        arm[i] = phys.xpos[k, PELVIS, i] - sole[i]
    for c in range(7):
        for i in range(3):
            force[i] = base[i, c]
        cross_into(arm, force, moment)
        for i in range(3):
            out[i, c] = force[i]
            out[3 + i, c] = (
                moment[i] + R[3 * i] * base[3, c] + R[3 * i + 1] * base[4, c] + R[3 * i + 2] * base[5, c]
            )


@njit(cache=True)
def base_equations(W: Array, force: Array, alpha: Array, A: Array, b: Array) -> None:
    """Write A x = b for the base acceleration x: rows 0-2 the CoM's force, rows 3-5 the pelvis' turning."""
    A[:] = 0.0
    for i in range(3):
        for c in range(6):
            A[i, c] = W[i, c]
        A[3 + i, 3 + i] = 1.0
        b[i, 0] = force[i] - W[i, 6]
        b[3 + i, 0] = alpha[i]


@njit(cache=True)
def joint_torque(
    phys: Physics, k: int, M: Array, qdd: Array, foot: SoleMotion, dof: int, wrench: Array, out: Array
) -> None:
    """Tau = M qdd + h - J_s' w for the actuated rows, (14,)."""
    for i in range(NU):
        out[i] = phys.bias[k, 6 + i]
        for j in range(NV):
            out[i] += M[6 + i, j] * qdd[j]
    for i in range(6):
        for r in range(6):
            out[dof - 6 + i] -= foot.jacobian[r, i] * wrench[r]


@njit(cache=True)
def whole_body_torque(
    phys: Physics, k: int, task: Task, climb: float, gains: Gains, bounds: Bounds, index: Ints, torque: Array
) -> Array:
    """Write the joint torques (14,) [N m] of robot k; returns the wrench (6,) they ask of the stance sole.

    `climb` is the vertical velocity of its CoM [m/s].
    """
    M, map_ = carray(stack_floats(400), (NV, NV)), carray(stack_floats(140), (NV, 7))
    inverse, W = carray(stack_floats(36), (6, 6)), carray(stack_floats(42), (6, 7))
    A, b = carray(stack_floats(36), (6, 6)), carray(stack_floats(6), (6, 1))
    qdd, force = carray(stack_floats(20), (NV,)), carray(stack_floats(3), (3,))
    axes, arm = carray(stack_floats(4), (2, 2)), carray(stack_floats(3), (3,))
    dense_mass_matrix(phys, k, index, M)
    omega = base_angular_velocity(phys, k)
    stance = sole_motion(phys, k, task.stance, omega)
    swing = sole_motion(phys, k, 1 - task.stance, omega)
    map_[:] = 0.0  # qdd = map_ (x, 1)
    for i in range(3):
        map_[i, i] = 1.0
        for j in range(3):
            map_[3 + i, 3 + j] = phys.xmat[k, PELVIS, 3 * j + i]
    map_[WAIST_DOF, 6], map_[WAIST_DOF + 1, 6] = task.waist[0], task.waist[1]
    base = phys.xpos[k, PELVIS]
    stance_dof, swing_dof = LEG_DOF[task.stance], LEG_DOF[1 - task.stance]
    asked = stance_acceleration(phys, k, stance, task, gains)
    add_leg_rows(stance, asked, base, stance_dof, gains.damping, map_, inverse)
    asked = swing_acceleration(phys, k, swing, task, gains)
    add_leg_rows(swing, asked, base, swing_dof, gains.damping, map_, inverse)
    wrench_map(phys, k, M, map_, stance.position, W)

    mass = M[0, 0]
    height = phys.com[k, 0, 2] - stance.position[2]
    lift = gains.height_kp * (task.height - height) - gains.height_kd * climb
    force[0], force[1] = task.com_acceleration[0] * mass, task.com_acceleration[1] * mass
    force[2] = (GRAVITY + lift) * mass
    alpha = base_angular_acceleration(phys, k, omega, task, gains)
    base_equations(W, force, alpha, A, b)
    gauss_solve(A, b)
    qdd[:], wrench = map_[:, 6], W[:, 6].copy()
    for c in range(6):
        for j in range(NV):
            qdd[j] += map_[j, c] * b[c, 0]
        for i in range(6):
            wrench[i] += W[i, c] * b[c, 0]
    joint_torque(phys, k, M, qdd, stance, stance_dof, wrench, torque)

    R = phys.xmat[k, FOOT_BODY[task.stance]]
    norm = np.hypot(R[0], R[3])
    axes[0, 0], axes[0, 1] = R[0] / norm, R[3] / norm
    axes[1, 0], axes[1, 1] = -axes[0, 1], axes[0, 0]
    if not within_bounds(wrench, torque, axes, bounds):
        maps = TaskMaps(M, map_, W, inverse, stance.jacobian, stance_dof, swing_dof)
        for i in range(3):
            arm[i] = base[i] - stance.position[i]
        keep_bounds(maps, phys.xmat[k, PELVIS], arm, axes, bounds, wrench, torque)
    return wrench
