"""Whole-body control on two feet: the wrench that all tasks ask for, shared between both soles.

Both soles keep still, so that CoM, pelvis and waist determine all accelerations as they do on one foot, and
the base's rows of M qdd + h give the total wrench (F, M) about the stance sole. How it divides between the
soles is free. With r from the stance sole to the other, the total CoP p and, as long as no bound is met,

    lambda = p . r / |r|^2  within [0, most],     R = M - r x lambda F,
    w_other = lambda (F, R),     w_stance = (1 - lambda) (F, R):

the load goes with the CoP from foot to foot, both soles have the same force per load and the same CoP
p - lambda r, and no foot pulls against the other. The hull of two parallel soles is the sum of one of them
and the way between both, so that for every p within it some lambda keeps p - lambda r within the sole: the
nearest one is taken. A foot that is about to leave the floor has `most` of the load at most.

Each wrench has its own bounds of CoP, friction, yaw moment and load. Where one of them or a motor would pass
its bound, the least deviation is sought as on one foot (`limits.keep_bounds`), and six of its numbers, on one
foot those of the swing sole, are now what the other sole's wrench takes over from the stance sole's.
"""

from __future__ import annotations

from numba.np.numpy_support import carray

from .. import math3
from ..jit import njit
from ..math3 import Vector, add, cross, scaled, stack_floats, subtract, vector_at, vector_of
from ..qp import solve_least_distance
from . import inverse_dynamics as dynamics
from . import kinematics, limits
from .kinematics import (
    BASE,
    FOOT_BODY,
    NU,
    NV,
    PELVIS,
    PELVIS_TASK,
    SWING_TASK,
    TASKS,
    WAIST_DOF,
    Array,
    Heading,
    LegInverses,
    Legs,
    Physics,
)
from .limits import FORCE_UNIT, WRENCH_ROWS, Bounds, BoundSettings, clipped_cop_in_world, limits_met

SEARCH = 0.1  # speed at which a sole without load sinks [m/s]
INSIDE = 1.0 - 1e-9  # of a sole, where its edge is not yet passed
PARALLEL = 1e-6  # a sole that is no farther away along an axis is on the same line [m]

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


@njit(cache=True)
def foot_bears(wrench: Array, axis: Heading, bounds: Bounds) -> bool:
    """Whether a foot can give a wrench (6,), which may be none at all."""
    if wrench[2] <= 0.0:
        return wrench[2] == 0.0
    return limits.sole_bears(wrench, axis, bounds)


@njit(cache=True)
def share_of_other(cop: Heading, r: Vector, axis: Heading, s: BoundSettings) -> float:
    """The share of the load, for a total CoP and `r` [m], that keeps the CoP of both soles within them.

    `axis` points along the stance sole, which the other one is taken to be parallel to.
    """
    share = (cop[0] * r[0] + cop[1] * r[1]) / (r[0] * r[0] + r[1] * r[1])
    low, high = 0.0, 1.0
    for i in range(2):
        x, y = (axis[0], axis[1]) if i == 0 else (-axis[1], axis[0])
        half = (s.cop_x_max if i == 0 else s.cop_y_max) * INSIDE
        here, away = cop[0] * x + cop[1] * y, r[0] * x + r[1] * y
        if abs(away) > PARALLEL:
            ends = (here - half) / away, (here + half) / away
            low, high = max(low, min(ends)), min(high, max(ends))
    if low <= high:
        share = min(max(share, low), high)
    return min(max(share, 0.0), 1.0)


@njit(cache=True)
def share_wrench(
    wrench: Array, r: Vector, axis: Heading, s: BoundSettings, most: float, other: Array
) -> None:
    """Divide the total wrench (6,) about the stance sole, `r` [m] from the other one; both are written."""
    force, moment = vector_of(wrench, 0), vector_of(wrench, 3)
    share = 0.0
    if force[2] > 0.0:
        share = share_of_other((-moment[1] / force[2], moment[0] / force[2]), r, axis, s)
    share = min(share, most)
    rest = subtract(moment, scaled(cross(r, force), share))
    for i in range(3):
        other[i], other[3 + i] = share * force[i], share * rest[i]
        wrench[i], wrench[3 + i] = (1.0 - share) * force[i], (1.0 - share) * rest[i]


@njit(cache=True)
def write_standing_tasks(
    phys: Physics, k: int, task: dynamics.Task, gains: dynamics.Gains, inverses: LegInverses, qdd: Array
) -> tuple[Vector, Vector]:
    """`inverse_dynamics.write_tasks` with both soles still; returns the positions of the soles.

    A sole without load looks for the floor: it is to sink at SEARCH. The trunk has the acceleration asked for
    in the world, whatever the pelvis does: a pelvis that is turned upright again would otherwise take the
    trunk along, and that takes the CoP.
    """
    omega, base = kinematics.base_angular_velocity(phys, k), vector_at(phys.xpos, k, PELVIS)
    alpha = dynamics.base_angular_acceleration(phys, k, omega, task, gains)
    qdd[0], qdd[1], qdd[2] = math3.ZERO
    qdd[3], qdd[4], qdd[5] = math3.to_body(phys.xmat, k, PELVIS, alpha)
    cos, sin = task.facing
    qdd[WAIST_DOF] = task.waist[0] - (cos * alpha[1] - sin * alpha[0])
    qdd[WAIST_DOF + 1] = task.waist[1] - (cos * alpha[0] + sin * alpha[1])
    left, right = base, base
    for leg in range(2):
        foot = kinematics.sole_motion(phys, k, leg, omega)
        left, right = right, foot.position
        linear, angular = dynamics.stance_acceleration(phys, k, leg, foot, task.facing, gains)
        if phys.load[k, leg] == 0.0:
            linear = linear[0], linear[1], linear[2] - gains.stance_kd * SEARCH
        linear = subtract(linear, add(foot.drift, cross(alpha, subtract(foot.position, base))))
        angular = subtract(angular, add(foot.turn_drift, alpha))
        dynamics.write_leg_task(phys, k, leg, foot.position, linear, angular, gains, inverses, qdd)
    return left, right


@njit(cache=True)
def standing_torque(
    phys: Physics, k: int, task: dynamics.Task, climb: float, most: float, gains: dynamics.Gains,
    bounds: Bounds, wrench: Array, other: Array, torque: Array,
) -> int:  # fmt: skip
    """Write the joint torques (14,) [N m] of a robot on both feet, and the wrenches (6,) of both soles.

    Args:
        phys: of all robots.
        k: the robot.
        task: its tasks; those of the swing sole do not count.
        climb: vertical velocity of its CoM [m/s].
        most: share of the load that the other foot may have at most.
        gains: of the tasks.
        bounds: of `make_bounds` for two feet.
        wrench: of the stance sole, written.
        other: of the other sole, written.
        torque: written.

    Returns:
        The bounds met, as bits of `limits_met`.
    """
    qdd, total = carray(stack_floats(20), (NV,)), carray(stack_floats(20), (NV,))
    inverses = LegInverses(carray(stack_floats(36), (2, 6, 3)), carray(stack_floats(36), (2, 6, 3)))
    left, right = write_standing_tasks(phys, k, task, gains, inverses, qdd)
    sole, far = (left, right) if task.stance == 0 else (right, left)
    force = dynamics.com_force(phys, k, task, sole, climb, gains)
    rows = kinematics.com_compliance(phys, k, inverses)
    turning = kinematics.turning_momentum(phys, k, qdd)
    missing = subtract(force, add(math3.vector_in(phys.bias, k, 0), turning))
    dynamics.accelerate_pelvis(math3.rows_times(rows, missing), inverses, qdd)
    kinematics.write_generalised_force(phys, k, qdd, total)
    dynamics.write_wrench(phys, k, sole, total, wrench)
    near, away = FOOT_BODY[task.stance], FOOT_BODY[1 - task.stance]
    axes = dynamics.forward_axis(phys, k, near), dynamics.forward_axis(phys, k, away)
    share_wrench(wrench, subtract(far, sole), axes[0], bounds.settings, most, other)
    for i in range(NU):
        torque[i] = total[BASE + i]
    kinematics.subtract_leg_torques(phys, k, task.stance, sole, wrench, torque)
    kinematics.subtract_leg_torques(phys, k, 1 - task.stance, far, other, torque)
    limits.write_torque_range(phys, k, bounds.motors, bounds.torque_range)
    fine = foot_bears(wrench, axes[0], bounds) and foot_bears(other, axes[1], bounds)
    if fine and limits.motors_give(torque, bounds):
        return 0
    legs = Legs(task.stance, left, right, inverses, rows)
    return keep_bounds_of_both(phys, k, legs, task.facing, axes, most, bounds, wrench, other, torque)


@njit(cache=True)
def write_shared_maps(
    phys: Physics, k: int, legs: Legs, facing: Heading, stance: Array, other: Array, torque: Array
) -> None:
    """Write how both soles' wrenches (6, 14) and the torques (14, 14) follow the deviation.

    Its columns from SWING_TASK on are what the other sole's wrench takes over.
    """
    X = carray(stack_floats(280), (NV, TASKS))
    kinematics.write_rates(phys, k, legs, X)
    X[:, SWING_TASK : SWING_TASK + 6] = 0.0
    cos, sin = facing  # a pelvis that deviates does not take the trunk along
    X[WAIST_DOF, PELVIS_TASK], X[WAIST_DOF, PELVIS_TASK + 1] = sin, -cos
    X[WAIST_DOF + 1, PELVIS_TASK], X[WAIST_DOF + 1, PELVIS_TASK + 1] = -cos, -sin
    kinematics.accelerate_pelvis_for_tasks(phys, k, legs, X)
    sole, far = (legs.left, legs.right) if legs.stance == 0 else (legs.right, legs.left)
    kinematics.write_force_maps(phys, k, sole, X, stance, torque)
    other[:] = 0.0
    for i in range(6):
        other[i, SWING_TASK + i] = 1.0
    r = subtract(far, sole)
    for c in range(SWING_TASK, SWING_TASK + 6):
        moment = cross(r, (other[0, c], other[1, c], other[2, c]))
        for i in range(3):
            stance[i, c] -= other[i, c]
            stance[3 + i, c] -= other[3 + i, c] + moment[i]
    kinematics.subtract_leg_maps(phys, k, legs.stance, sole, stance, torque)
    kinematics.subtract_leg_maps(phys, k, 1 - legs.stance, far, other, torque)


@njit(cache=True)
def keep_bounds_of_both(
    phys: Physics, k: int, legs: Legs, facing: Heading, axes: tuple[Heading, Heading], most: float,
    bounds: Bounds, wrench: Array, other: Array, torque: Array,
) -> int:  # fmt: skip
    """Replace both wrenches (6,) and torque (14,) by those of the least deviation that keeps the bounds.

    Returns the bits of `limits_met` that they are at the bounds of.
    """
    Ws, Wo = carray(stack_floats(84), (6, TASKS)), carray(stack_floats(84), (6, TASKS))
    Td, load = carray(stack_floats(196), (NU, TASKS)), wrench[2] + other[2]
    write_shared_maps(phys, k, legs, facing, Ws, Wo, Td)
    limits.write_torque_problem(Td, bounds, torque)
    limits.write_wrench_problem(Ws, axes[0], bounds, wrench, NU)
    limits.write_wrench_problem(Wo, axes[1], bounds, other, NU + WRENCH_ROWS)
    if most < 1.0:
        bounds.lower[NU + 2 * WRENCH_ROWS - 1] = (other[2] - most * load) / FORCE_UNIT
    near = clipped_cop_in_world(wrench, axes[0], bounds.settings)
    far = clipped_cop_in_world(other, axes[1], bounds.settings)
    if solve_least_distance(bounds.handle) > 0:
        limits.deviate(Ws, bounds, wrench)
        limits.deviate(Wo, bounds, other)
        limits.deviate(Td, bounds, torque)
    met = limits_met(wrench, torque, axes[0], near, bounds)
    return met | limits_met(other, torque, axes[1], far, bounds)
