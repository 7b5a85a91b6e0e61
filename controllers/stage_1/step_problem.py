"""Stage 1 (eq. 3): next foothold, step duration and DCM offset from the measured DCM, solved exactly.

With tau = exp(omega T) and a = (xi - u_0) exp(omega (delay - t)), in the canonical frame (u_0 = 0):

    min   alpha_1 |u - u_nom|^2 + alpha_2 (tau - tau_nom)^2 + alpha_3 |b - b_nom|^2
    s.t.  u + b = a tau,    u_min <= u <= u_max,    tau_min <= tau <= tau_max.

The equality removes b. For a given tau each coordinate of u is an affine function of tau clipped to its
bounds, so what is left is a convex, piecewise quadratic function of tau alone: its derivative is continuous,
piecewise linear and changes slope at no more than four breakpoints. The root is found between two of them in
closed form; there is no iteration and no tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..errors import InvalidValueError
from .columns import (
    ALPHA_DURATION,
    ALPHA_OFFSET,
    ALPHA_STEP,
    GAIN,
    OFFSET_NOMINAL,
    SOLUTION_SIZE,
    SOLVED_OFFSET,
    SOLVED_STEP,
    SOLVED_TAU,
    STEP_HIGH,
    STEP_LOW,
    STEP_NOMINAL,
    TAU_HIGH,
    TAU_LOW,
    TAU_NOMINAL,
)

KNOTS = 6  # both ends of the range of tau, and up to four places between


@dataclass(frozen=True)
class StepProblem:
    """Data of one stage 1 problem, canonical frame; pairs are (x, y)."""

    gain: tuple[float, float]  # a = xi exp(omega (delay - t)) [m]
    step_nominal: tuple[float, float]  # (L_nom, W_nom) [m]
    tau_nominal: float  # exp(omega T_nom)
    offset_nominal: tuple[float, float]  # [m]
    step_low: tuple[float, float]  # [m]
    step_high: tuple[float, float]  # [m]
    tau_low: float
    tau_high: float
    alpha_step: float = 1.0  # [1/m^2]
    alpha_duration: float = 1.0
    alpha_offset: float = 1e6  # [1/m^2]

    def __post_init__(self) -> None:
        values = self.pack()
        if not np.isfinite(values).all():
            raise InvalidValueError(f"every entry of a StepProblem must be finite, got {self}")
        if not all(low <= high for low, high in zip(self.step_low, self.step_high, strict=True)):
            raise InvalidValueError(f"step_low must be <= step_high, got {self.step_low} > {self.step_high}")
        if not 0 < self.tau_low <= self.tau_high:
            raise InvalidValueError(f"need 0 < tau_low <= tau_high, got {self.tau_low}, {self.tau_high}")
        if min(self.alpha_step, self.alpha_duration, self.alpha_offset) < 0:
            raise InvalidValueError(
                f"weights must be >= 0, got {self.alpha_step, self.alpha_duration, self.alpha_offset}"
            )

    def pack(self) -> NDArray[np.float64]:
        """The problem as one vector (16,), see `columns`."""
        return np.array(
            [*self.gain, *self.step_nominal, self.tau_nominal, *self.offset_nominal, *self.step_low,
             *self.step_high, self.tau_low, self.tau_high, self.alpha_step, self.alpha_duration,
             self.alpha_offset]
        )  # fmt: skip


@dataclass(frozen=True)
class StepPlan:
    """Solution of stage 1, canonical frame."""

    step: tuple[float, float]  # u_T: length, width [m]
    tau: float  # exp(omega T)
    offset: tuple[float, float]  # b [m]

    def duration(self, omega: float) -> float:
        """T = log(tau) / omega [s]."""
        return math.log(self.tau) / omega


@njit(cache=True)
def _best_step(p, axis, tau):  # pragma: no cover
    """Foothold along one axis that is best for a given tau [m]."""
    free, step_weight, offset_weight = p[STEP_NOMINAL + axis], p[ALPHA_STEP], p[ALPHA_OFFSET]
    if offset_weight > 0.0:
        exact = p[GAIN + axis] * tau - p[OFFSET_NOMINAL + axis]  # ends with the nominal offset
        free = (step_weight * free + offset_weight * exact) / (step_weight + offset_weight)
    return min(max(free, p[STEP_LOW + axis]), p[STEP_HIGH + axis])


@njit(cache=True)
def _half_slope(p, tau):  # pragma: no cover
    """Half the derivative of the reduced cost with respect to tau."""
    slope = p[ALPHA_DURATION] * (tau - p[TAU_NOMINAL])
    for axis in range(2):
        gain, nominal = p[GAIN + axis], p[OFFSET_NOMINAL + axis]
        slope += p[ALPHA_OFFSET] * gain * (gain * tau - _best_step(p, axis, tau) - nominal)
    return slope


@njit(cache=True)
def _breakpoints(p, knots):  # pragma: no cover
    """Ends of the tau range and, sorted between, where a step coordinate meets a bound; returns the count."""
    low, high, step_weight, offset_weight = p[TAU_LOW], p[TAU_HIGH], p[ALPHA_STEP], p[ALPHA_OFFSET]
    knots[0] = low
    count = 1
    for axis in range(2):
        if offset_weight <= 0.0 or p[GAIN + axis] == 0.0:
            continue
        pull = step_weight * p[STEP_NOMINAL + axis]
        for side in range(2):
            bound = p[(STEP_LOW, STEP_HIGH)[side] + axis]
            exact = (bound * (step_weight + offset_weight) - pull) / offset_weight
            knot = (exact + p[OFFSET_NOMINAL + axis]) / p[GAIN + axis]
            if low < knot < high:
                place = count
                while knots[place - 1] > knot:
                    knots[place] = knots[place - 1]
                    place -= 1
                knots[place] = knot
                count += 1
    knots[count] = high
    return count + 1


@njit(cache=True)
def solve_step_kernel(p, out):  # pragma: no cover
    """Exact solution of a packed problem `p` (16,) into `out` (5,), see `columns`."""
    knots = np.empty(KNOTS)
    count = _breakpoints(p, knots)
    left, slope_left = knots[0], _half_slope(p, knots[0])
    tau = left
    if slope_left < 0.0 or (slope_left == 0.0 and p[TAU_NOMINAL] > left):
        tau = knots[count - 1]
        for k in range(1, count):
            right = knots[k]
            slope_right = _half_slope(p, right)
            if slope_right > 0.0:
                tau = left + (right - left) * (-slope_left / (slope_right - slope_left))
                break
            left, slope_left = right, slope_right
            if slope_right == 0.0 and p[TAU_NOMINAL] <= right:
                tau = right  # flat: the nominal time, if it is among the best
                break
    for axis in range(2):
        out[SOLVED_STEP + axis] = _best_step(p, axis, tau)
        out[SOLVED_OFFSET + axis] = p[GAIN + axis] * tau - out[SOLVED_STEP + axis]
    out[SOLVED_TAU] = tau


def solve_step(problem: StepProblem) -> StepPlan:
    """Exact solution of one problem."""
    out = np.empty(SOLUTION_SIZE)
    solve_step_kernel(problem.pack(), out)
    x = [float(value) for value in out]
    return StepPlan(
        (x[SOLVED_STEP], x[SOLVED_STEP + 1]), x[SOLVED_TAU], (x[SOLVED_OFFSET], x[SOLVED_OFFSET + 1])
    )
