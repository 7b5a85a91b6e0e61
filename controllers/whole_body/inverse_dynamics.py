"""Whole-body control: exact inverse dynamics of the floating-base biped on one flat stance foot.

The accelerations of stance foot, swing foot, waist, pelvis and CoM determine all generalised accelerations,

    M(q) qdd + h(q, qd) = S' tau + J_s' w,      J_i qdd = a_i - Jdot_i qd   for both feet,

so nothing is left to optimise as long as no bound is met. Waist and turning of the pelvis are given. With the
linear acceleration a of the pelvis as the unknown, each leg follows as J_i^-1 (.. - a), and a from the CoM:
the first three rows of M qdd + h are the force m (acc + g) on it. The other rows give the moment at the sole
and the torques. The CoM obeys the pendulum, acc = omega^2 (com - cmp); the CoP absorbs the swing leg's
momentum, but for what `full_sole_force` keeps of it. Where a motor, the CoP, friction or the yaw moment would
pass its bound, `keep_bounds` finds the least deviation from the tasks that keeps it.

A function that runs every physics step is put into its caller (forceinline): the arrays of n robots are a few
hundred words, which a call would pass on and count the references of.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba.np.numpy_support import carray

from .. import math3
from ..jit import njit
from ..math3 import ZERO, Vector, add, cross, dot, scaled, stack_floats, subtract, vector_at, vector_of
from ..model.robot import GRAVITY
from . import kinematics, limits
from .kinematics import FOOT_BODY, LEG_DOF, NV, PELVIS, Array, Heading, LegInverses, Physics, upright_error

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


class Gains(NamedTuple):
    """Gains of the whole-body tasks, stiffness [1/s^2] and damping [1/s]."""

    stance_kp: float  # levels the stance foot
    stance_kd: float
    swing_kp: float  # sole position
    swing_kd: float
    swing_max: float  # bound of the acceleration asked of the swing sole [m/s^2]
    swing_turn_kp: float  # sole orientation
    swing_turn_kd: float
    pelvis_kp: float  # upright
    pelvis_kd: float
    heading_kp: float
    heading_kd: float
    height_kp: float  # CoM height
    height_kd: float
    damping: float  # of the leg inverse near a straight knee


class Task(NamedTuple):
    """Task of one robot for this physics step, in world axes."""

    stance: int  # 0 left, 1 right
    com_acceleration: tuple[float, float]  # [m/s^2]
    height: Vector  # of the CoM above the stance sole [m], its velocity, its acceleration
    facing: Heading  # cosine and sine of the heading, which the stance sole has
    swing: Array  # (9,) position, velocity, acceleration of the swing sole
    waist: tuple[float, float]  # acceleration of the waist's pitch and roll joints [rad/s^2]
    swing_yaw: Vector = ZERO  # of the swing sole beyond the heading [rad], its rate, its acceleration
    pelvis_yaw: Vector = ZERO  # the same of the pelvis
    cop: Heading = (0.0, 0.0)  # planned, along the heading and to the left, from the sole's centre [m]
    missing: Heading = (0.0, 0.0)  # how far the CMP should lie beyond the planned one [m]


@njit(cache=True, forceinline=True)
def stance_acceleration(
    phys: Physics, k: int, leg: int, foot: kinematics.SoleMotion, facing: Heading, gains: Gains
) -> tuple[Vector, Vector]:
    """Linear and angular acceleration that keep the sole of a leg still and level."""
    error = upright_error(phys.xmat, k, FOOT_BODY[leg], facing)
    level = gains.stance_kp * error[0], gains.stance_kp * error[1], 0.0
    return scaled(foot.velocity, -gains.stance_kd), subtract(level, scaled(foot.omega, gains.stance_kd))


@njit(cache=True, forceinline=True)
def swing_acceleration(
    phys: Physics, k: int, foot: kinematics.SoleMotion, task: Task, gains: Gains
) -> tuple[Vector, Vector]:
    """Linear and angular acceleration that follow the swing reference, sole level and at its yaw."""
    error = subtract(vector_of(task.swing, 0), foot.position)
    rate = subtract(vector_of(task.swing, 3), foot.velocity)
    asked = add(vector_of(task.swing, 6), add(scaled(error, gains.swing_kp), scaled(rate, gains.swing_kd)))
    size = math.sqrt(asked[0] ** 2 + asked[1] ** 2)
    if size > gains.swing_max:
        asked = asked[0] * gains.swing_max / size, asked[1] * gains.swing_max / size, asked[2]
    yaw, pace, turn = task.swing_yaw
    error = add(upright_error(phys.xmat, k, FOOT_BODY[1 - task.stance], task.facing), (0.0, 0.0, yaw))
    omega = subtract(foot.omega, (0.0, 0.0, pace))
    level = subtract(scaled(error, gains.swing_turn_kp), scaled(omega, gains.swing_turn_kd))
    return asked, add(level, (0.0, 0.0, turn))


@njit(cache=True, forceinline=True)
def base_angular_acceleration(phys: Physics, k: int, omega: Vector, task: Task, gains: Gains) -> Vector:
    """Angular acceleration that keeps the pelvis upright and at its yaw."""
    yaw, rate, turn = task.pelvis_yaw
    x, y, z = upright_error(phys.xmat, k, PELVIS, task.facing)
    return (
        gains.pelvis_kp * x - gains.pelvis_kd * omega[0],
        gains.pelvis_kp * y - gains.pelvis_kd * omega[1],
        gains.heading_kp * (z + yaw) - gains.heading_kd * (omega[2] - rate) + turn,
    )


@njit(cache=True, forceinline=True)
def com_force(phys: Physics, k: int, task: Task, sole: Vector, climb: float, gains: Gains) -> Vector:
    """Force on the CoM, m (acceleration + g) [N]."""
    mass, height = phys.mass_matrix[k, 0], phys.com[k, 0, 2] - sole[2]
    asked, rate, lift = task.height
    lift += gains.height_kp * (asked - height) + gains.height_kd * (rate - climb)
    return task.com_acceleration[0] * mass, task.com_acceleration[1] * mass, (GRAVITY + lift) * mass


@njit(cache=True, forceinline=True)
def write_leg_task(
    phys: Physics, k: int, leg: int, sole: Vector, linear: Vector, angular: Vector, gains: Gains,
    inverses: LegInverses, qdd: Array,
) -> None:  # fmt: skip
    """Write a leg's inverse, and its part of qdd (20,) from its sole's acceleration seen by the pelvis."""
    kinematics.write_leg_inverse(phys, k, leg, sole, gains.damping, inverses)
    for i in range(6):
        rate = dot(vector_at(inverses.velocity, leg, i), linear)
        qdd[LEG_DOF[leg] + i] = rate + dot(vector_at(inverses.omega, leg, i), angular)


@njit(cache=True, forceinline=True)
def write_tasks(
    phys: Physics, k: int, task: Task, gains: Gains, inverses: LegInverses, qdd: Array
) -> tuple[Vector, Vector]:
    """Write qdd (20,) of all tasks but the CoM's, the pelvis turning in place, and the legs' inverses.

    Returns the positions of the left and the right sole.
    """
    omega, base = kinematics.base_angular_velocity(phys, k), vector_at(phys.xpos, k, PELVIS)
    alpha = base_angular_acceleration(phys, k, omega, task, gains)
    qdd[0], qdd[1], qdd[2] = ZERO
    qdd[3], qdd[4], qdd[5] = math3.to_body(phys.xmat, k, PELVIS, alpha)
    qdd[kinematics.WAIST_DOF], qdd[kinematics.WAIST_DOF + 1] = task.waist[0], task.waist[1]
    left, right = base, base
    for leg in range(2):
        foot = kinematics.sole_motion(phys, k, leg, omega)
        left, right = right, foot.position
        if leg == task.stance:
            linear, angular = stance_acceleration(phys, k, leg, foot, task.facing, gains)
        else:
            linear, angular = swing_acceleration(phys, k, foot, task, gains)
        carried = cross(alpha, subtract(foot.position, base))
        linear = subtract(linear, add(foot.drift, carried))
        angular = subtract(angular, add(foot.turn_drift, alpha))
        write_leg_task(phys, k, leg, foot.position, linear, angular, gains, inverses, qdd)
    return left, right


@njit(cache=True, forceinline=True)
def accelerate_pelvis(a: Vector, inverses: LegInverses, qdd: Array) -> None:
    """Add the acceleration a of the pelvis, the soles keeping theirs: qdd_leg -= J^-1 (a, 0)."""
    for i in range(3):
        qdd[i] += a[i]
    for leg in range(2):
        for i in range(6):
            qdd[LEG_DOF[leg] + i] -= dot(vector_at(inverses.velocity, leg, i), a)


@njit(cache=True, forceinline=True)
def write_wrench(phys: Physics, k: int, sole: Vector, total: Array, wrench: Array) -> None:
    """Write the wrench (6,) at the stance sole that the base's rows of M qdd + h, total (20,), ask for."""
    force, arm = vector_of(total, 0), subtract(vector_at(phys.xpos, k, PELVIS), sole)
    moment = add(cross(arm, force), math3.to_world(phys.xmat, k, PELVIS, vector_of(total, 3)))
    for i in range(3):
        wrench[i], wrench[3 + i] = force[i], moment[i]


@njit(cache=True, forceinline=True)
def forward_axis(phys: Physics, k: int, body: int) -> Heading:
    """Horizontal direction of a body's x axis."""
    x, y = phys.xmat[k, body, 0], phys.xmat[k, body, 3]
    norm = math.sqrt(x * x + y * y)
    return x / norm, y / norm


@njit(cache=True, forceinline=True)
def whole_body_torque(
    phys: Physics, k: int, task: Task, climb: float, gains: Gains, bounds: limits.Bounds, wrench: Array,
    torque: Array,
) -> int:  # fmt: skip
    """Write the joint torques (14,) [N m] of robot k and the wrench (6,) they ask of the stance sole.

    `climb` is the vertical velocity of its CoM [m/s]. Returns the bounds met, as bits of `limits_met`.
    """
    qdd, total = carray(stack_floats(20), (NV,)), carray(stack_floats(20), (NV,))
    inverses = LegInverses(carray(stack_floats(36), (2, 6, 3)), carray(stack_floats(36), (2, 6, 3)))
    left, right = write_tasks(phys, k, task, gains, inverses, qdd)
    sole = left if task.stance == 0 else right
    force = com_force(phys, k, task, sole, climb, gains)
    rows = kinematics.com_compliance(phys, k, inverses)
    axis = forward_axis(phys, k, FOOT_BODY[task.stance])
    turning = kinematics.turning_momentum(phys, k, qdd)
    missing = subtract(force, add(math3.vector_in(phys.bias, k, 0), turning))
    for turn in range(2):  # once more where the CoP shall stay at the edge
        accelerate_pelvis(math3.rows_times(rows, missing), inverses, qdd)
        kinematics.write_generalised_force(phys, k, qdd, total)
        write_wrench(phys, k, sole, total, wrench)
        if turn == 1:
            break
        height = phys.com[k, 0, 2] - sole[2]
        more = limits.full_sole_force(wrench, axis, task.cop, task.missing, height, bounds)
        if more[0] == 0.0 and more[1] == 0.0:
            break
        missing = more[0], more[1], 0.0
    for i in range(kinematics.NU):
        torque[i] = total[kinematics.BASE + i]
    kinematics.subtract_leg_torques(phys, k, task.stance, sole, wrench, torque)
    limits.write_torque_range(phys, k, bounds.motors, bounds.torque_range)
    if limits.within_bounds(wrench, torque, axis, bounds):
        return 0
    legs = kinematics.Legs(task.stance, left, right, inverses, rows)
    return limits.keep_bounds(phys, k, legs, axis, bounds, wrench, torque)
