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

No matrix is factorised in the loop. The program is |G u - r|^2, where u = (rest, first): `rest` are the CoPs
and trunk accelerations of the whole intervals, `first` those of the first interval, whose length depends on
the time that remains. Only the columns of `first` change with it, and they lie in the span of three fixed
directions of the residuals:

    T: the terminal DCM, weighted        S: unit trunk rate now        O: unit trunk angle now

and so does r, together with Z: the CoP reference of the whole intervals. With G_rest = Q R, projections
U_i = R^-1 Q' i and the Gram matrix of what is left of each direction, (1 - QQ') i, all that changes with a
tick is a combination of these vectors, which are tabulated for every horizon length. DAQP is called only if
the unconstrained optimum, so known in closed form, violates a bound.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..array_table import Floats1, Floats2, Floats3, Ints1, Ints2, dense_part_of, parts_table
from ..errors import InvalidValueError
from ..jit import njit
from ..model.gait_box import GaitLimits
from ..model.observation import TRUNK_ANGLE, TRUNK_RATE
from ..model.robot import RobotModel
from ..qp import LeastDistance, solve_least_distance
from ..settings import PlannerConfig
from ..stage_1 import DCM_AHEAD, REMAINING, RESULT, TARGET
from . import problem
from .problem import Constants, ExplicitProblem, acceleration_interval, constants_of

# dense_part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

# Columns of an input row, `CopPlanner.plan_batch`; of a pair (x, y) the first one
UNTIL = 0  # touchdown [s]
DCM = 1  # pair [m]
LEAN = 3  # pair [rad]
LEAN_RATE = 5  # pair [rad/s]
DCM_TARGET = 7  # pair [m]
COP_REFERENCE = 9  # pair [m]
INPUTS = 11

TERMINAL, RATE, ANGLE, REFERENCE = range(4)  # the directions T, S, O, Z
_ANGLE, _RATE = TRUNK_ANGLE.start, TRUNK_RATE.start


class Tables(NamedTuple):
    """Arrays of the compiled loop, one entry e for each horizon length N = e + 1, and its scratch.

    Rows of the constraint matrix M = A R_full^-1: one per input (bounds), then one per node (trunk angle).
    """

    numbers: Floats1  # (CONSTANTS,), see `Constants`
    box: Floats2  # (2, 7), of the gait variables: low, high
    rest: Ints1  # (E,): number of inputs of the whole intervals, n - first
    cops: Ints1  # (E,): how many of them are CoPs
    nodes: Ints1  # (E,): number of trunk nodes
    steps: Floats2  # (E, nodes): time of a node after the end of the first interval [s]
    inputs: Floats3  # (E, n, 4): U_i
    angles: Floats3  # (E, nodes, 4): trunk angle due to U_i
    weights: Floats2  # (E, n): terminal DCM per input, DCM - DCM_free = -weights . u
    gram: Floats3  # (E, 4, 4)
    # rewritten by every solve, one of each for a worker
    matrices: Floats2  # (E, rows * n): M, row after row without padding
    handles: Ints2  # (E, 6), of the solvers
    lower: Floats1  # (rows,)
    upper: Floats1
    optimum: Floats1  # (rows,): A u of the unconstrained optimum u
    solution: Floats1  # (n,)


class Parts(NamedTuple):
    """The only part of a worker's address table."""

    tables: Tables


def _empty_tables(numbers: Floats1, box: Floats2, config: PlannerConfig, horizons: int) -> Tables:
    """Tables of zeros for so many horizon lengths."""
    last = horizons - 1
    first = int(config.use_cop) + int(config.use_trunk)
    n = first + last * first + config.tail_intervals * config.use_trunk
    nodes = (last + config.tail_intervals + 1) * config.use_trunk
    zeros, ints = np.zeros, np.int64
    return Tables(
        numbers, box, zeros(horizons, ints), zeros(horizons, ints), zeros(horizons, ints),
        zeros((horizons, nodes)), zeros((horizons, n, 4)), zeros((horizons, nodes, 4)), zeros((horizons, n)),
        zeros((horizons, 4, 4)), zeros((horizons, (n + nodes) * n)), zeros((horizons, 6), ints),
        zeros(n + nodes), zeros(n + nodes), zeros(n + nodes), zeros(n),
    )  # fmt: skip


def _write_horizon(robot: RobotModel, config: PlannerConfig, e: int, tables: Tables) -> None:
    """The entry of N = e + 1 intervals until touchdown, the first of them partial."""
    dt = config.sampling_time
    durations = np.array([dt] * e + [config.tail_sampling_time] * config.tail_intervals)
    cops = e if config.use_cop else 0
    accelerations = durations.size if config.use_trunk else 0
    nodes = accelerations + 1 if config.use_trunk else 0
    steps = np.concatenate([[0.0], np.cumsum(durations)])[:nodes]
    k, j = np.arange(nodes)[:, None], np.arange(accelerations)[None, :]
    rate = np.where(j < k, durations[j], 0.0)  # (nodes, accelerations): trunk rate by acceleration
    angle = np.where(j < k, durations[j] * (steps[k] - steps[j + 1] + durations[j] / 2), 0.0)
    growth = math.exp(robot.omega * dt)
    # e^{w (touchdown - end)} (e^{w dt} - 1) of each whole interval
    dcm = (growth - 1) * growth ** np.arange(e - 1, -1, -1.0)
    weights = np.zeros(cops + accelerations)
    weights[:cops] = dcm[:cops]
    count = min(accelerations, e)
    weights[cops : cops + count] = robot.cmp_per_trunk_acceleration * dcm[:count]
    if config.trunk_debt and accelerations:
        decay = np.exp(-robot.omega * (steps[e:] - steps[e]))
        weights[cops + e :] = -robot.cmp_per_trunk_acceleration * np.diff(decay)

    G, directions = _residuals(config, weights, rate, angle, steps)
    Q, R = np.linalg.qr(G)
    projected = Q.T @ directions
    left = directions - Q @ projected
    n = weights.size
    inverse = np.linalg.inv(R) if n else np.zeros((0, 0))
    selector = np.zeros((nodes, n))
    selector[:, cops:] = angle
    tables.rest[e], tables.cops[e], tables.nodes[e] = n, cops, nodes
    tables.steps[e, :nodes], tables.weights[e, :n] = steps, weights
    tables.inputs[e, :n] = inverse @ projected
    tables.angles[e, :nodes] = selector @ (inverse @ projected)
    tables.gram[e] = left.T @ left
    first = int(config.use_cop) + int(config.use_trunk)
    matrix = tables.matrices[e, : (n + first + nodes) * (n + first)].reshape(n + first + nodes, n + first)
    matrix[:n, :n], matrix[n + first :, :n] = inverse, selector @ inverse


def _residuals(
    config: PlannerConfig, weights: Floats1, rate: Floats2, angle: Floats2, steps: Floats1
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """G and the directions T, S, O, Z (rows, 4) of a horizon.

    Rows: own weights of the inputs, terminal DCM, rates, angles. Columns of G: CoPs, accelerations. `weights`
    (n,) of the inputs in the terminal DCM; `rate` and `angle` (nodes, accelerations) of the trunk that an
    acceleration leads to; `steps` (nodes,) time of a node [s].
    """
    nodes, accelerations = rate.shape
    cops = weights.size - accelerations
    own = np.sqrt(np.concatenate([np.full(cops, config.beta_cop), np.full(accelerations, config.beta_trunk)]))
    n = own.size
    dcm_scale = math.sqrt(config.beta_dcm)
    rate_scale, angle_scale = math.sqrt(config.beta_trunk_rate), math.sqrt(config.beta_trunk_angle)
    G = np.zeros((n + 1 + 2 * nodes, n))
    G[:n] = np.diag(own)
    G[n] = dcm_scale * weights
    G[n + 1 : n + 1 + nodes, cops:] = rate_scale * rate
    G[n + 1 + nodes :, cops:] = angle_scale * angle
    directions = np.zeros((len(G), 4))
    directions[n, TERMINAL] = dcm_scale
    directions[n + 1 : n + 1 + nodes, RATE] = rate_scale
    directions[n + 1 + nodes :, RATE] = angle_scale * steps
    directions[n + 1 + nodes :, ANGLE] = angle_scale
    directions[:cops, REFERENCE] = own[:cops]
    return G, directions


class AxisState(NamedTuple):
    """Start, target and bounds of one axis."""

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


@njit(cache=True, forceinline=True)
def write_inputs(observations: Any, rows: Any, inputs: Any) -> None:
    """Input rows (n, 11) of observations and their stage 1 rows; the CoP's reference is the sole's centre."""
    for i in range(rows.shape[0]):
        obs, row, out = observations[i], rows[i], inputs[i]
        out[UNTIL] = row[REMAINING]
        for axis in range(2):
            out[DCM + axis] = row[DCM_AHEAD + axis]
            out[LEAN + axis], out[LEAN_RATE + axis] = obs[_ANGLE + axis], obs[_RATE + axis]
            out[DCM_TARGET + axis] = row[TARGET + axis]
            out[COP_REFERENCE + axis] = 0.0


@njit(cache=True, nogil=True)
def regulate_rows(observations: Any, rows: Any, packed: Any) -> int:
    """Stage 2 of stage 1 rows, in place; returns how many were invalid; see `Regulator.regulate`."""
    t, inputs = dense_part_of(packed, Parts, "tables"), np.empty((rows.shape[0], INPUTS))
    write_inputs(observations, rows, inputs)
    c = constants_of(t.numbers)
    invalid = _plan_rows(inputs, rows[:, RESULT:], c, t)
    if invalid == 0:
        problem.apply_results(observations, rows, t.box, c.use_cop > 0.0, c.use_trunk > 0.0)
    return invalid


@njit(cache=True, nogil=True)
def plan_rows(rows: Any, out: Any, packed: Any) -> int:
    """Plan every row of (n, 11) into (n, 7); returns how many were invalid; see `CopPlanner.plan_batch`."""
    t = dense_part_of(packed, Parts, "tables")
    return _plan_rows(rows, out, constants_of(t.numbers), t)


@njit(cache=True, forceinline=True)
def _plan_rows(rows: Any, out: Any, c: Constants, t: Tables) -> int:
    invalid = 0
    for i in range(rows.shape[0]):
        row = rows[i]
        finite = True
        for k in range(row.shape[0]):
            finite = finite and math.isfinite(row[k])
        remaining = max(row[UNTIL], problem.SHORTEST)
        whole = int(max(math.floor((remaining - c.first_interval_min) / c.sampling_time + 1e-9), 0.0))
        if not finite or whole >= len(t.rest):
            out[i, problem.RESULT_STATUS] = problem.INVALID
            invalid += 1
            continue
        out[i, problem.RESULT_STATUS] = problem.SOLVED
        for axis in range(2):
            _plan_axis(whole, remaining, row, axis, c, t, out[i])
    return invalid


@njit(cache=True, forceinline=True)
def _axis_state(row: Any, axis: int, remaining: float, c: Constants) -> AxisState:
    """State and bounds of one axis of an input row."""
    dcm, angle, reference = row[DCM + axis], row[LEAN + axis], row[COP_REFERENCE + axis]
    cop_max, most = (c.cop_x, c.pitch) if axis == 0 else (c.cop_y, c.roll)
    growth = math.exp(c.omega * remaining)
    free = growth * dcm
    if not c.use_cop:
        reference = min(max(reference, -cop_max), cop_max)
        free -= (growth - 1.0) * reference
    low, high = acceleration_interval(angle, c.gravity, c.torque, most)
    rate, target = row[LEAN_RATE + axis], row[DCM_TARGET + axis]
    return AxisState(dcm, angle, rate, target, reference, cop_max, low, high, growth, free)


@njit(cache=True, forceinline=True)
def _plan_axis(e: int, remaining: float, row: Any, axis: int, c: Constants, t: Tables, out: Any) -> None:
    """Plan one axis of an input row over horizon e: CoP, trunk acceleration, DCM at touchdown, status."""
    state = _axis_state(row, axis, remaining, c)
    cop, acceleration, end = state.reference, 0.0, state.free
    rest = t.rest[e]
    n = rest + int(c.use_cop) + int(c.use_trunk)
    if n > 0:
        first = _first_interval(t.gram[e], remaining - e * c.sampling_time, state, c)
        _write_optimum(e, first, state, c, t)
        if not _write_bounds(e, state, c, t):
            _write_first_columns(e, first, c, t)
            if not _move_inside(e, n, t):
                out[problem.RESULT_STATUS] = max(out[problem.RESULT_STATUS], problem.CLIPPED)
        y = t.optimum
        for i in range(rest):
            end -= t.weights[e, i] * y[i]
        if c.use_cop:
            cop = min(max(y[rest], -state.cop_max), state.cop_max)
            end -= first.kz[TERMINAL] * cop
        if c.use_trunk:
            acceleration = min(max(y[n - 1], state.low), state.high)
            end -= first.ka[TERMINAL] * acceleration
    out[problem.RESULT_COP + axis], out[problem.RESULT_TRUNK + axis] = cop, acceleration
    out[problem.RESULT_DCM_END + axis] = end


@njit(cache=True, forceinline=True)
def _first_interval(gram: Any, span: float, state: AxisState, c: Constants) -> FirstInterval:
    """Columns of the first interval, its unconstrained z_0 and a_0, and the lower right corner of R.

    The Schur complement of the first interval's inputs in G'G, with the Gram matrix of what the other inputs
    leave of each direction: S_ij = own_i + k_i' gram k_j, S u = own reference + k' gram k_r.
    """
    share = span / c.sampling_time
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
def _write_optimum(e: int, first: FirstInterval, state: AxisState, c: Constants, t: Tables) -> None:
    """The unconstrained optimum: the inputs, then the trunk angles at the nodes."""
    rest, y = t.rest[e], t.optimum
    n = rest + int(c.use_cop) + int(c.use_trunk)
    U, V, steps, span, ka, kr = t.inputs[e], t.angles[e], t.steps[e], first.span, first.ka, first.kr
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
    for k in range(t.nodes[e]):
        y[n + k] = (
            k0 * V[k, TERMINAL] + k1 * V[k, RATE] + k2 * V[k, ANGLE] + k3 * V[k, REFERENCE]
            + state.angle + (span + steps[k]) * state.rate + (ka[ANGLE] + span * steps[k]) * first.ua
        )  # fmt: skip


@njit(cache=True, forceinline=True)
def _write_bounds(e: int, state: AxisState, c: Constants, t: Tables) -> bool:
    """How far the optimum may move down and up, by rows of the constraints; True where it may stay."""
    rest, cops, y = t.rest[e], t.cops[e], t.optimum
    n = rest + int(c.use_cop) + int(c.use_trunk)
    inside = True
    for i in range(n + t.nodes[e]):
        is_cop = i < cops or (i == rest and c.use_cop > 0.0)
        lower = -state.cop_max if is_cop else state.low if i < n else -c.angle
        upper = state.cop_max if is_cop else state.high if i < n else c.angle
        t.lower[i], t.upper[i] = lower - y[i], upper - y[i]
        inside = inside and lower <= y[i] <= upper
    return inside


@njit(cache=True, forceinline=True)
def _move_inside(e: int, n: int, t: Tables) -> bool:
    """Move the inputs of the optimum to the constrained one; False where the solver fails."""
    if solve_least_distance(t.handles[e]) <= 0:
        return False
    M, v, y = t.matrices[e], t.solution, t.optimum
    for i in range(n):
        for j in range(n):
            y[i] += M[i * n + j] * v[j]
    return True


@njit(cache=True, forceinline=True)
def _write_first_columns(e: int, first: FirstInterval, c: Constants, t: Tables) -> None:
    """The columns of M = A R^-1 that belong to the first interval: z_0, then a_0."""
    rest, kz, ka = t.rest[e], first.kz, first.ka
    n = rest + int(c.use_cop) + int(c.use_trunk)
    U, V, steps, M = t.inputs[e], t.angles[e], t.steps[e], t.matrices[e]
    for i in range(n + t.nodes[e]):
        d_t = d_s = d_o = 0.0
        if i < rest:
            d_t, d_s, d_o = U[i, TERMINAL], U[i, RATE], U[i, ANGLE]
        elif i >= n:
            d_t, d_s, d_o = V[i - n, TERMINAL], V[i - n, RATE], V[i - n, ANGLE]
        column = 0.0
        if c.use_cop:
            column = ((1.0 if i == rest else 0.0) - kz[TERMINAL] * d_t) / first.l11
            M[i * n + rest] = column
        if c.use_trunk:
            own = 1.0 if i == n - 1 else 0.0
            if i >= n:
                own = ka[ANGLE] + first.span * steps[i - n]
            along = own - ka[TERMINAL] * d_t - ka[RATE] * d_s - ka[ANGLE] * d_o
            M[i * n + n - 1] = (along - column * first.l12) / first.l22


class CopPlanner(problem.Form):
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
            workers: parts of `packed`; `plan_batch` uses the first, OSQP's the only one.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
        """
        super().__init__(robot, limits, config)
        self._second_opinion = config.solver == "osqp"
        self.workers = 1 if self._second_opinion else workers
        most = limits.trunk_acceleration_max
        numbers = problem.pack_constants(robot, limits, config, (most, most))
        self.constants = Constants(*numbers.tolist())
        horizons = math.ceil(self.longest / config.sampling_time)
        tables = _empty_tables(numbers, limits.box, config, horizons)
        for e in range(horizons):
            _write_horizon(robot, config, e, tables)
        # the address tables hold no references: arrays and solvers live as long as the planner does
        self._tables = [self._with_own_scratch(tables) for _ in range(self.workers)]
        self._solvers = [solver for own in self._tables for solver in self._make_solvers(own)]
        self.packed = [parts_table(Parts(own)) for own in self._tables]  # one for each worker

    def __reduce__(self) -> tuple[Any, ...]:
        return CopPlanner, (self.robot, self.limits, self.config, self.workers)

    @staticmethod
    def _with_own_scratch(tables: Tables) -> Tables:
        scratch = ("matrices", "handles", "lower", "upper", "optimum", "solution")
        return tables._replace(**{name: getattr(tables, name).copy() for name in scratch})

    def _make_solvers(self, tables: Tables) -> list[LeastDistance]:
        first = int(self.config.use_cop) + int(self.config.use_trunk)
        solvers = []
        for e, (rest, k) in enumerate(zip(tables.rest.tolist(), tables.nodes.tolist(), strict=True)):
            n = rest + first
            if n == 0:
                continue
            matrix = tables.matrices[e, : (n + k) * n].reshape(n + k, n)
            soft = np.concatenate([np.zeros(n), np.full(k, self.config.beta_trunk_limit)])
            bounds = tables.lower[: n + k], tables.upper[: n + k]
            solvers.append(LeastDistance(matrix, soft, *bounds, tables.solution[:n]))
            tables.handles[e] = solvers[-1].handle
        return solvers

    def regulate(self, observations: NDArray[np.float64], rows: NDArray[np.float64], worker: int = 0) -> None:
        """See `Regulator`."""
        if not self._second_opinion and regulate_rows(observations, rows, self.packed[worker]) == 0:
            return
        inputs = np.empty((len(rows), INPUTS))
        write_inputs(observations, rows, inputs)
        rows[:, RESULT:] = self.plan_batch(inputs)
        self.apply(observations, rows)

    def plan_batch(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Plan n robots by DAQP in one compiled loop, and once more by OSQP where that is the solver.

        Args:
            rows: (n, 11): time to touchdown, at most `longest`, planned as `SHORTEST` where it is less [s];
                measured DCM (2) [m], lean towards +x and +y (2) [rad] and its rate (2) [rad/s], DCM wanted at
                touchdown, u_T + b_nom (eq. 7), (2) [m], CoP reference (2) [m].

        Returns:
            (n, 7): cop (2), trunk acceleration (2), predicted dcm at touchdown (2), index into `STATUS`.

        Raises:
            InvalidValueError: another shape, a row that is not finite, or one whose time is too long.
        """
        rows = problem.as_rows(rows, INPUTS)
        out = np.zeros((rows.shape[0], problem.RESULT_SIZE))
        if plan_rows(rows, out, self.packed[0]):
            first = rows[out[:, problem.RESULT_STATUS] == problem.INVALID][0]
            raise InvalidValueError(
                f"stage 2 needs finite states and at most {self.longest} s to touchdown, got {first.tolist()}"
                " (remaining, dcm, trunk angle, trunk rate, dcm target, cop reference)"
            )
        if self._second_opinion and (self.config.use_cop or self.config.use_trunk):
            for row, result in zip(rows, out, strict=True):
                programs = [self.program(row, axis) for axis in range(2)]
                problem.solve_again([(program.qp, [program]) for program in programs], result)
        return out

    def program(self, row: NDArray[np.float64], axis: int) -> ExplicitProblem:
        """The dense program of one axis of an input row (11,)."""
        c, until = self.constants, problem.grid(self.config, max(row[UNTIL], problem.SHORTEST))
        dcm, angle, rate, target, reference = row[DCM + axis :: 2]
        cop_max, most = ((c.cop_x, c.pitch), (c.cop_y, c.roll))[axis]
        if not self.config.use_cop:
            reference = min(max(reference, -cop_max), cop_max)
        return problem.explicit_problem(
            self.robot, self.config, until, 1, np.array([dcm, angle, rate, target]),
            np.repeat([[reference], [-cop_max], [cop_max]], until.size, axis=1),
            acceleration_interval(angle, c.gravity, c.torque, most),
        )  # fmt: skip
