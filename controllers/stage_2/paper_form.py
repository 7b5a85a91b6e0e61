"""Stage 2 in the paper's form: DCM acceleration and trunk jerk (eqs. 8-20), one program per axis.

Compiled assembly of the paper's second stage: eqs. 8-20 as a program, and as a least-distance problem.

Stage 2 in the paper's form: DCM acceleration and trunk jerk (eqs. 8-20), one program per axis.

State (xi, xi', theta, theta', theta''), inputs (xi'', theta''') constant over each interval, A and B of eqs.
11-14, output z = xi - xi'/omega - j/(m g) theta'' (eq. 10). With N nodes until touchdown,

    min   beta_cop |Z - z_ref|^2 + beta_dcm_acceleration |xi'' - ref|^2 + beta_trunk |theta'''|^2
        + beta_trunk_rate |theta'|^2 + beta_dcm (xi_T - xi_des)^2
    s.t.  |j theta'' - gravity torque| <= tau_max,  |theta| <= theta_max,  |Z| <= sole - margin

`literal` is eq. 20 as written: ref = 0 and a hard theta. It does not walk: with xi'' penalised itself, the
CoP leaves its reference even where the motion is nominal, and theta may have no feasible plan; the limit is
then relaxed and the plan's status says "relaxed". `repaired` penalises the deviation from the DCM's free
motion, ref = mean of omega^2 (xi - z_ref) e^{omega t} over the interval, adds beta_trunk_angle |theta|^2 and
makes theta soft (weight beta_trunk_limit), so that every state has a plan.

The paper's grid is uniform; here its first interval takes what is left over of the time until touchdown, and
its inputs are weighted by their share of an interval.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError, UnknownNameError
from ..jit import njit
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from ..qp import LeastDistance, QuadraticProgram, solve_least_distance, solve_qp
from ..settings import PlannerConfig
from .problem import SHORTEST, CopPlan, cop_bounds, grid, require_positive
from .single_support import LONGEST_MARGIN, acceleration_interval


class Constants(NamedTuple):
    """Scalars of the problem."""

    omega: float
    cmp_per_acceleration: float
    angle: float  # [rad]
    dt: float
    beta_cop: float
    beta_dcm_acceleration: float
    beta_jerk: float
    beta_rate: float
    beta_angle: float
    repaired: bool
    use_trunk: bool


class Workspace(NamedTuple):
    """Arrays of one horizon length N; rewritten by every solve.

    Inputs: N DCM accelerations, then N trunk jerks. Rows: Z_1..Z_N, theta''_1..N, theta_1..N (the last two
    only with the trunk in use).
    """

    H: NDArray[np.float64]  # (n, n)
    f: NDArray[np.float64]  # (n,)
    A: NDArray[np.float64]  # (m, n)
    offset: NDArray[np.float64]  # (m,): the rows' values with zero inputs
    low: NDArray[np.float64]  # (m,): low <= A x <= high
    high: NDArray[np.float64]
    soft: NDArray[np.bool_]  # (m,)
    dcm: NDArray[np.float64]  # (n + 1,): xi_T = dcm[0] + dcm[1:] . x
    M: NDArray[np.float64]  # (m, n) = A R^-1 with H = R'R
    factor: NDArray[np.float64]  # (n, n): L = R'
    x: NDArray[np.float64]  # (n,): the unconstrained optimum, then the solution
    lower: NDArray[np.float64]  # (m,): of M v
    upper: NDArray[np.float64]
    v: NDArray[np.float64]  # (n,)

    @classmethod
    def of(cls, nodes: int, use_trunk: bool) -> Workspace:
        """Allocate for N = nodes."""
        n, m = (2 * nodes, 3 * nodes) if use_trunk else (nodes, nodes)
        soft = np.arange(m) >= 2 * nodes
        return cls(
            np.zeros((n, n)), np.zeros(n), np.zeros((m, n)), np.zeros(m), np.zeros(m), np.zeros(m), soft,
            np.zeros(n + 1), np.zeros((m, n)), np.zeros((n, n)), np.zeros(n), np.zeros(m), np.zeros(m),
            np.zeros(n),
        )  # fmt: skip


@njit(cache=True)
def _add(weight: float, row: Any, target: float, w: Workspace) -> None:
    """Add weight (row[0] + row[1:] . x - target)^2 / 2 to the cost (lower triangle of H)."""
    if weight == 0.0:
        return
    n = w.f.shape[0]
    for i in range(n):
        scaled = weight * row[1 + i]
        if scaled != 0.0:
            w.f[i] += scaled * (row[0] - target)
            for j in range(i + 1):
                w.H[i, j] += scaled * row[1 + j]


@njit(cache=True)
def _advance(
    d: float, k: int, N: int, use_trunk: bool, xi: Any, dxi: Any, theta: Any, rate: Any, acceleration: Any
) -> None:
    """The affine maps of the states over interval k of d [s], eqs. 11-14."""
    for i in range(xi.shape[0]):
        xi[i] += d * dxi[i]
        theta[i] += d * rate[i] + d * d / 2 * acceleration[i]
        rate[i] += d * acceleration[i]
    xi[1 + k] += d * d / 2
    dxi[1 + k] += d
    if use_trunk:
        theta[1 + N + k] += d * d * d / 6
        rate[1 + N + k] += d * d / 2
        acceleration[1 + N + k] += d


@njit(cache=True)
def build(durations: Any, state: Any, beta_dcm: float, c: Constants, w: Workspace) -> None:
    """Cost and constraint rows, from the affine maps [constant, inputs] of the states along the horizon."""
    N, n = durations.shape[0], w.f.shape[0]
    dcm0, target, reference = state[0], state[3], state[4]
    w.H[:], w.f[:], w.A[:] = 0.0, 0.0, 0.0
    xi, dxi = np.zeros(n + 1), np.zeros(n + 1)
    theta, rate, acceleration, z = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    xi[0], theta[0], rate[0], acceleration[0] = dcm0, state[1], state[2], state[6]
    dxi[0] = c.omega * (dcm0 - state[5] - c.cmp_per_acceleration * state[6])  # eq. 6b
    time = 0.0
    for k in range(N):
        d = durations[k]
        share = d / c.dt if k == 0 else 1.0
        _advance(d, k, N, c.use_trunk, xi, dxi, theta, rate, acceleration)
        free = 0.0
        if c.repaired:
            free = (
                c.omega * (dcm0 - reference) * (math.exp(c.omega * (time + d)) - math.exp(c.omega * time)) / d
            )
        w.H[k, k] += c.beta_dcm_acceleration * share
        w.f[k] -= c.beta_dcm_acceleration * share * free
        if c.use_trunk:
            w.H[N + k, N + k] += c.beta_jerk * share
            _add(c.beta_rate, rate, 0.0, w)
            _add(c.beta_angle, theta, 0.0, w)
        for i in range(n + 1):
            z[i] = xi[i] - dxi[i] / c.omega - c.cmp_per_acceleration * acceleration[i]  # eq. 10
        _add(c.beta_cop, z, reference, w)
        _set_row(k, z, w)
        if c.use_trunk:
            _set_row(N + k, acceleration, w)
            _set_row(2 * N + k, theta, w)
        time += d
    w.dcm[:] = xi
    _add(beta_dcm, xi, target, w)
    for i in range(n):
        for j in range(i):
            w.H[j, i] = w.H[i, j]
    _whiten(w)


@njit(cache=True)
def _set_row(i: int, row: Any, w: Workspace) -> None:
    w.offset[i] = row[0]
    w.A[i, :] = row[1:]


@njit(cache=True)
def _whiten(w: Workspace) -> None:
    """H = L L', x = -H^-1 f, M = A L'^-1."""
    n, L = w.f.shape[0], w.factor
    for i in range(n):
        for j in range(i + 1):
            total = w.H[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(total) if i == j else total / L[j, j]
    for i in range(n):
        w.x[i] = -w.f[i]
    _forward(L, w.x)
    _backward(L, w.x)
    for r in range(w.A.shape[0]):
        w.M[r, :] = w.A[r, :]
        _forward(L, w.M[r])


@njit(cache=True)
def _forward(L: Any, b: Any) -> None:
    """Solve L x = b in place of b."""
    for i in range(b.shape[0]):
        total = b[i]
        for k in range(i):
            total -= L[i, k] * b[k]
        b[i] = total / L[i, i]


@njit(cache=True)
def _backward(L: Any, b: Any) -> None:
    """Solve L' x = b in place of b."""
    for i in range(b.shape[0] - 1, -1, -1):
        b[i] /= L[i, i]
        for k in range(i):
            b[k] -= L[i, k] * b[i]


@njit(cache=True)
def write_bounds(
    cop_low: float, cop_high: float, low: float, high: float, angle: float, w: Workspace
) -> None:
    """Bounds of the rows of A x, and of M v about the unconstrained optimum."""
    N = w.A.shape[0] if w.A.shape[0] == w.A.shape[1] else w.A.shape[0] // 3
    for i in range(w.A.shape[0]):
        if i < N:
            lower, upper = cop_low, cop_high
        elif i < 2 * N:
            lower, upper = low, high
        else:
            lower, upper = -angle, angle
        value = 0.0
        for j in range(w.A.shape[1]):
            value += w.A[i, j] * w.x[j]
        w.low[i], w.high[i] = lower - w.offset[i], upper - w.offset[i]
        w.lower[i], w.upper[i] = w.low[i] - value, w.high[i] - value


@njit(cache=True)
def outputs(period: float, state: Any, add: bool, c: Constants, w: Workspace, result: Any) -> None:
    """CoP and trunk acceleration after `period` [s], and the DCM at touchdown, of x (+ L'^-1 v if `add`)."""
    n = w.x.shape[0]
    if add:
        _backward(w.factor, w.v)
        for i in range(n):
            w.x[i] += w.v[i]
    input_dcm = w.x[0]
    jerk = w.x[n // 2] if c.use_trunk else 0.0
    dxi = c.omega * (state[0] - state[5] - c.cmp_per_acceleration * state[6])
    xi = state[0] + period * dxi + period * period / 2 * input_dcm
    acceleration = state[6] + period * jerk
    result[0] = xi - (dxi + period * input_dcm) / c.omega - c.cmp_per_acceleration * acceleration
    result[1] = acceleration
    result[2] = w.dcm[0]
    for i in range(n):
        result[2] += w.dcm[1 + i] * w.x[i]


COSTS = ("literal", "repaired")


class JerkCopPlanner:
    """Plans the CoP and the trunk acceleration with the paper's variables."""

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        """Prepare the planner; workspaces are set up when a horizon length first occurs.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
            UnknownNameError: `config.jerk_cost` is not one of `COSTS`.
        """
        if config.jerk_cost not in COSTS:
            raise UnknownNameError("jerk cost", config.jerk_cost, COSTS)
        require_positive(config, "beta_dcm_acceleration", "beta_trunk", "beta_trunk_limit")
        self.robot, self.limits, self.config = robot, limits, config
        self.cop_max = cop_bounds(limits, config)
        self.longest = limits.duration_max + LONGEST_MARGIN
        repaired = config.jerk_cost == "repaired"
        self.constants = Constants(
            robot.omega, robot.cmp_per_trunk_acceleration, robot.trunk_angle_max, config.sampling_time,
            config.beta_cop, config.beta_dcm_acceleration, config.beta_trunk, config.beta_trunk_rate,
            config.beta_trunk_angle if repaired else 0.0, repaired, config.use_trunk,
        )  # fmt: skip
        self._workspaces: dict[int, tuple[Workspace, LeastDistance, LeastDistance]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return JerkCopPlanner, (self.robot, self.limits, self.config)

    def plan(
        self,
        remaining: float,
        dcm: ArrayLike,
        trunk_angle: ArrayLike,
        trunk_rate: ArrayLike,
        dcm_target: ArrayLike,
        cop_reference: ArrayLike = (0.0, 0.0),
        previous_cop: ArrayLike = (0.0, 0.0),
        previous_trunk_acceleration: ArrayLike = (0.0, 0.0),
    ) -> CopPlan:
        """Plan from the present state to touchdown; see `CopPlanner.plan`.

        The result is the CoP and the trunk acceleration at the end of the coming control period (which is
        `first_interval_min`): the `previous_cop` and `previous_trunk_acceleration` of the next call.

        Args:
            remaining: time to touchdown [s].
            dcm: (2,) [m].
            trunk_angle: (2,) [rad].
            trunk_rate: (2,) [rad/s].
            dcm_target: (2,) [m].
            cop_reference: (2,) [m].
            previous_cop: (2,) CoP now, of this stance foot; with it xi' = omega (xi - CMP) (eq. 6b) [m].
            previous_trunk_acceleration: (2,) theta'' now [rad/s^2].
        """
        state = self._state(
            remaining, dcm, trunk_angle, trunk_rate, dcm_target, cop_reference, previous_cop,
            previous_trunk_acceleration,
        )  # fmt: skip
        durations = grid(self.config, max(remaining, SHORTEST))
        result, statuses = np.zeros((3, 2)), []
        for axis in range(2):
            status = self._plan_axis(durations, remaining, axis, state[:, axis], result[:, axis])
            statuses.append(status)
        result.flags.writeable = False
        status = next((s for s in statuses if s != "solved"), "solved")
        return CopPlan(result[0], result[1], result[2], status)

    def _state(self, remaining: float, *vectors: ArrayLike) -> NDArray[np.float64]:
        """The vectors that `plan` takes, (7, 2).

        Raises:
            InvalidValueError: one has the wrong shape or is not finite, or `remaining` is too long.
        """
        try:
            state = np.array(vectors, dtype=np.float64).reshape(len(vectors), 2)
        except (ValueError, TypeError) as error:
            raise InvalidValueError(f"stage 2 takes vectors of 2 numbers: {error}") from None
        if not (np.all(np.isfinite(state)) and remaining <= self.longest):
            raise InvalidValueError(
                f"stage 2 needs finite states and at most {self.longest} s to touchdown, got {remaining} s,"
                f" {state.tolist()}"
            )
        if not self.config.use_trunk:
            state[-1] = 0.0
        return state

    def program(
        self, remaining: float, axis: int, state: NDArray[np.float64], soft: bool | None = None
    ) -> QuadraticProgram:
        """The program of one axis; state: (7,) as the arguments of `plan` from `dcm` on."""
        durations = grid(self.config, max(remaining, SHORTEST))
        workspace = self._assemble(durations, axis, state)[0]
        soft = self.constants.repaired if soft is None else soft
        weight = np.where(workspace.soft, self.config.beta_trunk_limit if soft else 0.0, 0.0)
        low, high = workspace.low.copy(), workspace.high.copy()
        return QuadraticProgram(workspace.H.copy(), workspace.f.copy(), workspace.A.copy(), low, high, weight)

    def _assemble(
        self, durations: NDArray[np.float64], axis: int, state: NDArray[np.float64]
    ) -> tuple[Workspace, LeastDistance, LeastDistance]:
        found = self._workspaces.get(durations.size)
        if found is None:
            found = self._workspaces[durations.size] = self._allocate(durations.size)
        workspace = found[0]
        build(durations, state, self.config.beta_dcm, self.constants, workspace)
        cop_low, cop_high = -self.cop_max[axis], self.cop_max[axis]
        if not self.config.use_cop:
            cop_low = cop_high = min(max(state[4], cop_low), cop_high)
        torque = self.robot.trunk_torque_max / self.robot.trunk_inertia
        gravity = self.config.trunk_gravity / self.robot.trunk_inertia
        low, high = acceleration_interval(state[1], gravity, torque, self.limits.trunk_acceleration_max)
        write_bounds(cop_low, cop_high, low, high, self.constants.angle, workspace)
        return found

    def _allocate(self, nodes: int) -> tuple[Workspace, LeastDistance, LeastDistance]:
        workspace = Workspace.of(nodes, self.config.use_trunk)
        weight = np.where(workspace.soft, self.config.beta_trunk_limit, 0.0)
        bounds = (workspace.lower, workspace.upper, workspace.v)
        hard = LeastDistance(workspace.M, np.zeros_like(weight), *bounds)
        return workspace, hard, LeastDistance(workspace.M, weight, *bounds)

    def _plan_axis(
        self,
        durations: NDArray[np.float64],
        remaining: float,
        axis: int,
        state: NDArray[np.float64],
        result: NDArray[np.float64],
    ) -> str:
        """Fill (cop, trunk acceleration, dcm at touchdown) and return the status."""
        workspace, hard, soft = self._assemble(durations, axis, state)
        period, status = min(self.config.first_interval_min, durations[0]), "solved"
        if self.config.solver == "osqp":
            solution = solve_qp(self.program(remaining, axis, state), "osqp")
            if solution.status != "solved":
                solution = solve_qp(self.program(remaining, axis, state, soft=True), "osqp")
                status = "relaxed" if solution.status == "solved" else "clipped"
            if solution.status == "solved":
                workspace.x[:] = solution.x
            outputs(period, state, False, self.constants, workspace, result)
        else:
            flag = solve_least_distance((soft if self.constants.repaired else hard).handle)
            if flag <= 0:
                flag = solve_least_distance(soft.handle)
                status = "relaxed" if flag > 0 else "clipped"
            outputs(period, state, flag > 0, self.constants, workspace, result)
        result[0] = min(max(result[0], -self.cop_max[axis]), self.cop_max[axis])
        limit = self.limits.trunk_acceleration_max
        result[1] = min(max(result[1], -limit), limit)
        return status
