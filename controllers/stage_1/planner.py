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
from ..errors import InvalidValueError
from ..model.double_support import transfer_mean, transfer_weight
from ..model.gait_box import COP, DURATION, STEP, TRUNK, GaitLimits, unscaled
from ..model.nominal_gait import NOMINAL_DURATION, NOMINAL_STEP, nominal_gait_kernel
from ..model.observation import (
    COMMAND,
    DCM,
    ELAPSED,
    PREVIOUS_ACTION,
    PUSH_ESTIMATE,
    SWING_POSITION,
    TRUNK_ANGLE,
    TRUNK_RATE,
)
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from .capture_step import write_capture_step
from .columns import (
    ALPHA_DURATION,
    ALPHA_OFFSET,
    ALPHA_STEP,
    DCM_AHEAD,
    DCM_END,
    GAIN,
    HELD,
    NOMINAL,
    NOMINAL_OFFSET,
    OFFSET,
    OFFSET_NOMINAL,
    PROBLEM_SIZE,
    REMAINING,
    SHIFT,
    SOLUTION_SIZE,
    SOLVED_OFFSET,
    SOLVED_STEP,
    SOLVED_TAU,
    STATUS,
    STEP_HIGH,
    STEP_LOW,
    STEP_NOMINAL,
    TARGET,
    TAU_HIGH,
    TAU_LOW,
    TAU_NOMINAL,
)
from .constants import constants_of, pack_constants
from .step_problem import solve_step_kernel
from .swing_time import time_to_place

_DCM, _COMMAND, _ANGLE, _RATE = DCM.start, COMMAND.start, TRUNK_ANGLE.start, TRUNK_RATE.start
_PREVIOUS, _PUSH, _SWING = PREVIOUS_ACTION.start, PUSH_ESTIMATE.start, SWING_POSITION.start
LARGEST = 1e15  # of an observation's entries: far beyond any robot, and no square of a product overflows
LATEST = 300.0  # of omega times the time since the step began, for exp(omega t)
SWING_ROUNDS = 3  # a later step lies elsewhere, so the time it needs is found in rounds

Floats = NDArray[np.float64]


class StepPlanner:
    """Stage 1 of one robot, step box and configuration."""

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig, adapt: bool = True):
        """Pack the constants.

        Args:
            robot: physical constants.
            limits: step box and bound of the trunk acceleration.
            config: weights and margins.
            adapt: False gives the nominal gait, whatever the DCM.

        Raises:
            InvalidValueError: a pelvis wider than the step box, or a double support longer than the shortest
                step.
        """
        self._constants = pack_constants(robot, limits, config, adapt)
        self._box = limits.box
        self._latest = LATEST / robot.omega  # [s]

    def plan(self, observations: Floats, rows: Floats) -> None:
        """Write the plans of observations (n, 36) into rows (n, ROW_SIZE); see `columns`.

        Raises:
            InvalidValueError: an observation is not finite, or far too large to be a robot's.
        """
        if not plan_steps(observations, rows, self._constants, self._box):
            raise InvalidValueError(self._refusal(observations))

    def _refusal(self, observations: Floats) -> str:
        """Why there is no plan for all of the observations."""
        if not np.isfinite(observations).all():
            return "observation must be finite, got NaN or infinity"
        if (largest := np.abs(observations).max()) > LARGEST:
            return f"observation must lie within +-{LARGEST:g} in every entry, got {largest:g}"
        elapsed = observations[np.abs(observations[:, ELAPSED]).argmax(), ELAPSED]
        return f"an observation's elapsed time must lie within +-{self._latest:g} s, got {elapsed:g} s"


@njit(cache=True)
def stopping_debt(rate, gain, acceleration, omega):  # pragma: no cover
    """What the DCM still gets from stopping the trunk as fast as the torque can [m].

    Braking with -a for |rate| / a seconds moves the CMP by -gain a, in all, discounted to now,
    int omega exp(-omega s) gain a ds = gain a (1 - exp(-omega |rate| / a)), away from the lean's motion.
    Without a torque, about an axis that the waist lacks, there is no debt.
    """
    if acceleration <= 0.0:
        return 0.0
    return math.copysign(gain * acceleration * -math.expm1(-omega * abs(rate) / acceleration), rate)


@njit(cache=True)
def _wait_for_swing(obs, c, reach, tau_high, problem, solution):  # pragma: no cover
    """Solve again with the T that the swing foot needs for the place found, until it has enough."""
    for _ in range(SWING_ROUNDS):
        x, y = solution[SOLVED_STEP] / reach, solution[SOLVED_STEP + 1] / reach
        swing = time_to_place(obs, x, y, c.swing_acceleration)
        needed = math.exp(c.omega * (obs[ELAPSED] + swing))
        if solution[SOLVED_TAU] >= min(needed, tau_high):
            return
        problem[TAU_LOW] = min(needed, tau_high)
        solve_step_kernel(problem, solution)


@njit(cache=True)
def _write_problem(obs, c, low, high, nominal, row, problem):  # pragma: no cover
    """The problem of one observation, see `step_problem`; returns its upper bound of tau.

    tau may not lie before the present: tau >= exp(omega (t + margin)), and where even T_max has passed the
    upper bound gives way.
    """
    omega, elapsed, reach = c.omega, obs[ELAPSED], 1.0 - c.transfer
    scale = math.exp(omega * (c.touchdown_delay - elapsed))
    tau_low = math.exp(omega * max(low[DURATION], elapsed + c.duration_margin))
    tau_high = max(math.exp(omega * high[DURATION]), tau_low)
    problem[TAU_NOMINAL] = math.exp(omega * nominal[NOMINAL_DURATION])
    for axis in range(2):
        debt = stopping_debt(obs[_RATE + axis], c.trunk_gain, high[TRUNK + axis], omega)
        problem[GAIN + axis] = (row[DCM_AHEAD + axis] + debt - row[SHIFT + axis]) * scale
        step = nominal[NOMINAL_STEP + axis]
        problem[STEP_NOMINAL + axis] = reach * step
        problem[OFFSET_NOMINAL + axis] = row[NOMINAL_OFFSET + axis] + c.transfer * step
        problem[STEP_LOW + axis] = reach * (low[axis] if c.adapt_step > 0.0 else step)
        problem[STEP_HIGH + axis] = reach * (high[axis] if c.adapt_step > 0.0 else step)
    if c.adapt_duration == 0.0:
        tau_low = min(max(problem[TAU_NOMINAL], tau_low), tau_high)
        tau_high = tau_low
    problem[TAU_LOW], problem[TAU_HIGH] = tau_low, tau_high
    problem[ALPHA_STEP] = c.alpha_step / (reach * reach)
    problem[ALPHA_DURATION], problem[ALPHA_OFFSET] = c.alpha_duration, c.alpha_offset
    return tau_high


@njit(cache=True)
def _adapt(obs, c, low, high, nominal, row):  # pragma: no cover
    """Solve stage 1 for one observation: place and time of the step and its offset into `row`."""
    reach = 1.0 - c.transfer
    problem, solution = np.empty(PROBLEM_SIZE), np.empty(SOLUTION_SIZE)
    tau_high = _write_problem(obs, c, low, high, nominal, row, problem)
    solve_step_kernel(problem, solution)
    if c.swing_acceleration > 0.0:
        _wait_for_swing(obs, c, reach, tau_high, problem, solution)
    row[DURATION] = max(math.log(solution[SOLVED_TAU]) / c.omega, low[DURATION])
    for axis in range(2):
        row[STEP + axis] = min(max(solution[SOLVED_STEP + axis] / reach, low[axis]), high[axis])
        row[OFFSET + axis] = solution[SOLVED_OFFSET + axis] - c.transfer * row[STEP + axis]


@njit(cache=True)
def _previous_duration(obs, low, high):  # pragma: no cover
    """T that the previous action asks for [s]."""
    return unscaled(obs[_PREVIOUS + DURATION], low[DURATION], high[DURATION])


@njit(cache=True)
def _is_ending(obs, c, low, high):  # pragma: no cover
    """Whether too little of the previous action's step remains to plan it anew."""
    return c.freeze > 0.0 and _previous_duration(obs, low, high) - obs[ELAPSED] < c.freeze


@njit(cache=True)
def _hold(obs, c, low, high, row):  # pragma: no cover
    """Take place and time from the previous action."""
    duration = _previous_duration(obs, low, high)
    growth = math.exp(c.omega * (max(duration, obs[ELAPSED]) + c.touchdown_delay - obs[ELAPSED]))
    for i in range(DURATION + 1):
        row[i] = unscaled(obs[_PREVIOUS + i], low[i], high[i])
    for axis in range(2):
        row[OFFSET + axis] = (row[DCM_AHEAD + axis] - row[SHIFT + axis]) * growth - row[STEP + axis]


@njit(cache=True)
def plan_step(obs, c, low, high, row):  # pragma: no cover
    """Plan of one observation (36,) into `row` (ROW_SIZE,)."""
    adapt, push = c.adapt > 0.0, math.hypot(obs[_PUSH], obs[_PUSH + 1])
    carry = c.carry if push >= c.push_threshold else 0.0
    shift = transfer_weight(obs[ELAPSED], c.double_support, c.omega)
    share = transfer_mean(obs[ELAPSED], c.period, c.double_support, c.omega)
    for axis in range(2):
        row[DCM_AHEAD + axis] = obs[_DCM + axis] + carry * obs[_PUSH + axis]
        row[SHIFT + axis] = shift * obs[_SWING + axis] if shift > 0.0 else 0.0
        row[COP + axis] = share * obs[_SWING + axis] if shift > 0.0 else 0.0
    nominal = row[NOMINAL : NOMINAL_OFFSET + 2]
    nominal_gait_kernel(
        obs[_COMMAND], obs[_COMMAND + 1], c.pelvis_width, low, high, c.omega, c.touchdown_delay, nominal,
        c.double_support,
    )  # fmt: skip
    held = adapt and _is_ending(obs, c, low, high)
    if not adapt:
        row[STEP], row[STEP + 1] = nominal[NOMINAL_STEP], nominal[NOMINAL_STEP + 1]
        row[DURATION] = nominal[NOMINAL_DURATION]
        row[OFFSET], row[OFFSET + 1] = row[NOMINAL_OFFSET], row[NOMINAL_OFFSET + 1]
    elif not held or carry > 0.0:
        if c.capture_point > 0.0:
            write_capture_step(obs, c, low, high, nominal, row)
        else:
            _adapt(obs, c, low, high, nominal, row)
        # a push reopens an ending step for one that will not be held at once
        held = held and row[DURATION] - obs[ELAPSED] < c.freeze + 0.5 * c.period
    if held:
        _hold(obs, c, low, high, row)
    row[HELD], row[STATUS] = (1.0 if held else 0.0), 0.0
    row[REMAINING] = max(row[DURATION] - obs[ELAPSED], 0.0) + c.touchdown_delay
    for axis in range(2):
        row[TARGET + axis] = (
            row[STEP + axis]
            + row[NOMINAL_OFFSET + axis]
            + c.transfer * (nominal[NOMINAL_STEP + axis] - row[STEP + axis])
        )
        row[DCM_END + axis] = row[STEP + axis] + row[OFFSET + axis]
        lean = -c.upright_stiffness * obs[_ANGLE + axis] - c.upright_damping * obs[_RATE + axis]
        row[TRUNK + axis] = min(max(lean, low[TRUNK + axis]), high[TRUNK + axis])


@njit(cache=True)
def all_bounded(observations, latest):  # pragma: no cover
    """Whether all entries of observations (n, 36) lie within +-LARGEST, elapsed times within +-latest [s]."""
    bounded = True
    for i in range(observations.shape[0]):
        bounded = bounded and abs(observations[i, ELAPSED]) <= latest
        for j in range(observations.shape[1]):
            bounded = bounded and abs(observations[i, j]) <= LARGEST  # NaN is not
    return bounded


@njit(cache=True, nogil=True)
def plan_steps(observations, rows, constants, box):  # pragma: no cover
    """Plans (n, ROW_SIZE) of observations (n, 36); False, and no plan, where one is not `all_bounded`."""
    c, low, high = constants_of(constants), box[0], box[1]
    if not all_bounded(observations, LATEST / c.omega):
        return False
    for i in range(observations.shape[0]):
        plan_step(observations[i], c, low, high, rows[i])
    return True
