"""Which limits a biped meets from the start of its first push on: when first, and for how long; compiled.

Gait machine and whole-body control say in bits, one a limit, what they meet in a physics step. The plan is
judged by what its planner could see: the observation and the box.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...controllers.compiled.array_table import Floats1, Floats2, Ints1
from ...controllers.compiled.kernels import njit
from ...controllers.model.gait_box import GaitLimits
from ...controllers.model.observation import ELAPSED, TRUNK_ANGLE
from ...controllers.model.robot import RobotModel
from ...controllers.settings.planner_config import PlannerConfig
from ...controllers.stage_1.swing_time import time_to_place
from ...controllers.stage_2.kernel import acceleration_interval
from ...controllers.whole_body.bounds_met import (
    COP,
    LIMITS,
    STEP_LENGTH,
    STEP_TIME,
    STEP_WIDTH,
    TRUNK_LEAN,
    TRUNK_TORQUE,
)
from ...controllers.whole_body.kinematics import Array

OF_STEP = STEP_LENGTH | STEP_WIDTH | STEP_TIME
AT_BOUND = 1e-4  # [m]; actions are rounded to float32
AT_BOUND_TIME = 1e-3  # [s]; the planner finds the time that the swing foot needs in rounds
AT_BOUND_TORQUE = 1e-2  # [rad/s^2]
LEAN_SHARE = 0.95  # of the largest lean, from which it counts as met

_ANGLE = TRUNK_ANGLE.start


class LimitRecord(NamedTuple):
    """What n robots have met; the arrays are written by the compiled loop."""

    first: Floats2  # (n, 12) when each limit was first met [s], inf: never
    span: Floats2  # (n, 12) for how long it was met [s]
    plan: Ints1  # (n,) bits of the plan in force
    landing: Ints1  # (n,) TOUCHDOWN_ERROR while the robot stands on a foot that landed off its plan
    edges: Floats1  # (13,) bounds of the plan, common to all robots, see `plan_edges`


class LimitReport(NamedTuple):
    """The limits that one robot has met, in the order in which it met them."""

    met: dict[str, float]  # limit -> first time, from the start of the first push on [s]
    shares: dict[str, float]  # limit -> share of the time since then


def plan_edges(robot: RobotModel, limits: GaitLimits, config: PlannerConfig, final: float) -> Array:
    """Bounds that a plan may meet, (13,).

    Step length and width (low, high), T_min, CoP x, y, trunk: acceleration, gravity and torque over inertia,
    angle; acceleration of the swing foot, 0 for any; time before T from which a step is final, `final` [s].
    """
    inertia = robot.trunk_inertia
    return np.array(
        [limits.length_min, limits.length_max, limits.width_min, limits.width_max, limits.duration_min,
         limits.cop_x_max - config.cop_margin_x, limits.cop_y_max - config.cop_margin_y,
         limits.trunk_acceleration_max, config.trunk_gravity / inertia, robot.trunk_torque_max / inertia,
         LEAN_SHARE * robot.trunk_angle_max, config.swing_acceleration, final]
    )  # fmt: skip


def empty_record(n: int, edges: Array) -> LimitRecord:
    """Of n robots that have met nothing."""
    shape = n, len(LIMITS)
    return LimitRecord(
        np.full(shape, np.inf), np.zeros(shape), np.zeros(n, np.int64), np.zeros(n, np.int64), edges
    )


def clear_record(record: LimitRecord, k: int) -> None:
    """Forget what robot k has met."""
    record.first[k], record.span[k], record.plan[k], record.landing[k] = np.inf, 0.0, 0, 0


def report_limits(record: LimitRecord, k: int, start: float, end: float) -> LimitReport:
    """What robot k met between the start of its first push (inf: none came) and the end of its time [s]."""
    order = sorted((first, i) for i, first in enumerate(record.first[k].tolist()) if first < np.inf)
    met = {LIMITS[i]: first for first, i in order}
    shares = {LIMITS[i]: min(record.span.item(k, i) / (end - start), 1.0) for _, i in order}
    return LimitReport(met, shares)


@njit(cache=True, forceinline=True)
def plan_limits(observation: Array, plan: Array, before: int, edges: Array) -> int:
    """Bits that a plan (7,) meets which was made from an observation (36,); canonical frame.

    A step that is final keeps the bits of its last decision, `before`.
    """
    bits, remaining = 0, plan[2] - observation[ELAPSED]
    if remaining < edges[12]:
        bits = before & OF_STEP
    else:
        if plan[0] < edges[0] + AT_BOUND or plan[0] > edges[1] - AT_BOUND:
            bits |= STEP_LENGTH
        if plan[1] < edges[2] + AT_BOUND or plan[1] > edges[3] - AT_BOUND:
            bits |= STEP_WIDTH
        if plan[2] < edges[4] + AT_BOUND_TIME:
            bits |= STEP_TIME
        elif edges[11] > 0.0:
            swing = time_to_place(observation, plan[0], plan[1], edges[11])
            bits |= STEP_TIME if remaining < swing + AT_BOUND_TIME else 0
    for axis in range(2):
        if abs(plan[3 + axis]) > edges[5 + axis] - AT_BOUND:
            bits |= COP
        angle, trunk = observation[_ANGLE + axis], plan[5 + axis]
        low, high = acceleration_interval(angle, edges[8], edges[9], edges[7])
        if trunk < low + AT_BOUND_TORQUE or trunk > high - AT_BOUND_TORQUE:
            bits |= TRUNK_TORQUE
        if abs(angle) > edges[10]:
            bits |= TRUNK_LEAN
    return bits


@njit(cache=True, forceinline=True)
def note_limits(record: LimitRecord, k: int, bits: int, starts: Array, now: float, dt: float) -> None:
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
