"""Stage 2, default form: CoP and trunk acceleration until touchdown, one convex program per axis.

The compiled loop of stage 2: one plan is one row in, one row out; see `planner` for the problem.

Stage 2, default form: CoP and trunk acceleration until touchdown, by a small convex program per axis.

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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..array_table import parts_table
from ..errors import InvalidValueError
from ..jit import njit
from ..model.gait_box import GaitLimits
from ..model.observation import TRUNK_ANGLE, TRUNK_RATE
from ..model.robot import RobotModel
from ..qp import LeastDistance, solve_least_distance, solve_qp
from ..settings import PlannerConfig
from ..stage_1 import DCM_AHEAD, REMAINING, RESULT, TARGET
from ..stage_1 import STATUS as STATUS_COLUMN
from .problem import (
    RESULT_COP,
    RESULT_DCM_END,
    RESULT_SIZE,
    RESULT_STATUS,
    RESULT_TRUNK,
    SHORTEST,
    STATUS,
    CopPlan,
    cop_bounds,
    explicit_problem,
    plan_of,
    require_positive,
    take_over,
)
from .tables import (
    ANGLE,
    RATE,
    REFERENCE,
    TERMINAL,
    Constants,
    Memory,
    Parts,
    Shared,
    Tables,
    box_of,
    build,
    constants_of,
    memory_of,
    new_memory,
    tables_of,
)

# Columns of an input row, `CopPlanner.plan_batch`; of a pair (x, y) the first one
UNTIL = 0  # touchdown [s]
DCM = 1  # pair [m]
LEAN = 3  # pair [rad]
LEAN_RATE = 5  # pair [rad/s]
DCM_TARGET = 7  # pair [m]
COP_REFERENCE = 9  # pair [m]
INPUTS = 11

CLIPPED, INVALID = STATUS.index("clipped"), STATUS.index("invalid")
_ANGLE, _RATE = TRUNK_ANGLE.start, TRUNK_RATE.start


class AxisState(NamedTuple):
    """What one axis starts from and is to reach."""

    dcm: float  # [m]
    angle: float  # of the trunk [rad]
    rate: float  # [rad/s]
    target: float  # DCM wanted at touchdown [m]
    reference: float  # of the CoP [m]
    cop_max: float  # [m]
    low: float  # bounds of the trunk acceleration [rad/s^2]
    high: float
    growth: float  # exp(omega remaining)
    free: float  # DCM at touchdown with no input but a CoP that is given [m]


class FirstInterval(NamedTuple):
    """The first interval: the columns of its inputs along the directions T, S, O, and their optimum."""

    span: float  # [s]
    kz: tuple[float, float, float]  # of z_0
    ka: tuple[float, float, float]  # of a_0
    kr: tuple[float, float, float]  # of the right-hand side
    uz: float  # unconstrained z_0 [m]
    ua: float  # unconstrained a_0 [rad/s^2]
    l11: float  # lower right corner of R
    l12: float
    l22: float


@njit(cache=True)
def acceleration_interval(angle: float, gravity: float, torque: float, box: float) -> tuple[float, float]:
    """|j a - gravity torque sin(angle)| <= tau_max, all over j, within the gait box; never empty."""
    shift = gravity * math.sin(angle)
    low = min(max(shift - torque, -box), box)
    high = max(min(shift + torque, box), -box)
    return low, high


@njit(cache=True)
def acceleration_bounds(angle: float, c: Constants) -> tuple[float, float]:
    """Bounds of the trunk acceleration at the present lean."""
    return acceleration_interval(angle, c.gravity, c.torque, c.acceleration)


@njit(cache=True, forceinline=True)
def write_input(obs: Any, row: Any, out: Any) -> None:
    """An input row (11,) of an observation and its stage 1 row; the CoP's reference is the sole's centre."""
    out[UNTIL] = row[REMAINING]
    for axis in range(2):
        out[DCM + axis] = row[DCM_AHEAD + axis]
        out[LEAN + axis], out[LEAN_RATE + axis] = obs[_ANGLE + axis], obs[_RATE + axis]
        out[DCM_TARGET + axis] = row[TARGET + axis]
        out[COP_REFERENCE + axis] = 0.0


@njit(cache=True)
def write_inputs(observations: Any, rows: Any, inputs: Any) -> None:
    """`write_input` of every row."""
    for i in range(rows.shape[0]):
        write_input(observations[i], rows[i], inputs[i])


@njit(cache=True, nogil=True)
def regulate_rows(observations: Any, rows: Any, packed: Any) -> int:
    """Stage 2 of stage 1 rows, in place; returns how many were invalid; see `Regulator.regulate`."""
    c, box, inputs = constants_of(packed), box_of(packed), np.empty((rows.shape[0], INPUTS))
    write_inputs(observations, rows, inputs)
    invalid = plan_rows(inputs, rows[:, RESULT:], packed)
    if invalid == 0:
        for i in range(rows.shape[0]):
            take_over(observations[i], rows[i], box, c.use_cop, c.use_trunk)
    return invalid


@njit(cache=True, nogil=True)
def plan_rows(rows: Any, out: Any, packed: Any) -> int:
    """Plan every row of (n, 11) into (n, 7); returns how many were invalid; see `CopPlanner.plan_batch`.

    Args:
        rows: inputs, by the columns above.
        out: results, by the columns of `interface`.
        packed: address table of `Parts`.
    """
    c, tables, memory = constants_of(packed), tables_of(packed), memory_of(packed)
    invalid = 0
    for i in range(rows.shape[0]):
        row = rows[i]
        finite = True
        for k in range(row.shape[0]):
            finite = finite and math.isfinite(row[k])
        remaining = max(row[UNTIL], SHORTEST)
        whole = int(max(math.floor((remaining - c.first_min) / c.dt + 1e-9), 0.0))
        if not finite or whole >= len(tables.rest):
            out[i, RESULT_STATUS] = INVALID
            invalid += 1
            continue
        out[i, RESULT_STATUS] = 0
        for axis in range(2):
            _plan_axis(whole, remaining, row, axis, c, tables, memory, out[i])
    return invalid


@njit(cache=True, forceinline=True)
def _axis_state(row: Any, axis: int, remaining: float, c: Constants) -> AxisState:
    """State and bounds of one axis of an input row."""
    dcm, angle, reference = row[DCM + axis], row[LEAN + axis], row[COP_REFERENCE + axis]
    cop_max = c.cop_x if axis == 0 else c.cop_y
    growth = math.exp(c.omega * remaining)
    free = growth * dcm
    if not c.use_cop:
        reference = min(max(reference, -cop_max), cop_max)
        free -= (growth - 1.0) * reference
    low, high = acceleration_bounds(angle, c)
    rate, target = row[LEAN_RATE + axis], row[DCM_TARGET + axis]
    return AxisState(dcm, angle, rate, target, reference, cop_max, low, high, growth, free)


@njit(cache=True, forceinline=True)
def _plan_axis(
    e: int, remaining: float, row: Any, axis: int, c: Constants, tables: Tables, memory: Memory, out: Any
) -> None:
    """Plan one axis of an input row over horizon e: CoP, trunk acceleration, DCM at touchdown, status."""
    state = _axis_state(row, axis, remaining, c)
    cop, acceleration, end = state.reference, 0.0, state.free
    rest = tables.rest[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    if n > 0:
        first = _first_interval(tables.gram[e], remaining - e * c.dt, state, c)
        _write_optimum(e, first, state, c, tables, memory.optimum)
        if not _write_room(e, state, c, tables, memory):
            _write_first_columns(e, first, c, tables, memory)
            if not _move_inside(e, n, memory):
                out[RESULT_STATUS] = max(out[RESULT_STATUS], CLIPPED)
        y = memory.optimum
        for i in range(rest):
            end -= tables.weights[e, i] * y[i]
        if c.use_cop:
            cop = min(max(y[rest], -state.cop_max), state.cop_max)
            end -= first.kz[TERMINAL] * cop
        if c.use_trunk:
            acceleration = min(max(y[n - 1], state.low), state.high)
            end -= first.ka[TERMINAL] * acceleration
    out[RESULT_COP + axis], out[RESULT_TRUNK + axis], out[RESULT_DCM_END + axis] = cop, acceleration, end


@njit(cache=True, forceinline=True)
def _first_interval(gram: Any, span: float, state: AxisState, c: Constants) -> FirstInterval:
    """Columns of the first interval, its unconstrained z_0 and a_0, and the lower right corner of R.

    The Schur complement of the first interval's inputs in G'G, with the Gram matrix of what the other inputs
    leave of each direction: S_ij = own_i + k_i' gram k_j, S u = own reference + k' gram k_r.
    """
    share = span / c.dt
    weight_z = state.growth * (1.0 - math.exp(-c.omega * span))
    kz = (weight_z, 0.0, 0.0)
    ka = (c.cmp_per_acceleration * weight_z, span, 0.5 * span * span)
    kr = (state.free - state.target, -state.rate, -(state.angle + span * state.rate))
    szz = saa = 1.0
    sza = bz = ba = 0.0
    if c.use_cop:
        szz, bz = c.beta_cop * share, c.beta_cop * share * state.reference
    if c.use_trunk:
        saa = c.beta_trunk * share
    tail = state.reference if c.use_cop else 0.0
    for i in range(3):
        along = gram[i, REFERENCE] * tail
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
    return FirstInterval(span, kz, ka, kr, uz, ua, l11, l12, l22)


@njit(cache=True, forceinline=True)
def _write_optimum(
    e: int, first: FirstInterval, state: AxisState, c: Constants, tables: Tables, y: Any
) -> None:
    """The unconstrained optimum into y: the inputs, then the trunk angles at the nodes."""
    rest, nodes = tables.rest[e], tables.nodes[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    U, V, steps, span, ka, kr = (
        tables.inputs[e],
        tables.angles[e],
        tables.steps[e],
        first.span,
        first.ka,
        first.kr,
    )
    k0 = kr[TERMINAL] - first.kz[TERMINAL] * first.uz - ka[TERMINAL] * first.ua
    k1 = kr[RATE] - ka[RATE] * first.ua
    k2 = kr[ANGLE] - ka[ANGLE] * first.ua
    k3 = state.reference if c.use_cop else 0.0
    for i in range(rest):
        y[i] = k0 * U[i, TERMINAL] + k1 * U[i, RATE] + k2 * U[i, ANGLE] + k3 * U[i, REFERENCE]
    if c.use_cop:
        y[rest] = first.uz
    if c.use_trunk:
        y[n - 1] = first.ua
    for k in range(nodes):
        y[n + k] = (
            k0 * V[k, TERMINAL] + k1 * V[k, RATE] + k2 * V[k, ANGLE] + k3 * V[k, REFERENCE]
            + state.angle + (span + steps[k]) * state.rate + (ka[ANGLE] + span * steps[k]) * first.ua
        )  # fmt: skip


@njit(cache=True, forceinline=True)
def _write_room(e: int, state: AxisState, c: Constants, tables: Tables, memory: Memory) -> bool:
    """How far the optimum may move down and up, by rows of the constraints; True where it may stay."""
    rest, cops, y = tables.rest[e], tables.cops[e], memory.optimum
    n = rest + int(c.use_cop) + int(c.use_trunk)
    inside = True
    for i in range(n + tables.nodes[e]):
        is_cop = i < cops or (i == rest and c.use_cop)
        lower = -state.cop_max if is_cop else state.low if i < n else -c.angle
        upper = state.cop_max if is_cop else state.high if i < n else c.angle
        memory.lower[i], memory.upper[i] = lower - y[i], upper - y[i]
        inside = inside and lower <= y[i] <= upper
    return inside


@njit(cache=True, forceinline=True)
def _move_inside(e: int, n: int, memory: Memory) -> bool:
    """Move the inputs of the optimum to the constrained one; False where the solver fails."""
    if solve_least_distance(memory.handles[e]) <= 0:
        return False
    M, v, y = memory.matrices[e], memory.solution, memory.optimum
    for i in range(n):
        for j in range(n):
            y[i] += M[i * n + j] * v[j]
    return True


@njit(cache=True, forceinline=True)
def _write_first_columns(e: int, first: FirstInterval, c: Constants, tables: Tables, memory: Memory) -> None:
    """The columns of M = A R^-1 that belong to the first interval: z_0, then a_0."""
    rest, nodes = tables.rest[e], tables.nodes[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    kz, ka = first.kz, first.ka
    U, V, steps, M = tables.inputs[e], tables.angles[e], tables.steps[e], memory.matrices[e]
    for i in range(n + nodes):
        t = s = o = 0.0
        if i < rest:
            t, s, o = U[i, TERMINAL], U[i, RATE], U[i, ANGLE]
        elif i >= n:
            t, s, o = V[i - n, TERMINAL], V[i - n, RATE], V[i - n, ANGLE]
        column = 0.0
        if c.use_cop:
            column = ((1.0 if i == rest else 0.0) - kz[TERMINAL] * t) / first.l11
            M[i * n + rest] = column
        if c.use_trunk:
            own = 1.0 if i == n - 1 else 0.0
            if i >= n:
                own = ka[ANGLE] + first.span * steps[i - n]
            along = own - ka[TERMINAL] * t - ka[RATE] * s - ka[ANGLE] * o
            M[i * n + n - 1] = (along - column * first.l12) / first.l22


LONGEST_MARGIN = 0.3  # horizons reach this far beyond the longest step [s]


class CopPlanner:
    """Plans the CoP and the trunk acceleration for one robot and configuration.

    A planner owns scratch memory, `packed`, for each of its workers: of the caller's threads only one may
    use it, or one part of `packed`, at a time. Pickling builds it anew.
    """

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig, workers: int = 1):
        """Build the tables of every horizon length.

        Args:
            robot: physical constants.
            limits: half sizes of the sole and bound of the trunk acceleration.
            config: weights and margins.
            workers: parts of `packed`; `plan` and `plan_batch` use the first.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
        """
        self.robot, self.limits, self.config = robot, limits, config
        bounds = cop_bounds(limits, config)
        require_positive(config, "beta_trunk_limit")
        self.longest = limits.duration_max + LONGEST_MARGIN
        self.constants = Constants(
            robot.omega, robot.cmp_per_trunk_acceleration, *bounds, limits.trunk_acceleration_max,
            robot.trunk_torque_max / robot.trunk_inertia, config.trunk_gravity / robot.trunk_inertia,
            robot.trunk_angle_max, config.sampling_time, config.first_interval_min, config.beta_cop,
            config.beta_trunk, config.use_cop, config.use_trunk,
        )  # fmt: skip
        self.tables, matrices = build(robot, config, self.longest)
        self._problems: list[LeastDistance] = []
        shared = Shared(np.array(self.constants, dtype=np.float64), limits.box)
        # the tables hold addresses: their arrays live as long as they do
        self._parts = [Parts(shared, self.tables, self._allocate(matrices)) for _ in range(workers)]
        self.packed = [parts_table(parts) for parts in self._parts]  # one for each worker's compiled loop
        self._row, self._out = np.zeros((1, INPUTS)), np.zeros((1, RESULT_SIZE))

    def __reduce__(self) -> tuple[Any, ...]:
        return CopPlanner, (self.robot, self.limits, self.config, len(self.packed))

    def _allocate(self, matrices: NDArray[np.float64]) -> Memory:
        """Scratch memory of one worker, with solvers of its own."""
        first = int(self.config.use_cop) + int(self.config.use_trunk)
        sizes = [(int(r) + first, int(k)) for r, k in zip(self.tables.rest, self.tables.nodes, strict=True)]
        memory = new_memory(matrices, max(n + k for n, k in sizes), max(n for n, _ in sizes))
        for e, (n, k) in enumerate(sizes if first else []):
            matrix = memory.matrices[e, : (n + k) * n].reshape(n + k, n)
            soft = np.concatenate([np.zeros(n), np.full(k, self.config.beta_trunk_limit)])
            bounds = memory.lower[: n + k], memory.upper[: n + k]
            self._problems.append(LeastDistance(matrix, soft, *bounds, memory.solution[:n]))
            memory.handles[e] = self._problems[-1].handle
        return memory

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
            row[0, UNTIL] = remaining
            for column, pair in (
                (DCM, dcm), (LEAN, trunk_angle), (LEAN_RATE, trunk_rate), (DCM_TARGET, dcm_target),
                (COP_REFERENCE, cop_reference),
            ):  # fmt: skip
                row[0, column : column + 2] = pair
        except (ValueError, TypeError) as error:
            raise InvalidValueError(f"stage 2 takes a time and vectors of 2 numbers: {error}") from None
        if self.config.solver == "osqp":
            return self._plan_explicit(row[0])
        plan_rows(row, out, self.packed[0])
        result = out[0].copy()
        status = int(result[RESULT_STATUS])
        if status == INVALID:
            self._reject(row)
        return plan_of(result, STATUS[status])

    def plan_batch(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Plan n robots by DAQP in one compiled loop.

        Args:
            rows: (n, 11): remaining, dcm (2), trunk angle (2), trunk rate (2), dcm target (2),
                cop reference (2), as for `plan`.

        Returns:
            (n, 7): cop (2), trunk acceleration (2), predicted dcm at touchdown (2), index into `STATUS`.
        """
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != INPUTS:
            raise InvalidValueError(f"rows must have shape (n, {INPUTS}), got {rows.shape}")
        out = np.zeros((rows.shape[0], RESULT_SIZE))
        if plan_rows(rows, out, self.packed[0]):
            self._reject(rows[out[:, RESULT_STATUS] == INVALID])
        return out

    def refuse(self, observations: NDArray[np.float64], rows: NDArray[np.float64]) -> None:
        """Raise InvalidValueError for the first stage 1 row whose result is invalid."""
        inputs = np.empty((len(rows), INPUTS))
        write_inputs(observations, rows, inputs)
        self._reject(inputs[rows[:, STATUS_COLUMN] == INVALID])

    def bounds(self, axis: int, trunk_angle: float) -> tuple[float, float, float]:
        """CoP bound [m], and lower and upper bound of the trunk acceleration [rad/s^2] at a lean angle."""
        low, high = acceleration_bounds(trunk_angle, self.constants)
        return (self.constants.cop_x, self.constants.cop_y)[axis], low, high

    def _plan_explicit(self, row: NDArray[np.float64]) -> CopPlan:
        """The same plan by OSQP, from the dense problem: slow, a second opinion."""
        exact = self.plan_batch(row[None])[0]
        if not (self.config.use_cop or self.config.use_trunk):
            return plan_of(exact, "solved")
        result = np.zeros(RESULT_SIZE)
        for axis in range(2):
            bounds = self.bounds(axis, row[LEAN + axis])
            dcm, angle, rate, target, reference = row[DCM + axis :: 2]
            problem = explicit_problem(
                self.robot, self.config, row[UNTIL], dcm, angle, rate, target, reference, *bounds
            )
            solution = solve_qp(problem.qp, "osqp")
            if solution.status != "solved":
                return plan_of(exact, "daqp")
            result[RESULT_COP + axis], result[RESULT_TRUNK + axis] = problem.first(solution.x)
            result[RESULT_DCM_END + axis] = problem.dcm_end(solution.x)
        return plan_of(result, "solved")

    def _reject(self, rows: NDArray[np.float64]) -> None:
        raise InvalidValueError(
            f"stage 2 needs finite states and at most {self.longest} s to touchdown, got {rows[0].tolist()}"
            " (remaining, dcm, trunk angle, trunk rate, dcm target, cop reference)"
        )
