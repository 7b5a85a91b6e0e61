"""Stage 2, default form: CoP and trunk acceleration until touchdown, by a small convex program per axis.

Inputs are constant over each interval, which the DCM follows exactly (eqs. 6b, 9):

    xi(t + d) = e^{w d} xi - (e^{w d} - 1) (z + j/(m g) a)

    min   beta_cop sum p_k (z_k - z_ref)^2 + beta_trunk sum p_k a_k^2 + beta_trunk_rate sum rate_k^2
        + beta_trunk_angle sum angle_k^2 + beta_dcm (xi_T - xi_des)^2 + beta_trunk_limit sum s_k^2
    s.t.  |z_k| <= sole - margin,  |j a_k - gravity torque| <= tau_max,  |angle_k + s_k| <= angle_max

The grid is anchored at touchdown, with a braking tail for the trunk after it. The first interval takes what
is left over, between the control period and the control period + sampling time, and its inputs are weighted
by its share p_0 = h_0/dt of an interval (p_k = 1 for the others): the costs approximate integrals, so that
the plan does not change its mind from one cycle to the next. Inputs have hard bounds and the trunk angle a
soft one, hence the problem is always feasible. Each solve starts cold: a plan is a function of its arguments.

No matrix is factorised in the loop (`cop_planner_tables`); DAQP is called only if the unconstrained optimum,
known in closed form, violates a bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from .config import PlannerConfig
from .cop_planner_problem import SHORTEST, explicit_problem
from .cop_planner_tables import Tables, build
from .errors import InvalidValueError
from .least_distance import LeastDistance, solve_least_distance
from .limits import GaitLimits
from .qp import solve_qp
from .robot import RobotModel

INPUTS, OUTPUTS = 11, 7  # columns of the rows that `plan_rows` reads and writes
LONGEST_MARGIN = 0.3  # horizons reach this far beyond the longest step [s]
STATUS = ("solved", "clipped", "invalid")


@dataclass(frozen=True)
class CopPlan:
    """What to do now, in the canonical frame, relative to the stance sole's centre."""

    cop: NDArray[np.float64]  # (2,) [m]
    trunk_acceleration: NDArray[np.float64]  # (2,) towards +x, +y [rad/s^2]
    dcm_end: NDArray[np.float64]  # (2,) predicted DCM at touchdown [m]
    status: str  # "solved"; "clipped": the solver failed, the unconstrained optimum was clipped


class Constants(NamedTuple):
    """Scalars of the compiled loop."""

    omega: float
    cmp_per_acceleration: float
    cop_x: float  # bounds [m]
    cop_y: float
    acceleration: float  # [rad/s^2]
    torque: float  # tau_max / j [rad/s^2]
    gravity: float  # gravity torque per sin(lean) / j [rad/s^2]
    angle: float  # [rad]
    dt: float
    first_min: float
    terminal_off: float
    beta_cop: float
    beta_trunk: float
    use_cop: bool
    use_trunk: bool


class Memory(NamedTuple):
    """Scratch of the compiled loop; rewritten by every solve."""

    matrices: NDArray[np.float64]  # (E, rows * n)
    handles: NDArray[np.int64]  # (E, 6)
    lower: NDArray[np.float64]  # (rows,)
    upper: NDArray[np.float64]
    optimum: NDArray[np.float64]  # (rows,): A u of the unconstrained optimum u
    solution: NDArray[np.float64]  # (n,)


class CopPlanner:
    """Plans the CoP and the trunk acceleration for one robot and configuration."""

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        """Build the tables of every horizon length.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
        """
        self.robot, self.limits, self.config = robot, limits, config
        bounds = (limits.cop_x_max - config.cop_margin_x, limits.cop_y_max - config.cop_margin_y)
        if min(bounds) <= 0:
            raise InvalidValueError(f"the CoP margins leave no sole: half sizes {bounds} m must be positive")
        if not config.beta_trunk_limit > 0:
            raise InvalidValueError(f"beta_trunk_limit must be positive, got {config.beta_trunk_limit}")
        self.longest = limits.duration_max + LONGEST_MARGIN
        self.constants = Constants(
            robot.omega, robot.cmp_per_trunk_acceleration, *bounds, limits.trunk_acceleration_max,
            robot.trunk_torque_max / robot.trunk_inertia, config.trunk_gravity / robot.trunk_inertia,
            robot.trunk_angle_max, config.sampling_time, config.first_interval_min, config.terminal_off,
            config.beta_cop, config.beta_trunk, config.use_cop, config.use_trunk,
        )  # fmt: skip
        self.tables, matrices = build(robot, config, self.longest)
        self.memory = self._allocate(matrices)
        self._row, self._out = np.zeros((1, INPUTS)), np.zeros((1, OUTPUTS))

    def __reduce__(self) -> tuple[Any, ...]:
        return CopPlanner, (self.robot, self.limits, self.config)

    def _allocate(self, matrices: NDArray[np.float64]) -> Memory:
        first = int(self.config.use_cop) + int(self.config.use_trunk)
        sizes = [(int(r) + first, int(k)) for r, k in zip(self.tables.rest, self.tables.nodes, strict=True)]
        n, rows = max(n for n, _ in sizes), max(n + k for n, k in sizes)
        lower, upper, solution = np.zeros(rows), np.zeros(rows), np.zeros(n)
        handles = np.zeros((len(sizes), 6), dtype=np.int64)
        self._problems: list[LeastDistance] = []
        for e, (n, k) in enumerate(sizes if first else []):
            matrix = matrices[e, : (n + k) * n].reshape(n + k, n)
            soft = np.concatenate([np.zeros(n), np.full(k, self.config.beta_trunk_limit)])
            self._problems.append(LeastDistance(matrix, soft, lower[: n + k], upper[: n + k], solution[:n]))
            handles[e] = self._problems[-1].handle
        return Memory(matrices, handles, lower, upper, np.zeros(rows), solution)

    def plan(
        self,
        remaining: float,
        dcm: ArrayLike,
        trunk_angle: ArrayLike,
        trunk_rate: ArrayLike,
        dcm_target: ArrayLike,
        cop_reference: ArrayLike = (0.0, 0.0),
    ) -> CopPlan:
        """Plan from the present state to touchdown.

        Args:
            remaining: time to touchdown [s]; at most `longest`, and planned as `SHORTEST` where it is less.
            dcm: (2,) measured DCM [m].
            trunk_angle: (2,) lean towards +x, +y [rad].
            trunk_rate: (2,) [rad/s].
            dcm_target: (2,) DCM wanted at touchdown, u_T + b_nom (eq. 7) [m].
            cop_reference: (2,) [m].

        Raises:
            InvalidValueError: an argument is not finite or has the wrong shape, or `remaining` is too long.
        """
        row, out = self._row, self._out
        try:
            row[0, 0] = remaining
            row[0, 1:3], row[0, 3:5], row[0, 5:7] = dcm, trunk_angle, trunk_rate
            row[0, 7:9], row[0, 9:11] = dcm_target, cop_reference
        except (ValueError, TypeError) as error:
            raise InvalidValueError(f"stage 2 takes a time and vectors of 2 numbers: {error}") from None
        if self.config.solver == "osqp":
            return self._plan_explicit(row[0])
        plan_rows(row, out, self.constants, self.tables, self.memory)
        result = out[0].copy()
        status = int(result[6])
        if status == 2:
            self._reject(row)
        result.flags.writeable = False
        return CopPlan(result[0:2], result[2:4], result[4:6], STATUS[status])

    def plan_batch(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Plan n robots one after the other.

        Args:
            rows: (n, 11): remaining, dcm (2), trunk angle (2), trunk rate (2), dcm target (2),
                cop reference (2), as for `plan`.

        Returns:
            (n, 7): cop (2), trunk acceleration (2), predicted dcm at touchdown (2), index into `STATUS`.
        """
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != INPUTS:
            raise InvalidValueError(f"rows must have shape (n, {INPUTS}), got {rows.shape}")
        out = np.zeros((rows.shape[0], OUTPUTS))
        plan_rows(rows, out, self.constants, self.tables, self.memory)
        if np.any(out[:, 6] == 2):
            self._reject(rows[out[:, 6] == 2])
        return out

    def bounds(self, axis: int, trunk_angle: float) -> tuple[float, float, float]:
        """CoP bound [m], and lower and upper bound of the trunk acceleration [rad/s^2] at a lean angle."""
        low, high = _acceleration_bounds(trunk_angle, self.constants)
        return (self.constants.cop_x, self.constants.cop_y)[axis], low, high

    def _plan_explicit(self, row: NDArray[np.float64]) -> CopPlan:
        """The same plan by OSQP, from the dense problem: slow, a second opinion."""
        if not np.all(np.isfinite(row)) or row[0] > self.longest:
            self._reject(row[None])
        cop, acceleration, end, status = np.zeros(2), np.zeros(2), np.zeros(2), "solved"
        for axis in range(2):
            bounds = self.bounds(axis, row[3 + axis])
            dcm, angle, rate, target, reference = row[1 + axis :: 2]
            problem = explicit_problem(
                self.robot, self.config, row[0], dcm, angle, rate, target, reference, *bounds
            )
            solution = solve_qp(problem.qp, "osqp")
            status = solution.status if solution.status != "solved" else status
            cop[axis], acceleration[axis] = problem.first(solution.x)
            end[axis] = problem.dcm_end(solution.x)
        return CopPlan(cop, acceleration, end, status)

    def _reject(self, rows: NDArray[np.float64]) -> None:
        raise InvalidValueError(
            f"stage 2 needs finite states and at most {self.longest} s to touchdown, got {rows[0].tolist()}"
            " (remaining, dcm, trunk angle, trunk rate, dcm target, cop reference)"
        )


@njit(cache=True)
def _acceleration_bounds(angle: float, c: Constants) -> tuple[float, float]:
    """|j a - gravity sin(angle)| <= tau_max, within the gait box; never empty."""
    shift = c.gravity * math.sin(angle)
    low = min(max(shift - c.torque, -c.acceleration), c.acceleration)
    high = max(min(shift + c.torque, c.acceleration), -c.acceleration)
    return low, high


@njit(cache=True)
def plan_rows(rows: Any, out: Any, c: Constants, tables: Tables, memory: Memory) -> None:
    """Plan every row of (n, 11) into (n, 7); see `CopPlanner.plan_batch`."""
    for i in range(rows.shape[0]):
        row = rows[i]
        finite = True
        for k in range(row.shape[0]):
            finite = finite and math.isfinite(row[k])
        remaining = max(row[0], SHORTEST)
        whole = int(max(math.floor((remaining - c.first_min) / c.dt + 1e-9), 0.0))
        if not finite or whole + 1 >= tables.entries.shape[1]:
            out[i, 6] = 2
            continue
        out[i, 6] = 0
        e = tables.entries[0 if remaining <= c.terminal_off else 1, whole + 1]
        first = remaining - whole * c.dt
        for axis in range(2):
            cop, acceleration, end, status = _plan_axis(
                e, first, remaining, row[1 + axis], row[3 + axis], row[5 + axis], row[7 + axis],
                row[9 + axis], c.cop_x if axis == 0 else c.cop_y, c, tables, memory,
            )  # fmt: skip
            out[i, axis], out[i, 2 + axis], out[i, 4 + axis] = cop, acceleration, end
            out[i, 6] = max(out[i, 6], status)


@njit(cache=True)
def _plan_axis(
    e: int, first: float, remaining: float, dcm: float, angle: float, rate: float, target: float,
    reference: float, cop_max: float, c: Constants, tables: Tables, memory: Memory,
) -> tuple[Any, Any, Any, int]:  # fmt: skip
    """One axis: (CoP, trunk acceleration, DCM at touchdown, status)."""
    rest, nodes, cops = tables.rest[e], tables.nodes[e], tables.cops[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    rows = n + nodes
    growth = math.exp(c.omega * remaining)
    free = growth * dcm
    if not c.use_cop:
        reference = min(max(reference, -cop_max), cop_max)
        free -= (growth - 1.0) * reference
    low, high = _acceleration_bounds(angle, c)
    if n == 0:
        return reference, 0.0, free, 0

    # Coefficients of the columns of the first interval, and of the right-hand side, along T, S, O
    share = first / c.dt
    weight_z = growth * (1.0 - math.exp(-c.omega * first))
    weight_a = c.cmp_per_acceleration * weight_z
    kz = (weight_z, 0.0, 0.0)
    ka = (weight_a, first, 0.5 * first * first)
    kr = (free - target, -rate, -(angle + first * rate))
    uz, ua, l11, l12, l22 = _first_interval(tables.gram[e], kz, ka, kr, reference, share, c)
    k0 = kr[0] - kz[0] * uz - ka[0] * ua
    k1 = kr[1] - ka[1] * ua
    k2 = kr[2] - ka[2] * ua
    k3 = reference if c.use_cop else 0.0

    # Unconstrained optimum, in the rows of the constraints
    U, V, steps, y = tables.inputs[e], tables.angles[e], tables.steps[e], memory.optimum
    inside = True
    for i in range(rest):
        y[i] = k0 * U[i, 0] + k1 * U[i, 1] + k2 * U[i, 2] + k3 * U[i, 3]
    if c.use_cop:
        y[rest] = uz
    if c.use_trunk:
        y[n - 1] = ua
    for k in range(nodes):
        y[n + k] = (
            k0 * V[k, 0] + k1 * V[k, 1] + k2 * V[k, 2] + k3 * V[k, 3]
            + angle + (first + steps[k]) * rate + (ka[2] + first * steps[k]) * ua
        )  # fmt: skip
    for i in range(rows):
        is_cop = i < cops or (i == rest and c.use_cop)
        lower = -cop_max if is_cop else low if i < n else -c.angle
        upper = cop_max if is_cop else high if i < n else c.angle
        memory.lower[i], memory.upper[i] = lower - y[i], upper - y[i]
        inside = inside and lower <= y[i] <= upper

    status = 0
    if not inside:
        _write_first_columns(e, first, kz, ka, l11, l12, l22, c, tables, memory)
        if solve_least_distance(memory.handles[e]) > 0:
            M, v = memory.matrices[e], memory.solution
            for i in range(n):
                for j in range(n):
                    y[i] += M[i * n + j] * v[j]
        else:
            status = 1
    end = free
    for i in range(rest):
        end -= tables.weights[e, i] * y[i]
    cop, acceleration = reference, 0.0
    if c.use_cop:
        cop = min(max(y[rest], -cop_max), cop_max)
        end -= weight_z * cop
    if c.use_trunk:
        acceleration = min(max(y[n - 1], low), high)
        end -= weight_a * acceleration
    return cop, acceleration, end, status


@njit(cache=True)
def _first_interval(
    gram: Any, kz: Any, ka: Any, kr: Any, reference: float, share: float, c: Constants
) -> tuple[float, float, float, float, float]:
    """Unconstrained z_0 and a_0, and the lower right corner of R.

    The Schur complement of the first interval's inputs in G'G, with the Gram matrix of what the other inputs
    leave of each direction: S_ij = own_i + k_i' gram k_j, S u = own reference + k' gram k_r.
    """
    szz = saa = 1.0
    sza = bz = ba = 0.0
    if c.use_cop:
        szz, bz = c.beta_cop * share, c.beta_cop * share * reference
    if c.use_trunk:
        saa = c.beta_trunk * share
    tail = reference if c.use_cop else 0.0
    for i in range(3):
        along = gram[i, 3] * tail
        for j in range(3):
            along += gram[i, j] * kr[j]
            if c.use_cop:
                szz += kz[i] * gram[i, j] * kz[j]
            if c.use_trunk:
                saa += ka[i] * gram[i, j] * ka[j]
            if c.use_cop and c.use_trunk:
                sza += kz[i] * gram[i, j] * ka[j]
        bz += kz[i] * along if c.use_cop else 0.0
        ba += ka[i] * along if c.use_trunk else 0.0
    l11 = math.sqrt(szz)
    l12 = sza / l11
    l22 = math.sqrt(saa - l12 * l12)
    ua = (ba - l12 * bz / l11) / (l22 * l22) if c.use_trunk else 0.0
    uz = (bz / l11 - l12 * ua) / l11 if c.use_cop else 0.0
    return uz, ua, l11, l12, l22


@njit(cache=True)
def _write_first_columns(
    e: int, first: float, kz: Any, ka: Any, l11: float, l12: float, l22: float, c: Constants, tables: Tables,
    memory: Memory,
) -> None:  # fmt: skip
    """The columns of M = A R^-1 that belong to the first interval: z_0, then a_0."""
    rest, nodes = tables.rest[e], tables.nodes[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    U, V, steps, M = tables.inputs[e], tables.angles[e], tables.steps[e], memory.matrices[e]
    for i in range(n + nodes):
        t = s = o = 0.0
        if i < rest:
            t, s, o = U[i, 0], U[i, 1], U[i, 2]
        elif i >= n:
            t, s, o = V[i - n, 0], V[i - n, 1], V[i - n, 2]
        column = 0.0
        if c.use_cop:
            column = ((1.0 if i == rest else 0.0) - kz[0] * t) / l11
            M[i * n + rest] = column
        if c.use_trunk:
            own = 1.0 if i == n - 1 else 0.0
            if i >= n:
                own = ka[2] + first * steps[i - n]
            M[i * n + n - 1] = (own - ka[0] * t - ka[1] * s - ka[2] * o - column * l12) / l22
