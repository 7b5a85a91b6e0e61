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
from numpy.typing import ArrayLike, NDArray

from ..compiled.kernels import njit
from ..errors import InvalidValueError

# Layout of a packed problem (16,) and of its solution (5,)
GAIN, STEP_NOMINAL, TAU_NOMINAL, OFFSET_NOMINAL = slice(0, 2), slice(2, 4), 4, slice(5, 7)
STEP_LOW, STEP_HIGH, TAU_LOW, TAU_HIGH = slice(7, 9), slice(9, 11), 11, 12
ALPHA_STEP, ALPHA_DURATION, ALPHA_OFFSET = 13, 14, 15
PROBLEM_SIZE = 16
SOLUTION_SIZE = 5  # u_x, u_y, tau, b_x, b_y


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
        if not (values[STEP_LOW] <= values[STEP_HIGH]).all():
            raise InvalidValueError(f"step_low must be <= step_high, got {self.step_low} > {self.step_high}")
        if not 0 < self.tau_low <= self.tau_high:
            raise InvalidValueError(f"need 0 < tau_low <= tau_high, got {self.tau_low}, {self.tau_high}")
        if min(self.alpha_step, self.alpha_duration, self.alpha_offset) < 0:
            raise InvalidValueError(
                f"weights must be >= 0, got {self.alpha_step, self.alpha_duration, self.alpha_offset}"
            )

    def pack(self) -> NDArray[np.float64]:
        """The problem as one vector (PROBLEM_SIZE,), the layout of `solve_step_batch`."""
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
    free = p[2 + axis]
    if p[15] > 0.0:
        free = (p[13] * free + p[15] * (p[axis] * tau - p[5 + axis])) / (p[13] + p[15])
    return min(max(free, p[7 + axis]), p[9 + axis])


@njit(cache=True)
def _half_slope(p, tau):  # pragma: no cover
    """Half the derivative of the reduced cost with respect to tau."""
    slope = p[14] * (tau - p[4])
    for axis in range(2):
        slope += p[15] * p[axis] * (p[axis] * tau - _best_step(p, axis, tau) - p[5 + axis])
    return slope


@njit(cache=True)
def _breakpoints(p, knots):  # pragma: no cover
    """Ends of the tau range and, sorted between, where a step coordinate meets a bound; returns the count."""
    low, high = p[11], p[12]
    knots[0] = low
    count = 1
    for axis in range(2):
        if p[15] <= 0.0 or p[axis] == 0.0:
            continue
        for side in range(2):
            bound = p[7 + 2 * side + axis]
            knot = ((bound * (p[13] + p[15]) - p[13] * p[2 + axis]) / p[15] + p[5 + axis]) / p[axis]
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
    """Exact solution of a packed problem `p` (PROBLEM_SIZE,) into `out` (SOLUTION_SIZE,)."""
    knots = np.empty(6)
    count = _breakpoints(p, knots)
    left, slope_left = knots[0], _half_slope(p, knots[0])
    tau = left
    if slope_left < 0.0 or (slope_left == 0.0 and p[4] > left):
        tau = knots[count - 1]
        for k in range(1, count):
            right = knots[k]
            slope_right = _half_slope(p, right)
            if slope_right > 0.0:
                tau = left + (right - left) * (-slope_left / (slope_right - slope_left))
                break
            left, slope_left = right, slope_right
            if slope_right == 0.0 and p[4] <= right:  # flat: the nominal time, if it is among the best
                tau = right
                break
    for axis in range(2):
        out[axis] = _best_step(p, axis, tau)
        out[3 + axis] = p[axis] * tau - out[axis]
    out[2] = tau


@njit(cache=True)
def _solve_rows(problems, out):  # pragma: no cover
    for row in range(problems.shape[0]):
        solve_step_kernel(problems[row], out[row])


def solve_step(problem: StepProblem) -> StepPlan:
    """Exact solution of one problem."""
    out = np.empty(SOLUTION_SIZE)
    solve_step_kernel(problem.pack(), out)
    return StepPlan((float(out[0]), float(out[1])), float(out[2]), (float(out[3]), float(out[4])))


def solve_step_batch(problems: ArrayLike) -> NDArray[np.float64]:
    """Exact solutions (n, 5) = (u_x, u_y, tau, b_x, b_y) of packed problems (n, PROBLEM_SIZE).

    The same arithmetic as `solve_step`, so row for row the same bits.
    """
    packed = np.ascontiguousarray(problems, dtype=np.float64)
    if packed.ndim != 2 or packed.shape[1] != PROBLEM_SIZE:
        raise InvalidValueError(f"problems must have shape (n, {PROBLEM_SIZE}), got {packed.shape}")
    out = np.empty((packed.shape[0], SOLUTION_SIZE))
    _solve_rows(packed, out)
    return out
