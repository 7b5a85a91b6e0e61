"""The compiled loop of stage 2 in double support: assembly of the joint program, and its solution by DAQP.

Both axes have the same cost matrix H = L L', so that one factor serves both:

    M = A R^-1 = [ M_0   0        M_0 = [ I ] L'^-1
                   0     M_0            [ S ]
                   n_x Z n_y Z ]

with S the trunk angle at the nodes and Z the rows of M_0 that belong to the CoPs in double support.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..model.double_support import box_around, nearest_in_hull, strip, transfer_mean
from ..solvers.least_distance import solve_least_distance
from .dense import SHORTEST
from .interface import RESULT_COP, RESULT_DCM_END, RESULT_STATUS, RESULT_TRUNK
from .kernel import CLIPPED, acceleration_interval

# Columns of an input row, `DoubleSupportPlanner.plan_batch`; of a pair (x, y) the first one
UNTIL = 0  # touchdown [s]
SINCE = 1  # the step began [s]
OTHER_FOOT = 2  # pair, where it stands [m]
DCM = 4  # pair [m]
LEAN = 6  # pair [rad]
LEAN_RATE = 8  # pair [rad/s]
DCM_TARGET = 10  # pair [m]
INPUTS = 12


class Constants(NamedTuple):
    """Scalars of the compiled loop."""

    omega: float
    gain: float  # j / (m g) [m s^2]
    cop_x: float  # half size of a sole less the margin [m]
    cop_y: float
    pitch: float  # largest trunk acceleration [rad/s^2]; 0 about an axis that the waist lacks
    roll: float
    torque: float  # tau_max / j [rad/s^2]
    gravity: float  # gravity torque per sin(lean) / j [rad/s^2]
    angle: float  # [rad]
    double_support: float  # [s]
    period: float  # first interval [s]
    dt: float
    tail: int
    tail_dt: float
    debt: bool
    beta_cop: float
    beta_trunk: float
    beta_rate: float
    beta_angle: float
    beta_dcm: float
    use_cop: bool
    use_trunk: bool


class Memory(NamedTuple):
    """Scratch of the compiled loop; rewritten by every plan."""

    handles: NDArray[np.int64]  # (2, N + 1, 6) by intervals in double and in single support
    matrix: NDArray[np.float64]  # M, packed
    lower: NDArray[np.float64]  # (rows,)
    upper: NDArray[np.float64]
    solution: NDArray[np.float64]  # (inputs,)
    optimum: NDArray[np.float64]  # (rows,): A u, first of the unconstrained optimum
    block: NDArray[np.float64]  # M_0, packed
    factor: NDArray[np.float64]  # L, one axis
    durations: NDArray[np.float64]  # (intervals,)
    ends: NDArray[np.float64]  # (intervals,) after now [s]
    weights: NDArray[np.float64]  # (inputs of an axis,): DCM at touchdown = free - weights . u
    own: NDArray[np.float64]  # (inputs of an axis,): weight of each input
    shares: NDArray[np.float64]  # (intervals,): CoP reference over p


class Grid(NamedTuple):
    """Sizes of one program."""

    double: int  # intervals in double support
    until: int  # intervals until touchdown
    all: int  # and of the tail
    cops: int
    inputs: int  # of an axis
    rows: int  # of an axis


@njit(cache=True)
def _intervals(remaining: float, elapsed: float, c: Constants) -> tuple[int, int]:
    """How many intervals lie in double and in single support."""
    left = c.double_support - elapsed
    double = 2 if left - c.period > SHORTEST else 1
    single = max(remaining - left, SHORTEST)
    return double, int(max(math.floor((single - c.period) / c.dt + 1e-9), 0.0)) + 1


@njit(cache=True)
def missing_solver(rows: Any, c: Constants, w: Memory) -> tuple[int, int]:
    """Intervals in double and in single support of the first row without a solver; zeros if there is none."""
    for i in range(rows.shape[0]):
        double, single = _intervals(rows[i, UNTIL], rows[i, SINCE], c)
        if w.handles[double - 1, single, 0] == 0:
            return double, single
    return 0, 0


@njit(cache=True)
def plan_joint_rows(rows: Any, out: Any, c: Constants, memory: Memory) -> None:
    """Plan every row of (n, 12) into (n, 7); see `DoubleSupportPlanner.plan_batch`."""
    for i in range(rows.shape[0]):
        _plan(rows[i], out[i], c, memory)


@njit(cache=True)
def _plan(row: Any, out: Any, c: Constants, w: Memory) -> None:
    remaining, elapsed = row[UNTIL], row[SINCE]
    double, single = _intervals(remaining, elapsed, c)
    g = _lay_grid(remaining, elapsed, double, single, c, w)
    _factorise(g, c, w)
    inside = True
    for axis in range(2):
        inside = _optimum(axis, row, g, c, w) and inside
    normal_x, normal_y, half = strip(row[OTHER_FOOT], row[OTHER_FOOT + 1], c.cop_x, c.cop_y)
    strips = double if c.use_cop else 0
    for k in range(strips):
        value = normal_x * w.optimum[k] + normal_y * w.optimum[g.rows + k]
        i = 2 * g.rows + k
        w.optimum[i] = value
        w.lower[i], w.upper[i] = -half - value, half - value
        inside = inside and abs(value) <= half
    out[RESULT_STATUS] = 0.0
    if not inside:
        _write_matrix(g, strips, normal_x, normal_y, c, w)
        if solve_least_distance(w.handles[double - 1, single]) > 0:
            n, M, v = 2 * g.inputs, w.matrix, w.solution
            for i in range(2 * g.rows):
                for j in range(n):
                    w.optimum[i] += M[i * n + j] * v[j]
        else:
            out[RESULT_STATUS] = CLIPPED
    _write_plan(row, out, g, c, w)


@njit(cache=True)
def _lay_grid(remaining: float, elapsed: float, double: int, single: int, c: Constants, w: Memory) -> Grid:
    """Durations, references, terminal weights and own weights of the inputs."""
    left = c.double_support - elapsed
    until = double + single
    rest = max(remaining - left, SHORTEST)
    horizon = left + rest
    time = 0.0
    for k in range(until + c.tail):
        h = c.dt if k < until else c.tail_dt
        if k < double:
            h = left if double == 1 else c.period if k == 0 else left - c.period
            w.shares[k] = transfer_mean(elapsed + time, h, c.double_support, c.omega)
        else:
            w.shares[k] = 0.0
        if k == double:
            h = rest - (single - 1) * c.dt
        time += h
        w.durations[k], w.ends[k] = h, time
    total, cops = until + c.tail, until if c.use_cop else 0
    n = cops + (total if c.use_trunk else 0)
    for k in range(total):
        share = w.durations[k] / c.dt if k <= double else 1.0
        effect = math.exp(c.omega * (horizon - w.ends[k])) * math.expm1(c.omega * w.durations[k])
        if k >= until and not c.debt:
            effect = 0.0
        if k < cops:
            w.weights[k], w.own[k] = effect, c.beta_cop * share
        if c.use_trunk:
            w.weights[cops + k], w.own[cops + k] = c.gain * effect, c.beta_trunk * share
    return Grid(double, until, total, cops, n, n + (total if c.use_trunk else 0))


@njit(cache=True)
def _lean(w: Memory, node: int, j: int) -> float:
    """Trunk angle at the end of an interval per acceleration in interval j <= node."""
    return w.durations[j] * (w.ends[node] - w.ends[j] + 0.5 * w.durations[j])


@njit(cache=True)
def _factorise(g: Grid, c: Constants, w: Memory) -> None:
    """L of H = own + beta_dcm weights weights' + rates + angles, lower triangle, in place."""
    n, L = g.inputs, w.factor
    for i in range(n):
        for j in range(i + 1):
            L[i, j] = c.beta_dcm * w.weights[i] * w.weights[j]
        L[i, i] += w.own[i]
    for i in range(n - g.cops):
        for j in range(i + 1):
            total = 0.0
            for node in range(i, g.all):
                total += c.beta_angle * _lean(w, node, i) * _lean(w, node, j)
            total += c.beta_rate * (g.all - i) * w.durations[i] * w.durations[j]
            L[g.cops + i, g.cops + j] += total
    for i in range(n):
        for j in range(i + 1):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(total) if i == j else total / L[j, j]


@njit(cache=True)
def _free(axis: int, row: Any, g: Grid, c: Constants, w: Memory) -> float:
    """DCM at touchdown with all inputs zero; with the CoP at its reference where it is no input."""
    horizon = w.ends[g.until - 1]
    free = math.exp(c.omega * horizon) * row[DCM + axis]
    if not c.use_cop:
        for k in range(g.double):
            effect = math.exp(c.omega * (horizon - w.ends[k])) * math.expm1(c.omega * w.durations[k])
            free -= effect * w.shares[k] * row[OTHER_FOOT + axis]
    return free


@njit(cache=True)
def _optimum(axis: int, row: Any, g: Grid, c: Constants, w: Memory) -> bool:
    """The unconstrained optimum of an axis in the rows of the constraints, and their bounds about it."""
    n, L, at, other = g.inputs, w.factor, axis * g.rows, row[OTHER_FOOT + axis]
    angle, rate = row[LEAN + axis], row[LEAN_RATE + axis]
    y = w.optimum[at : at + g.rows]
    error = c.beta_dcm * (_free(axis, row, g, c, w) - row[DCM_TARGET + axis])
    for i in range(n):
        y[i] = error * w.weights[i]
        if i < g.cops:
            y[i] += w.own[i] * w.shares[i] * other
    for i in range(n - g.cops):
        for node in range(i, g.all):
            lean = angle + w.ends[node] * rate
            y[g.cops + i] -= c.beta_angle * _lean(w, node, i) * lean + c.beta_rate * w.durations[i] * rate
    for i in range(n):
        for k in range(i):
            y[i] -= L[i, k] * y[k]
        y[i] /= L[i, i]
    for i in range(n - 1, -1, -1):
        y[i] /= L[i, i]
        for k in range(i):
            y[k] -= L[i, k] * y[i]
    for node in range(g.rows - n):
        y[n + node] = angle + w.ends[node] * rate
        for j in range(node + 1):
            y[n + node] += _lean(w, node, j) * y[g.cops + j]
    return _bound(axis, other, angle, y, g, c, w)


@njit(cache=True)
def _accelerations(axis: int, angle: float, c: Constants) -> tuple[float, float]:
    """Bounds of the trunk acceleration at a lean [rad/s^2]."""
    return acceleration_interval(angle, c.gravity, c.torque, c.pitch if axis == 0 else c.roll)


@njit(cache=True)
def _bound(axis: int, other: float, angle: float, y: Any, g: Grid, c: Constants, w: Memory) -> bool:
    """Bounds of M v about the optimum y; True where it keeps them."""
    at, half, inside = axis * g.rows, c.cop_x if axis == 0 else c.cop_y, True
    low, high = _accelerations(axis, angle, c)
    for i in range(g.rows):
        lower, upper = -c.angle, c.angle
        if i < g.cops:
            lower, upper = -half, half
            if i < g.double:
                lower, upper = box_around(-half, half, other)
        elif i < g.inputs:
            lower, upper = low, high
        w.lower[at + i], w.upper[at + i] = lower - y[i], upper - y[i]
        inside = inside and lower <= y[i] <= upper
    return inside


@njit(cache=True)
def _write_matrix(g: Grid, strips: int, normal_x: float, normal_y: float, c: Constants, w: Memory) -> None:
    """M_0 row by row, L m = a, and the whole M from it."""
    n, L, B, M = g.inputs, w.factor, w.block, w.matrix
    for i in range(g.rows):
        first = i if i < n else g.cops
        m = B[i * n : (i + 1) * n]
        for j in range(n):
            m[j] = 0.0
        for j in range(first, n):
            total = 0.0
            if i < n:
                total = 1.0 if j == i else 0.0
            elif j - g.cops <= i - n:
                total = _lean(w, i - n, j - g.cops)
            for k in range(first, j):
                total -= L[j, k] * m[k]
            m[j] = total / L[j, j]
        for j in range(n):
            M[i * 2 * n + j], M[i * 2 * n + n + j] = m[j], 0.0
            M[(g.rows + i) * 2 * n + j], M[(g.rows + i) * 2 * n + n + j] = 0.0, m[j]
    for k in range(strips):
        for j in range(n):
            M[(2 * g.rows + k) * 2 * n + j] = normal_x * B[k * n + j]
            M[(2 * g.rows + k) * 2 * n + n + j] = normal_y * B[k * n + j]


@njit(cache=True)
def _write_plan(row: Any, out: Any, g: Grid, c: Constants, w: Memory) -> None:
    """CoP, trunk acceleration and expected DCM at touchdown."""
    cop_x, cop_y = w.shares[0] * row[OTHER_FOOT], w.shares[0] * row[OTHER_FOOT + 1]
    if c.use_cop:
        cop_x, cop_y = w.optimum[0], w.optimum[g.rows]
    out[RESULT_COP], out[RESULT_COP + 1] = nearest_in_hull(
        cop_x, cop_y, row[OTHER_FOOT], row[OTHER_FOOT + 1], c.cop_x, c.cop_y
    )
    for axis in range(2):
        out[RESULT_TRUNK + axis] = 0.0
        if c.use_trunk:
            low, high = _accelerations(axis, row[LEAN + axis], c)
            out[RESULT_TRUNK + axis] = min(max(w.optimum[axis * g.rows + g.cops], low), high)
        out[RESULT_DCM_END + axis] = _free(axis, row, g, c, w)
        for i in range(g.inputs):
            out[RESULT_DCM_END + axis] -= w.weights[i] * w.optimum[axis * g.rows + i]
