"""Whole-body control on two feet: the wrench that all tasks ask for, shared between both soles.

Both soles keep still, so that CoM, pelvis and waist determine all accelerations as they do on one foot, and
the base's rows of M qdd + h give the total wrench (F, M) about the stance sole. How it divides between the
soles is free. With r from the stance sole to the other, the total CoP p and, as long as no bound is met,

    lambda = p . r / |r|^2  within [0, most],     R = M - r x lambda F,
    w_other = lambda (F, R),     w_stance = (1 - lambda) (F, R):

the load goes with the CoP from foot to foot, both soles have the same force per load and the same CoP, and no
foot pulls against the other. A foot that is about to leave the floor has `most` of the load at most.

Each wrench has its own bounds of CoP, friction, yaw moment and load. Where one of them or a motor would pass
its bound, the least deviation is sought as on one foot (`limits.keep_bounds`), and six of its numbers, on one
foot those of the swing sole, are now what the other sole's wrench takes over from the stance sole's.
"""

from __future__ import annotations

import math

import numpy as np
from numba.np.numpy_support import carray

from ..jit import njit
from ..math3 import (
    ZERO,
    Vector,
    add,
    cross,
    dot,
    rows_times,
    scaled,
    stack_floats,
    subtract,
    to_body,
    to_world,
    vector_at,
    vector_in,
    vector_of,
)
from ..qp import LeastDistance, solve_least_distance
from .inverse_dynamics import (
    Gains,
    Task,
    accelerate_pelvis,
    base_angular_acceleration,
    com_force,
    forward_axis,
    stance_acceleration,
    write_wrench,
)
from .kinematics import (
    BASE,
    FOOT_BODY,
    LEG_DOF,
    LEG_JOINT,
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
    accelerate_pelvis_for_tasks,
    base_angular_velocity,
    com_compliance,
    mass_times,
    sole_motion,
    subtract_leg_torques,
    turning_momentum,
    write_generalised_force,
    write_leg_inverse,
    write_rates,
)
from .limits import (
    FORCE_UNIT,
    FREE,
    TORQUE_UNIT,
    WRENCH_ROWS,
    Bounds,
    BoundSettings,
    centre_of_pressure,
    clipped_cop_in_world,
    limits_met,
    write_torque_range,
    write_wrench_rows,
)

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

ROWS_OF_TWO = NU + 2 * WRENCH_ROWS
SHARE_PRICE = 1e-4  # of (1 N)^2 or (1 N m)^2 that one foot takes over from the other


def make_two_feet_bounds(settings: BoundSettings, motors: Array) -> tuple[Bounds, LeastDistance]:
    """`limits.make_bounds` with the rows of two soles."""
    price = np.repeat(
        [settings.com_price, settings.height_price, settings.pelvis_price, settings.heading_price,
         SHARE_PRICE, settings.waist_price],
        [2, 1, 2, 1, 6, 2],
    )  # fmt: skip
    problem = LeastDistance(np.ones((ROWS_OF_TWO, TASKS)), np.full(ROWS_OF_TWO, settings.row_price))
    bounds = Bounds(
        settings, motors, np.zeros((2, NU)), 1.0 / np.sqrt(price), problem.handle, problem.M, problem.lower,
        problem.upper, problem.x, np.array([settings.friction]),
    )  # fmt: skip
    return bounds, problem


@njit(cache=True)
def sole_bears(wrench: Array, axis: Heading, bounds: Bounds) -> bool:
    """Whether a sole can give a wrench (6,): it presses, its CoP, friction and yaw moment are in range."""
    s = bounds.settings
    if wrench[2] <= 0.0:
        return wrench[2] == 0.0
    x, y = centre_of_pressure(wrench, axis)
    if abs(x) > s.cop_x_max or abs(y) > s.cop_y_max:
        return False
    x, y = clipped_cop_in_world(wrench, axis, s)
    if abs(wrench[5] - x * wrench[1] + y * wrench[0]) > s.yaw_friction * wrench[2]:
        return False
    return math.hypot(wrench[0], wrench[1]) <= bounds.grip[0] * wrench[2]


@njit(cache=True)
def share_wrench(wrench: Array, r: Vector, most: float, other: Array) -> None:
    """Divide the total wrench (6,) about the stance sole, `r` [m] from the other one; both are written."""
    force, moment = vector_of(wrench, 0), vector_of(wrench, 3)
    share = 0.0
    if force[2] > 0.0:
        share = (-moment[1] * r[0] + moment[0] * r[1]) / force[2] / (r[0] * r[0] + r[1] * r[1])
    share = min(max(share, 0.0), most)
    rest = subtract(moment, scaled(cross(r, force), share))
    for i in range(3):
        other[i], other[3 + i] = share * force[i], share * rest[i]
        wrench[i], wrench[3 + i] = (1.0 - share) * force[i], (1.0 - share) * rest[i]


@njit(cache=True)
def write_standing_tasks(
    phys: Physics, k: int, task: Task, gains: Gains, inverses: LegInverses, qdd: Array
) -> tuple[Vector, Vector]:
    """`inverse_dynamics.write_tasks` with both soles still; returns the positions of the soles.

    The trunk has the acceleration asked for in the world, whatever the pelvis does: a pelvis that is turned
    upright again would otherwise take the trunk along, and that takes the CoP.
    """
    omega, base = base_angular_velocity(phys, k), vector_at(phys.xpos, k, PELVIS)
    alpha = base_angular_acceleration(phys, k, omega, task, gains)
    qdd[0], qdd[1], qdd[2] = ZERO
    qdd[3], qdd[4], qdd[5] = to_body(phys.xmat, k, PELVIS, alpha)
    cos, sin = task.facing
    qdd[WAIST_DOF] = task.waist[0] - (cos * alpha[1] - sin * alpha[0])
    qdd[WAIST_DOF + 1] = task.waist[1] - (cos * alpha[0] + sin * alpha[1])
    left, right = base, base
    for leg in range(2):
        foot = sole_motion(phys, k, leg, omega)
        left, right = right, foot.position
        own = Task(
            leg, task.com_acceleration, task.height, task.facing, task.swing, task.waist, task.swing_yaw,
            task.pelvis_yaw, task.cop, task.missing,
        )  # fmt: skip
        linear, angular = stance_acceleration(phys, k, foot, own, gains)
        linear = subtract(linear, add(foot.drift, cross(alpha, subtract(foot.position, base))))
        angular = subtract(angular, add(foot.turn_drift, alpha))
        write_leg_inverse(phys, k, leg, foot.position, gains.damping, inverses)
        for i in range(6):
            rate = dot(vector_at(inverses.velocity, leg, i), linear)
            qdd[LEG_DOF[leg] + i] = rate + dot(vector_at(inverses.omega, leg, i), angular)
    return left, right


@njit(cache=True)
def standing_torque(
    phys: Physics, k: int, task: Task, climb: float, most: float, gains: Gains, bounds: Bounds,
    wrench: Array, other: Array, torque: Array,
) -> int:  # fmt: skip
    """Write the joint torques (14,) [N m] of a robot on both feet, and the wrenches (6,) of both soles.

    Args:
        phys: of all robots.
        k: the robot.
        task: its tasks; those of the swing sole do not count.
        climb: vertical velocity of its CoM [m/s].
        most: share of the load that the other foot may have at most.
        gains: of the tasks.
        bounds: of `make_two_feet_bounds`.
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
    force = com_force(phys, k, task, sole, climb, gains)
    rows = com_compliance(phys, k, inverses)
    missing = subtract(force, add(vector_in(phys.bias, k, 0), turning_momentum(phys, k, qdd)))
    accelerate_pelvis(rows_times(rows, missing), inverses, qdd)
    write_generalised_force(phys, k, qdd, total)
    write_wrench(phys, k, sole, total, wrench)
    share_wrench(wrench, subtract(far, sole), most, other)
    for i in range(NU):
        torque[i] = total[BASE + i]
    subtract_leg_torques(phys, k, task.stance, sole, wrench, torque)
    subtract_leg_torques(phys, k, 1 - task.stance, far, other, torque)
    write_torque_range(phys, k, bounds.motors, bounds.torque_range)
    axes = forward_axis(phys, k, FOOT_BODY[task.stance]), forward_axis(phys, k, FOOT_BODY[1 - task.stance])
    fine = sole_bears(wrench, axes[0], bounds) and sole_bears(other, axes[1], bounds)
    for i in range(NU):
        fine = fine and bounds.torque_range[0, i] <= torque[i] <= bounds.torque_range[1, i]
    if fine:
        return 0
    legs = Legs(task.stance, left, right, inverses, rows)
    return keep_bounds_of_both(phys, k, legs, task.facing, axes, most, bounds, wrench, other, torque)


@njit(cache=True)
def write_shared_maps(
    phys: Physics, k: int, legs: Legs, facing: Heading, stance: Array, torque: Array
) -> None:
    """Write how the stance sole's wrench (6, 14) and the torques (14, 14) follow the deviation.

    Its columns from SWING_TASK on are what the other sole's wrench takes over.
    """
    X, total = carray(stack_floats(280), (NV, TASKS)), carray(stack_floats(280), (NV, TASKS))
    write_rates(phys, k, legs, X)
    for j in range(NV):
        for c in range(6):
            X[j, SWING_TASK + c] = 0.0
    cos, sin = facing  # a pelvis that deviates does not take the trunk along
    X[WAIST_DOF, PELVIS_TASK], X[WAIST_DOF, PELVIS_TASK + 1] = sin, -cos
    X[WAIST_DOF + 1, PELVIS_TASK], X[WAIST_DOF + 1, PELVIS_TASK + 1] = -cos, -sin
    accelerate_pelvis_for_tasks(phys, k, legs, X)
    mass_times(phys, k, X, total)
    sole, far = (legs.left, legs.right) if legs.stance == 0 else (legs.right, legs.left)
    arm, r = subtract(vector_at(phys.xpos, k, PELVIS), sole), subtract(far, sole)
    for c in range(TASKS):
        force = total[0, c], total[1, c], total[2, c]
        moment = to_world(phys.xmat, k, PELVIS, (total[3, c], total[4, c], total[5, c]))
        moment = add(cross(arm, force), moment)
        taken = c - SWING_TASK
        if 0 <= taken < 3:
            unit = (-1.0 if taken == 0 else 0.0, -1.0 if taken == 1 else 0.0, -1.0 if taken == 2 else 0.0)
            force, moment = unit, cross(r, unit)
        elif 3 <= taken < 6:
            moment = (-1.0 if taken == 3 else 0.0, -1.0 if taken == 4 else 0.0, -1.0 if taken == 5 else 0.0)
        stance[0, c], stance[1, c], stance[2, c] = force
        stance[3, c], stance[4, c], stance[5, c] = moment
    for i in range(NU):
        for c in range(TASKS):
            torque[i, c] = total[BASE + i, c]
    for i in range(6):
        joint, row = LEG_JOINT[legs.stance] + i, LEG_DOF[legs.stance] - BASE + i
        axis = vector_at(phys.xaxis, k, joint)
        lever = cross(axis, subtract(sole, vector_at(phys.xanchor, k, joint)))
        for c in range(TASKS):
            for a in range(3):
                torque[row, c] -= lever[a] * stance[a, c] + axis[a] * stance[3 + a, c]
        joint, row = LEG_JOINT[1 - legs.stance] + i, LEG_DOF[1 - legs.stance] - BASE + i
        axis = vector_at(phys.xaxis, k, joint)
        lever = cross(axis, subtract(far, vector_at(phys.xanchor, k, joint)))
        for a in range(3):
            torque[row, SWING_TASK + a] -= lever[a]
            torque[row, SWING_TASK + 3 + a] -= axis[a]


@njit(cache=True)
def keep_bounds_of_both(
    phys: Physics, k: int, legs: Legs, facing: Heading, axes: tuple[Heading, Heading], most: float,
    bounds: Bounds, wrench: Array, other: Array, torque: Array,
) -> int:  # fmt: skip
    """Replace both wrenches (6,) and torque (14,) by those of the least deviation that keeps the bounds.

    Returns the bits of `limits_met` that they are at the bounds of.
    """
    Ws, Td = carray(stack_floats(84), (6, TASKS)), carray(stack_floats(196), (NU, TASKS))
    write_shared_maps(phys, k, legs, facing, Ws, Td)
    for i in range(NU):
        for c in range(TASKS):
            bounds.matrix[i, c] = Td[i, c] * bounds.scale[c] / TORQUE_UNIT
        bounds.lower[i] = (bounds.torque_range[0, i] - torque[i]) / TORQUE_UNIT
        bounds.upper[i] = (bounds.torque_range[1, i] - torque[i]) / TORQUE_UNIT
    P = carray(stack_floats(90), (WRENCH_ROWS, 6))
    load = wrench[2] + other[2]
    for foot in range(2):
        own, first = (wrench if foot == 0 else other), NU + foot * WRENCH_ROWS
        write_wrench_rows(own, axes[foot], bounds, P)
        for row in range(WRENCH_ROWS):
            value = 0.0
            for i in range(6):
                value += P[row, i] * own[i]
            for c in range(TASKS):
                total = 0.0
                if foot == 0:
                    for i in range(6):
                        total += P[row, i] * Ws[i, c]
                elif 0 <= c - SWING_TASK < 6:
                    total = P[row, c - SWING_TASK]
                bounds.matrix[first + row, c] = total * bounds.scale[c]
            bounds.lower[first + row], bounds.upper[first + row] = -FREE, -value
    bounds.lower[NU + 2 * WRENCH_ROWS - 1] = -(most * load - other[2]) / FORCE_UNIT if most < 1.0 else -FREE
    cops = (
        clipped_cop_in_world(wrench, axes[0], bounds.settings),
        clipped_cop_in_world(other, axes[1], bounds.settings),
    )
    if solve_least_distance(bounds.handle) > 0:
        for c in range(TASKS):
            d = bounds.scale[c] * bounds.solution[c]
            for i in range(6):
                wrench[i] += Ws[i, c] * d
            for i in range(NU):
                torque[i] += Td[i, c] * d
            if 0 <= c - SWING_TASK < 6:
                other[c - SWING_TASK] += d
    return limits_met(wrench, torque, axes[0], cops[0], bounds) | limits_met(
        other, torque, axes[1], cops[1], bounds
    )
