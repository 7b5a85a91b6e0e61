"""Stage 2 while both feet stand: one convex program over both axes, which the hull of the soles couples.

Costs, trunk and tail are those of `single_support`; new are the CoP's bounds in double support, the hull of
both soles (`model/nominal_gait`), its reference, the transfer from foot to foot, and the grid:

    control period | rest of double support | what is left over | whole sampling intervals | braking tail

The CoP of an interval in double support is referred to the mean of the transfer in it that moves the DCM
alike. The first interval is what the CoP will be held for, and a node stands at the end of double support:
with a uniform grid, solved anew every cycle, the gait would walk backwards.

Both axes have the same cost matrix H = L L', so that one factor serves both:

    M = A R^-1 = [ M_0   0        M_0 = [ I ] L'^-1
                   0     M_0            [ S ]
                   n_x Z n_y Z ]

with S the trunk angle at the nodes and Z the rows of M_0 that belong to the CoPs in double support.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidValueError
from ..jit import njit
from ..model.gait_box import GaitLimits
from ..model.nominal_gait import INSTANT, box_around, nearest_in_hull, strip, transfer_mean
from ..model.observation import ELAPSED, SWING_POSITION, TRUNK_ANGLE, TRUNK_RATE
from ..model.robot import RobotModel
from ..qp import LeastDistance, QuadraticProgram, solve_least_distance
from ..settings import PlannerConfig
from ..stage_1 import DCM_AHEAD, REMAINING, RESULT, TARGET
from . import problem
from .problem import Constants, ExplicitProblem, acceleration_interval, constants_of

# Columns of an input row, `DoubleSupportPlanner.plan_batch`; of a pair (x, y) the first one
UNTIL = 0  # touchdown [s]
SINCE = 1  # the step began [s]
OTHER_FOOT = 2  # pair, where it stands [m]
DCM = 4  # pair [m]
LEAN = 6  # pair [rad]
LEAN_RATE = 8  # pair [rad/s]
DCM_TARGET = 10  # pair [m]
INPUTS = 12

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class JointProblem:
    """Inputs (x axis; y axis), each as in `ExplicitProblem`; the strips of the hull are the last rows."""

    qp: QuadraticProgram
    axes: tuple[ExplicitProblem, ExplicitProblem]  # without the strips

    @classmethod
    def of(
        cls, x: ExplicitProblem, y: ExplicitProblem, double: int, band: tuple[float, float, float]
    ) -> JointProblem:
        """Both programs side by side, with |n . z_k| <= half width for the CoPs in double support."""
        n, m = x.qp.f.size, x.qp.lower.size
        strips = min(double, x.cops)
        H, A = np.zeros((2 * n, 2 * n)), np.zeros((2 * m + strips, 2 * n))
        H[:n, :n], H[n:, n:], A[:m, :n], A[m : 2 * m, n:] = x.qp.H, y.qp.H, x.qp.A, y.qp.A
        for k in range(strips):
            A[2 * m + k, k], A[2 * m + k, n + k] = band[0], band[1]
        edge = np.full(strips, band[2])
        lower, upper = (
            np.concatenate(rows) for rows in ((x.qp.lower, y.qp.lower, -edge), (x.qp.upper, y.qp.upper, edge))
        )
        soft = np.concatenate([x.qp.soft_weight, y.qp.soft_weight, np.zeros(strips)])
        qp = QuadraticProgram(H, np.concatenate([x.qp.f, y.qp.f]), A, lower, upper, soft)
        return cls(qp, (x, y))


class Memory(NamedTuple):
    """Scratch of the compiled loop; rewritten by every plan."""

    handles: NDArray[np.int64]  # (2, N + 1, 6) by intervals in double and in single support
    matrix: Floats  # M, packed
    lower: Floats  # (rows,)
    upper: Floats
    solution: Floats  # (inputs,)
    optimum: Floats  # (rows,): A u, first of the unconstrained optimum
    block: Floats  # M_0, packed
    factor: Floats  # L, one axis
    durations: Floats  # (intervals,)
    ends: Floats  # (intervals,) after now [s]
    weights: Floats  # (inputs of an axis,): DCM at touchdown = free - weights . u
    own: Floats  # (inputs of an axis,): weight of each input
    shares: Floats  # (intervals,): CoP reference over p


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
    double = 2 if left - c.first_interval_min > problem.SHORTEST else 1
    single = max(remaining - left, problem.SHORTEST)
    return double, int(max(math.floor((single - c.first_interval_min) / c.sampling_time + 1e-9), 0.0)) + 1


@njit(cache=True)
def missing_solver(rows: Any, numbers: Any, w: Memory) -> tuple[int, int]:
    """Intervals in double and in single support of the first row without a solver; zeros if there is none."""
    c = constants_of(numbers)
    for i in range(rows.shape[0]):
        double, single = _intervals(rows[i, UNTIL], rows[i, SINCE], c)
        if w.handles[double - 1, single, 0] == 0:
            return double, single
    return 0, 0


@njit(cache=True)
def plan_joint_rows(rows: Any, out: Any, numbers: Any, memory: Memory) -> None:
    """Plan every row of (n, 12) into (n, 7); see `DoubleSupportPlanner.plan_batch`."""
    c = constants_of(numbers)
    for i in range(rows.shape[0]):
        _plan(rows[i], out[i], c, memory)


@njit(cache=True)
def _plan(row: Any, out: Any, c: Constants, w: Memory) -> None:
    """Plan one row."""
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
    out[problem.RESULT_STATUS] = problem.SOLVED
    if not inside:
        _write_matrix(g, strips, normal_x, normal_y, c, w)
        if solve_least_distance(w.handles[double - 1, single]) > 0:
            n, M, v = 2 * g.inputs, w.matrix, w.solution
            for i in range(2 * g.rows):
                for j in range(n):
                    w.optimum[i] += M[i * n + j] * v[j]
        else:
            out[problem.RESULT_STATUS] = problem.CLIPPED
    _write_plan(row, out, g, c, w)


@njit(cache=True)
def _lay_grid(remaining: float, elapsed: float, double: int, single: int, c: Constants, w: Memory) -> Grid:
    """Durations, references, terminal weights and own weights of the inputs."""
    left = c.double_support - elapsed
    until = double + single
    rest = max(remaining - left, problem.SHORTEST)
    horizon = left + rest
    time = 0.0
    for k in range(until + int(c.tail_intervals)):
        h = c.sampling_time if k < until else c.tail_sampling_time
        if k < double:
            h = left if double == 1 else c.first_interval_min if k == 0 else left - c.first_interval_min
            w.shares[k] = transfer_mean(elapsed + time, h, c.double_support, c.omega)
        else:
            w.shares[k] = 0.0
        if k == double:
            h = rest - (single - 1) * c.sampling_time
        time += h
        w.durations[k], w.ends[k] = h, time
    total, cops = until + int(c.tail_intervals), until if c.use_cop else 0
    n = cops + (total if c.use_trunk else 0)
    for k in range(total):
        share = w.durations[k] / c.sampling_time if k <= double else 1.0
        effect = math.exp(c.omega * (horizon - w.ends[k])) * math.expm1(c.omega * w.durations[k])
        if k >= until and not c.trunk_debt:
            effect = 0.0
        if k < cops:
            w.weights[k], w.own[k] = effect, c.beta_cop * share
        if c.use_trunk:
            w.weights[cops + k], w.own[cops + k] = c.cmp_per_acceleration * effect, c.beta_trunk * share
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
                total += c.beta_trunk_angle * _lean(w, node, i) * _lean(w, node, j)
            total += c.beta_trunk_rate * (g.all - i) * w.durations[i] * w.durations[j]
            L[g.cops + i, g.cops + j] += total
    problem.factorise(L, n, L)


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
            own = c.beta_trunk_angle * _lean(w, node, i) * lean
            y[g.cops + i] -= own + c.beta_trunk_rate * w.durations[i] * rate
    problem.solve_lower(L, y[:n])
    problem.solve_upper(L, y[:n])
    for node in range(g.rows - n):
        y[n + node] = angle + w.ends[node] * rate
        for j in range(node + 1):
            y[n + node] += _lean(w, node, j) * y[g.cops + j]
    return _write_bounds(axis, other, angle, y, g, c, w)


@njit(cache=True)
def _write_bounds(axis: int, other: float, angle: float, y: Any, g: Grid, c: Constants, w: Memory) -> bool:
    """Bounds of M v about the optimum y; True where it keeps them."""
    at, half, inside = axis * g.rows, c.cop_x if axis == 0 else c.cop_y, True
    low, high = acceleration_interval(angle, c.gravity, c.torque, c.pitch if axis == 0 else c.roll)
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
        m[:] = 0.0
        if i < n:
            m[i] = 1.0
        for j in range(i - n + 1):
            m[g.cops + j] = _lean(w, i - n, j)
        problem.solve_lower(L[first:n, first:n], m[first:])
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
    out[problem.RESULT_COP], out[problem.RESULT_COP + 1] = nearest_in_hull(
        cop_x, cop_y, row[OTHER_FOOT], row[OTHER_FOOT + 1], c.cop_x, c.cop_y
    )
    for axis in range(2):
        out[problem.RESULT_TRUNK + axis] = 0.0
        if c.use_trunk:
            most = c.pitch if axis == 0 else c.roll
            low, high = acceleration_interval(row[LEAN + axis], c.gravity, c.torque, most)
            out[problem.RESULT_TRUNK + axis] = min(max(w.optimum[axis * g.rows + g.cops], low), high)
        out[problem.RESULT_DCM_END + axis] = _free(axis, row, g, c, w)
        for i in range(g.inputs):
            out[problem.RESULT_DCM_END + axis] -= w.weights[i] * w.optimum[axis * g.rows + i]


class DoubleSupportPlanner(problem.Form):
    """Plans CoP and trunk acceleration in double support; one per thread, as it owns scratch memory."""

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        """Allocate the scratch memory; a solver is set up when a horizon length first occurs.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
        """
        super().__init__(robot, limits, config)
        self._numbers = problem.pack_constants(robot, limits, config, limits.trunk_accelerations)
        self._solvers: dict[tuple[int, int], LeastDistance] = {}
        self.memory = self._allocate(math.ceil(self.longest / config.sampling_time) + 1)

    def _allocate(self, single: int) -> Memory:
        """Scratch for at most `single` intervals in single support."""
        n, rows, strips = self._sizes(2, single)
        total, m = 2 + single + self.config.tail_intervals, 2 * rows + strips
        sizes = m * 2 * n, m, m, 2 * n, m, rows * n, (n, n), total, total, n, n, total
        return Memory(np.zeros((2, single + 1, 6), np.int64), *(np.zeros(size) for size in sizes))

    def _sizes(self, double: int, single: int) -> tuple[int, int, int]:
        """Inputs and rows of an axis, and strips."""
        total = double + single + self.config.tail_intervals
        trunk = total if self.config.use_trunk else 0
        inputs = (double + single if self.config.use_cop else 0) + trunk
        return inputs, inputs + trunk, double if self.config.use_cop else 0

    def _set_up(self, double: int, single: int) -> None:
        """A solver for a horizon, on the shared scratch."""
        inputs, rows, strips = self._sizes(double, single)
        m, n, w = 2 * rows + strips, 2 * inputs, self.memory
        weight = np.zeros(m)
        for at in (0, rows):
            weight[at + inputs : at + rows] = self.config.beta_trunk_limit
        w.matrix[:] = 0.0
        M = w.matrix[: m * n].reshape(m, n)
        M[np.arange(m), np.arange(m) % n] = 1.0
        solver = LeastDistance(M, weight, w.lower[:m], w.upper[:m], w.solution[:n])
        self._solvers[double, single] = solver
        w.handles[double - 1, single] = solver.handle

    def plan_batch(self, rows: Floats) -> Floats:
        """Plan n robots by DAQP in one compiled loop, and once more by OSQP where that is the solver.

        Args:
            rows: (n, 12): time to touchdown and since the step began [s], where the other foot stands (2),
                measured dcm (2), trunk angle (2), trunk rate (2), dcm target (2), as of `CopPlanner`.

        Returns:
            (n, 7): cop (2), trunk acceleration (2), predicted dcm at touchdown (2), index into `STATUS`.

        Raises:
            InvalidValueError: another shape, not finite, too long, or not in double support.
        """
        rows = problem.as_rows(rows, INPUTS)
        remaining, elapsed = rows[:, UNTIL], rows[:, SINCE]
        fine = np.isfinite(rows).all(axis=1) & (remaining <= self.longest) & (elapsed >= 0.0)
        fine &= self.config.double_support - elapsed > INSTANT
        if not fine.all():
            raise InvalidValueError(
                f"stage 2 in double support needs finite states, at most {self.longest} s to touchdown and "
                f"less than {self.config.double_support} s since the last, got {rows[~fine][0].tolist()}"
            )
        while (missing := missing_solver(rows, self._numbers, self.memory))[0]:
            self._set_up(*missing)
        out = np.zeros((len(rows), problem.RESULT_SIZE))
        if self.config.use_cop or self.config.use_trunk:
            plan_joint_rows(rows, out, self._numbers, self.memory)
        if self.config.solver == "osqp":
            for row, result in zip(rows, out, strict=True):
                program = self.program(row)
                problem.solve_again([(program.qp, program.axes)], result)
        return out

    def program(self, row: Floats) -> JointProblem:
        """The dense program of a row (12,) of `plan_batch`.

        Its grid is one control period, the rest of double support, then the grid of single support.
        """
        config, c = self.config, Constants(*self._numbers.tolist())
        left = c.double_support - row[SINCE]
        rest = left - c.first_interval_min
        double = [c.first_interval_min, rest] if rest > problem.SHORTEST else [left]
        until = np.concatenate([double, problem.grid(config, max(row[UNTIL] - left, problem.SHORTEST))])
        shares = np.zeros(until.size)
        for k, start in enumerate(row[SINCE] + np.concatenate([[0.0], np.cumsum(double)[:-1]])):
            shares[k] = transfer_mean(start, until[k], c.double_support, c.omega)
        axes = []
        for i, (half, most) in enumerate(((c.cop_x, c.pitch), (c.cop_y, c.roll))):
            other, angle = row[OTHER_FOOT + i], row[LEAN + i]
            cop = np.repeat([[0.0], [-half], [half]], until.size, axis=1)
            cop[0] = shares * other
            cop[1:, : len(double)] = np.array(box_around(-half, half, other))[:, None]
            bounds = acceleration_interval(angle, c.gravity, c.torque, most)
            axes.append(
                problem.explicit_problem(
                    self.robot, config, until, len(double) + 1, row[DCM + i :: 2], cop, bounds
                )
            )
        band = strip(row[OTHER_FOOT], row[OTHER_FOOT + 1], c.cop_x, c.cop_y)
        return JointProblem.of(axes[0], axes[1], len(double), band)


class WithDoubleSupport:
    """Both axes at once while both feet stand for most of the coming period, then single support's plan."""

    workers, decides = 1, True

    def __init__(self, planner: DoubleSupportPlanner, single: problem.Regulator):
        self._planner, self._single, config = planner, single, planner.config
        self._last = config.double_support - 0.5 * config.first_interval_min

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """See `Regulator`."""
        double = observations[:, ELAPSED] < self._last
        for where, regulate in ((~double, self._single.regulate), (double, self._regulate_both)):
            if where.any():
                part = rows[where]
                regulate(observations[where], part)
                rows[where] = part

    def _regulate_both(self, observations: Floats, rows: Floats) -> None:
        inputs = np.column_stack(
            [rows[:, REMAINING], np.maximum(observations[:, ELAPSED], 0.0),
             observations[:, SWING_POSITION][:, :2], rows[:, DCM_AHEAD : DCM_AHEAD + 2],
             observations[:, TRUNK_ANGLE], observations[:, TRUNK_RATE], rows[:, TARGET : TARGET + 2]]
        )  # fmt: skip
        rows[:, RESULT:] = self._planner.plan_batch(inputs)
        self._planner.apply(observations, rows)
