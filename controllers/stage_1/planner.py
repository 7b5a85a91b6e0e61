"""From observations to stage 1 plans: one compiled pass, the hot path of every policy.

With double support the CoP's transfer from the old foot to the new one, p kappa(t), is taken off the DCM, and
the foot acts as if it stood at u (1 - c), c = kappa(0): what the next step grows from is not b but b + c u.
Stage 1 solves for these, which keeps it as linear as before. Aiming at b_nom itself would multiply every
error of the step's place by exp(omega T) c from step to step, 1.5 with the paper's 0.55 s + 0.1 s.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..model.double_support import check_double_support, cop_range, transfer_mean, transfer_weight
from ..model.gait_box import GAIT_SIZE, GaitLimits, unscaled
from ..model.nominal_gait import check_pelvis, nominal_gait_kernel
from ..model.observation import (
    COMMAND,
    DCM,
    ELAPSED,
    PREVIOUS_ACTION,
    PUSH_ESTIMATE,
    SWING_POSITION,
    SWING_VELOCITY,
    TRUNK_ANGLE,
    TRUNK_RATE,
)
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from .step_problem import PROBLEM_SIZE, SOLUTION_SIZE, solve_step_kernel

# Columns of a stage 1 row (ROW_SIZE,)
GAIT = slice(0, 7)  # L, W, T, CoP of the undisturbed step, trunk acceleration of the upright law
OFFSET = slice(7, 9)  # b of the plan [m]
NOMINAL = slice(9, 14)  # L, W, T, b_x, b_y
TARGET = slice(14, 16)  # xi_des = u_T + b_nom (eq. 7), with double support + c (u_nom - u_T) [m]
REMAINING = 16  # until the new foot carries load [s], >= 0
HELD = 17  # 1 where the plan is the previous one
DCM_AHEAD = slice(18, 20)  # measured DCM with what the push will still add [m]
SHIFT = slice(20, 22)  # p kappa(t): what the CoP's transfer in double support takes off the DCM [m]
ROW_SIZE = 22

_T0, _T1 = ELAPSED, PREVIOUS_ACTION.start + 2
_DCM, _COMMAND, _ANGLE, _RATE = DCM.start, COMMAND.start, TRUNK_ANGLE.start, TRUNK_RATE.start
_PREVIOUS, _PUSH = PREVIOUS_ACTION.start, PUSH_ESTIMATE.start
_SWING, _SPEED = SWING_POSITION.start, SWING_VELOCITY.start
SWING_ROUNDS = 3  # a later step lies elsewhere, so the time it needs is found in rounds


def stage_1_constants(robot: RobotModel, limits: GaitLimits, config: PlannerConfig) -> NDArray[np.float64]:
    """Pack what `stage_1_row` needs, (20,).

    omega, l_p, weights, switches, margins, trunk laws, push, double support, control period, c,
    acceleration of the swing foot.
    """
    check_pelvis(robot, limits)
    check_double_support(config.double_support, limits)
    return np.array(
        [robot.omega, robot.pelvis_width, config.alpha_step, config.alpha_duration, config.alpha_offset,
         float(config.adapt_step), float(config.adapt_duration), config.duration_margin, config.freeze,
         config.touchdown_delay, config.upright_stiffness, config.upright_damping,
         -math.expm1(-robot.omega * config.push_carry), robot.cmp_per_trunk_acceleration * config.trunk_debt,
         limits.trunk_acceleration_max, config.push_threshold, config.double_support,
         config.first_interval_min, transfer_weight(0.0, config.double_support, robot.omega),
         config.swing_acceleration]
    )  # fmt: skip


@njit(cache=True)
def stopping_debt(rate, gain, acceleration, omega):  # pragma: no cover
    """What the DCM still gets from stopping the trunk as fast as the torque can [m].

    Braking with -a for |rate| / a seconds moves the CMP by -gain a, in all, discounted to now,
    int omega exp(-omega s) gain a ds = gain a (1 - exp(-omega |rate| / a)), away from the lean's motion.
    """
    return math.copysign(gain * acceleration * -math.expm1(-omega * abs(rate) / acceleration), rate)


@njit(cache=True)
def swing_time(distance, speed, acceleration):  # pragma: no cover
    """Time [s] in which a foot with a speed [m/s] towards its target can come to rest there.

    Accelerating and braking with a: (2 sqrt(a d + v^2 / 2) - v) / a. With a = 4 sqrt(3) / 10 of the bound
    it is the time of the rest-to-rest quintic whose peak acceleration, 10 d / (sqrt(3) t^2), is that bound,
    and half-way along it, too, to 0.1 %.
    """
    a = 0.4 * math.sqrt(3.0) * acceleration
    return max((2.0 * math.sqrt(a * distance + 0.5 * speed * speed) - speed) / a, 0.0)


@njit(cache=True)
def time_to_place(obs, x, y, acceleration):  # pragma: no cover
    """`swing_time` [s] of the observed swing foot to (x, y), canonical frame [m]."""
    dx, dy = x - obs[_SWING], y - obs[_SWING + 1]
    distance = math.hypot(dx, dy)
    speed = (dx * obs[_SPEED] + dy * obs[_SPEED + 1]) / max(distance, 1e-9)
    return swing_time(distance, speed, acceleration)


@njit(cache=True)
def _wait_for_swing(obs, c, reach, tau_high, problem, solution):  # pragma: no cover
    """Solve again with the T that the swing foot needs for the place found, until it has enough."""
    for _ in range(SWING_ROUNDS):
        swing = time_to_place(obs, solution[0] / reach, solution[1] / reach, c[19])
        needed = math.exp(c[0] * (obs[_T0] + swing))
        if solution[2] >= min(needed, tau_high):
            return
        problem[11] = min(needed, tau_high)
        solve_step_kernel(problem, solution)


@njit(cache=True)
def _adapt(obs, c, low, high, nominal, row):  # pragma: no cover
    """Solve stage 1 for one observation: gait and offset into `row`.

    tau may not lie before the present: tau >= exp(omega (t + margin)), and where even T_max has passed the
    upper bound gives way.
    """
    omega, elapsed, reach = c[0], obs[_T0], 1.0 - c[18]
    problem, solution = np.empty(PROBLEM_SIZE), np.empty(SOLUTION_SIZE)
    scale = math.exp(omega * (c[9] - elapsed))
    tau_low = math.exp(omega * max(low[2], elapsed + c[7]))
    tau_high = max(math.exp(omega * high[2]), tau_low)
    problem[4] = math.exp(omega * nominal[2])
    for axis in range(2):
        debt = stopping_debt(obs[_RATE + axis], c[13], c[14], omega)
        problem[axis] = (row[18 + axis] + debt - row[20 + axis]) * scale
        problem[2 + axis] = reach * nominal[axis]
        problem[5 + axis] = nominal[3 + axis] + c[18] * nominal[axis]
        problem[7 + axis] = reach * (low[axis] if c[5] > 0.0 else nominal[axis])
        problem[9 + axis] = reach * (high[axis] if c[5] > 0.0 else nominal[axis])
    if c[6] == 0.0:
        tau_low = min(max(problem[4], tau_low), tau_high)
        tau_high = tau_low
    problem[11], problem[12] = tau_low, tau_high
    problem[13], problem[14], problem[15] = c[2] / (reach * reach), c[3], c[4]
    solve_step_kernel(problem, solution)
    if c[19] > 0.0:
        _wait_for_swing(obs, c, reach, tau_high, problem, solution)
    row[2] = max(math.log(solution[2]) / omega, low[2])
    for axis in range(2):
        row[axis] = min(max(solution[axis] / reach, low[axis]), high[axis])
        row[7 + axis] = solution[3 + axis] - c[18] * row[axis]


@njit(cache=True)
def _is_ending(obs, c, low, high):  # pragma: no cover
    """Whether too little of the previous action's step remains to plan it anew."""
    return c[8] > 0.0 and unscaled(obs[_T1], low[2], high[2]) - obs[_T0] < c[8]


@njit(cache=True)
def _hold(obs, c, low, high, row):  # pragma: no cover
    """Take place and time from the previous action."""
    duration = unscaled(obs[_T1], low[2], high[2])
    growth = math.exp(c[0] * (max(duration, obs[_T0]) + c[9] - obs[_T0]))
    for i in range(3):
        row[i] = unscaled(obs[_PREVIOUS + i], low[i], high[i])
    for axis in range(2):
        row[7 + axis] = (row[18 + axis] - row[20 + axis]) * growth - row[axis]


@njit(cache=True)
def stage_1_row(obs, c, low, high, adapt, row):  # pragma: no cover
    """Plan of one observation (36,) into `row` (ROW_SIZE,); `adapt` False gives the nominal gait."""
    carry = c[12] if math.hypot(obs[_PUSH], obs[_PUSH + 1]) >= c[15] else 0.0
    shift, share = transfer_weight(obs[_T0], c[16], c[0]), transfer_mean(obs[_T0], c[17], c[16], c[0])
    for axis in range(2):
        row[18 + axis] = obs[_DCM + axis] + carry * obs[_PUSH + axis]
        row[20 + axis] = shift * obs[_SWING + axis] if shift > 0.0 else 0.0
        row[3 + axis] = share * obs[_SWING + axis] if shift > 0.0 else 0.0
    nominal = row[9:14]
    nominal_gait_kernel(obs[_COMMAND], obs[_COMMAND + 1], c[1], low, high, c[0], c[9], nominal, c[16])
    held = adapt and _is_ending(obs, c, low, high)
    if not adapt:
        row[0], row[1], row[2], row[7], row[8] = nominal[0], nominal[1], nominal[2], nominal[3], nominal[4]
    elif not held or carry > 0.0:
        _adapt(obs, c, low, high, nominal, row)
        # a push reopens an ending step for one that will not be held at once
        held = held and row[2] - obs[_T0] < c[8] + 0.5 * c[17]
    if held:
        _hold(obs, c, low, high, row)
    row[17] = 1.0 if held else 0.0
    row[16] = max(row[2] - obs[_T0], 0.0) + c[9]
    for axis in range(2):
        row[14 + axis] = row[axis] + nominal[3 + axis] + c[18] * (nominal[axis] - row[axis])
        lean = -c[10] * obs[_ANGLE + axis] - c[11] * obs[_RATE + axis]
        row[5 + axis] = min(max(lean, low[5 + axis]), high[5 + axis])


@njit(cache=True)
def all_finite(observations):  # pragma: no cover
    """Whether every entry of observations (n, 36) is finite."""
    finite = True
    for i in range(observations.shape[0]):
        for j in range(observations.shape[1]):
            finite = finite and math.isfinite(observations[i, j])
    return finite


@njit(cache=True)
def stage_1_rows(observations, c, low, high, adapt):  # pragma: no cover
    """Plans (n, ROW_SIZE) of observations (n, 36), and whether every observation is finite."""
    rows = np.empty((observations.shape[0], ROW_SIZE))
    finite = all_finite(observations)
    if finite:
        for i in range(observations.shape[0]):
            stage_1_row(observations[i], c, low, high, adapt, rows[i])
    return rows, finite


@njit(cache=True)
def scale_action(row, obs, low, high, double_support, action):  # pragma: no cover
    """The gait columns of `row` as a float32 action (7,); the arithmetic of `GaitLimits.to_action`.

    The CoP is scaled from what it may be at the observation, see `cop_range`.
    """
    for j in range(GAIT_SIZE):
        bottom, top = low[j], high[j]
        if j == 3 or j == 4:
            bottom, top = cop_range(j - 3, obs, low, high, double_support)
        scaled = 2.0 * (row[j] - bottom) / (top - bottom) - 1.0
        action[j] = min(max(scaled, -1.0), 1.0)


@njit(cache=True)
def scale_actions(rows, observations, low, high, double_support):  # pragma: no cover
    """`scale_action` of every row (n, ROW_SIZE), (n, 7)."""
    actions = np.empty((rows.shape[0], GAIT_SIZE), dtype=np.float32)
    for i in range(rows.shape[0]):
        scale_action(rows[i], observations[i], low, high, double_support, actions[i])
    return actions
