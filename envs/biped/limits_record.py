"""Which bounds a biped meets from the start of its first push on: when first, and for how long; compiled.

Gait machine and whole-body control say in bits, one a bound, what they meet in a physics step. The plan is
judged by what its planner could see: the observation and the box.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from ...controllers.array_table import COMMON, Floats1, Floats2, Ints1
from ...controllers.jit import njit
from ...controllers.model.gait_box import COP, DURATION, STEP, TRUNK, GaitLimits
from ...controllers.model.nominal_gait import both_stand
from ...controllers.model.observation import (
    ELAPSED,
    SWING_POSITION,
    TRUNK_ANGLE,
)
from ...controllers.model.robot import RobotModel
from ...controllers.settings import PlannerConfig
from ...controllers.stage_1 import time_to_place
from ...controllers.stage_2.problem import acceleration_interval
from ...controllers.whole_body.kinematics import Array
from ...controllers.whole_body.limits import (
    COP_EDGE,
    LIMIT_NAMES,
    STEP_LENGTH,
    STEP_TIME,
    STEP_WIDTH,
    TRUNK_LEAN,
    TRUNK_TORQUE,
)

# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false


OF_STEP = STEP_LENGTH | STEP_WIDTH | STEP_TIME
AT_BOUND = 1e-4  # [m]; actions are rounded to float32
AT_BOUND_TIME = 1e-3  # [s]; the planner finds the time that the swing foot needs in rounds
AT_BOUND_TORQUE = 1e-2  # [rad/s^2]
LEAN_SHARE = 0.95  # of the largest lean, from which it counts as met

_ANGLE, _SWING = TRUNK_ANGLE.start, SWING_POSITION.start


class PlanLimits(NamedTuple):
    """Limits that a plan may meet, the same for all robots."""

    length_min: float  # [m]
    length_max: float  # [m]
    width_min: float  # [m]
    width_max: float  # [m]
    duration_min: float  # [s]
    cop_x_max: float  # where the planner may put the CoP, both ways [m]
    cop_y_max: float  # [m]
    trunk_acceleration_max: float  # [rad/s^2]
    gravity: float  # gravity torque per sin(lean) over the trunk's inertia [rad/s^2]
    torque: float  # largest torque over the inertia [rad/s^2]
    lean: float  # from which it counts as met [rad]
    swing_acceleration: float  # bound of the swing foot's; 0: none [m/s^2]
    final: float  # time before T from which a step is final [s]
    double_support: float  # from touchdown on [s]


EDGES = len(PlanLimits._fields)


class LimitsRecord(NamedTuple):
    """Limits that n robots have met; the compiled loop writes the arrays."""

    first: Floats2  # (n, 12) when each bound was first met [s], inf: never
    span: Floats2  # (n, 12) for how long it was met [s]
    plan: Ints1  # (n,) bits of the plan in force
    landing: Ints1  # (n,) TOUCHDOWN_ERROR while the robot stands on a foot that landed off its plan
    edges: Annotated[Floats1, COMMON]  # (EDGES,) `PlanLimits`, common to all robots


class LimitsReport(NamedTuple):
    """The bounds that one robot has met, in the order in which it met them."""

    met: dict[str, float]  # bound -> first time, from the start of the first push on [s]
    shares: dict[str, float]  # bound -> share of the time since then


def plan_limits(robot: RobotModel, limits: GaitLimits, config: PlannerConfig, final: float) -> Array:
    """`PlanLimits` as an array (EDGES,); a step is final from `final` [s] before T on.

    A robot without a waist meets no bound of the trunk.
    """
    acceleration, gravity, torque, lean = np.inf, 0.0, np.inf, np.inf
    if robot.trunk_pitch or robot.trunk_roll:
        acceleration, gravity = limits.trunk_acceleration_max, config.trunk_gravity / robot.trunk_inertia
        torque, lean = robot.trunk_torque_max / robot.trunk_inertia, LEAN_SHARE * robot.trunk_angle_max
    return np.array(
        PlanLimits(
            length_min=limits.length_min,
            length_max=limits.length_max,
            width_min=limits.width_min,
            width_max=limits.width_max,
            duration_min=limits.duration_min,
            cop_x_max=limits.cop_x_max - config.cop_margin_x,
            cop_y_max=limits.cop_y_max - config.cop_margin_y,
            trunk_acceleration_max=acceleration,
            gravity=gravity,
            torque=torque,
            lean=lean,
            swing_acceleration=config.swing_acceleration,
            final=final,
            double_support=config.double_support,
        )
    )


def empty_record(n: int, edges: Array) -> LimitsRecord:
    """Make the record of n robots that have met nothing."""
    shape = n, len(LIMIT_NAMES)
    return LimitsRecord(
        np.full(shape, np.inf), np.zeros(shape), np.zeros(n, np.int64), np.zeros(n, np.int64), edges
    )


def clear_record(record: LimitsRecord, k: int) -> None:
    """Forget what robot k has met."""
    record.first[k], record.span[k], record.plan[k], record.landing[k] = np.inf, 0.0, 0, 0


def report_limits(record: LimitsRecord, k: int, start: float, end: float) -> LimitsReport:
    """Limits that robot k met from the start of its first push, inf: none came, to the end [s]."""
    order = sorted((first, i) for i, first in enumerate(record.first[k].tolist()) if first < np.inf)
    met = {LIMIT_NAMES[i]: first for first, i in order}
    shares = {LIMIT_NAMES[i]: min(record.span.item(k, i) / (end - start), 1.0) for _, i in order}
    return LimitsReport(met, shares)


@njit(cache=True, forceinline=True)
def plan_limits_met(observation: Array, plan: Array, before: int, edges: Array) -> int:
    """Bits that a plan (7,) meets which was made from an observation (36,); canonical frame.

    A step that is final keeps the bits of its last decision, `before`.
    """
    bounds = PlanLimits(*to_fixed_tuple(edges, EDGES))
    elapsed, bits = observation[ELAPSED], 0
    remaining, both = plan[DURATION] - elapsed, both_stand(elapsed, bounds.double_support)
    if remaining < bounds.final:
        bits = before & OF_STEP
    elif elapsed >= 0.0:
        length, width = plan[STEP], plan[STEP + 1]
        if length < bounds.length_min + AT_BOUND or length > bounds.length_max - AT_BOUND:
            bits |= STEP_LENGTH
        if width < bounds.width_min + AT_BOUND or width > bounds.width_max - AT_BOUND:
            bits |= STEP_WIDTH
        if plan[DURATION] < bounds.duration_min + AT_BOUND_TIME:
            bits |= STEP_TIME
        elif bounds.swing_acceleration > 0.0:
            swing = time_to_place(observation, length, width, bounds.swing_acceleration)
            left = plan[DURATION] - max(elapsed, bounds.double_support)
            bits |= STEP_TIME if left < swing + AT_BOUND_TIME else 0
    cop_max = bounds.cop_x_max, bounds.cop_y_max
    for axis in range(2):
        other = observation[_SWING + axis] if both else 0.0
        low, high = min(other, 0.0) - cop_max[axis], max(other, 0.0) + cop_max[axis]
        if not low + AT_BOUND <= plan[COP + axis] <= high - AT_BOUND:
            bits |= COP_EDGE
        angle, trunk = observation[_ANGLE + axis], plan[TRUNK + axis]
        low, high = acceleration_interval(angle, bounds.gravity, bounds.torque, bounds.trunk_acceleration_max)
        if trunk < low + AT_BOUND_TORQUE or trunk > high - AT_BOUND_TORQUE:
            bits |= TRUNK_TORQUE
        if abs(angle) > bounds.lean:
            bits |= TRUNK_LEAN
    return bits


@njit(cache=True, forceinline=True)
def note_limits(record: LimitsRecord, k: int, bits: int, starts: Array, now: float, dt: float) -> None:
    """Count bits for dt from now on [s], once the first of the pushes with `starts` [s] has begun."""
    if bits == 0:
        return
    start = starts[0]
    for i in range(1, starts.shape[0]):
        start = min(start, starts[i])
    if now + dt <= start + 1e-9:
        return
    for i in range(record.first.shape[1]):
        if (bits >> i) & 1:
            record.first[k, i] = min(record.first[k, i], max(now, start))
            record.span[k, i] += dt
