"""Stage 2 in the paper's form: DCM acceleration and trunk jerk (eqs. 8-20), one program per axis.

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
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..jit import njit
from ..model.gait_box import COP, TRUNK, GaitLimits
from ..model.observation import ELAPSED, PREVIOUS_ACTION, TRUNK_ANGLE, TRUNK_RATE
from ..model.robot import RobotModel
from ..qp import LeastDistance, QuadraticProgram, solve_least_distance, solve_qp
from ..settings import PlannerConfig
from ..stage_1 import DCM_AHEAD, REMAINING, RESULT, TARGET
from . import problem
from .problem import acceleration_interval, constants_of

Floats = NDArray[np.float64]


class Workspace(NamedTuple):
    """Arrays of one horizon length N; rewritten by every solve.

    Inputs: N DCM accelerations, then N trunk jerks. Rows: Z_1..Z_N, theta''_1..N, theta_1..N (the last two
    only with the trunk in use).
    """

    soft: NDArray[np.bool_]  # (m,), rows of theta
    H: Floats  # (n, n)
    f: Floats  # (n,)
    A: Floats  # (m, n)
    offset: Floats  # (m,): the rows' values with zero inputs
    low: Floats  # (m,): low <= A x <= high
    high: Floats
    dcm: Floats  # (n + 1,): xi_T = dcm[0] + dcm[1:] . x
    M: Floats  # (m, n) = A R^-1 with H = R'R
    factor: Floats  # (n, n): L = R'
    x: Floats  # (n,): the unconstrained optimum, then the solution
    lower: Floats  # (m,): of M v
    upper: Floats
    v: Floats  # (n,)

    @classmethod
    def of(cls, nodes: int, use_trunk: bool) -> Workspace:
        """Allocate for N = nodes."""
        n, m = (2 * nodes, 3 * nodes) if use_trunk else (nodes, nodes)
        sizes = (n, n), n, (m, n), m, m, m, n + 1, (m, n), (n, n), n, m, m, n
        return cls(np.arange(m) >= 2 * nodes, *(np.zeros(size) for size in sizes))


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
def build(durations: Any, state: Any, numbers: Any, w: Workspace) -> None:
    """Cost and constraint rows, from the affine maps [constant, inputs] of the states along the horizon."""
    c = constants_of(numbers)
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
        share = d / c.sampling_time if k == 0 else 1.0
        _advance(d, k, N, c.use_trunk > 0.0, xi, dxi, theta, rate, acceleration)
        free = 0.0
        if c.repaired:
            growth = math.exp(c.omega * (time + d)) - math.exp(c.omega * time)
            free = c.omega * (dcm0 - reference) * growth / d
        w.H[k, k] += c.beta_dcm_acceleration * share
        w.f[k] -= c.beta_dcm_acceleration * share * free
        if c.use_trunk:
            w.H[N + k, N + k] += c.beta_trunk * share
            _add(c.beta_trunk_rate, rate, 0.0, w)
            _add(c.beta_trunk_angle if c.repaired else 0.0, theta, 0.0, w)
        for i in range(n + 1):
            z[i] = xi[i] - dxi[i] / c.omega - c.cmp_per_acceleration * acceleration[i]  # eq. 10
        _add(c.beta_cop, z, reference, w)
        w.offset[k], w.A[k, :] = z[0], z[1:]
        if c.use_trunk:
            w.offset[N + k], w.A[N + k, :] = acceleration[0], acceleration[1:]
            w.offset[2 * N + k], w.A[2 * N + k, :] = theta[0], theta[1:]
        time += d
    w.dcm[:] = xi
    _add(c.beta_dcm, xi, target, w)
    for i in range(n):
        for j in range(i):
            w.H[j, i] = w.H[i, j]
    # H = L L', x = -H^-1 f, M = A L'^-1
    L = w.factor
    problem.factorise(w.H, w.f.shape[0], L)
    w.x[:] = -w.f
    problem.solve_lower(L, w.x)
    problem.solve_upper(L, w.x)
    for r in range(w.A.shape[0]):
        w.M[r, :] = w.A[r, :]
        problem.solve_lower(L, w.M[r])


@njit(cache=True)
def write_bounds(axis: int, state: Any, numbers: Any, w: Workspace) -> None:
    """Bounds of the rows of A x, and of M v about the unconstrained optimum."""
    c = constants_of(numbers)
    cop_high, most = (c.cop_x, c.pitch) if axis == 0 else (c.cop_y, c.roll)
    cop_low = -cop_high
    if not c.use_cop:
        cop_low = cop_high = min(max(state[4], cop_low), cop_high)
    low, high = acceleration_interval(state[1], c.gravity, c.torque, most)
    N = w.A.shape[0] // 3 if c.use_trunk else w.A.shape[0]
    for i in range(w.A.shape[0]):
        if i < N:
            lower, upper = cop_low, cop_high
        elif i < 2 * N:
            lower, upper = low, high
        else:
            lower, upper = -c.angle, c.angle
        value = 0.0
        for j in range(w.A.shape[1]):
            value += w.A[i, j] * w.x[j]
        w.low[i], w.high[i] = lower - w.offset[i], upper - w.offset[i]
        w.lower[i], w.upper[i] = w.low[i] - value, w.high[i] - value


@njit(cache=True)
def write_result(
    period: float, axis: int, state: Any, add: bool, numbers: Any, w: Workspace, result: Any
) -> None:
    """CoP and trunk acceleration after `period` [s], and the DCM at touchdown, of x (+ L'^-1 v if `add`)."""
    c = constants_of(numbers)
    cop_max, most = (c.cop_x, c.pitch) if axis == 0 else (c.cop_y, c.roll)
    n = w.x.shape[0]
    if add:
        problem.solve_upper(w.factor, w.v)
        for i in range(n):
            w.x[i] += w.v[i]
    input_dcm = w.x[0]
    jerk = w.x[n // 2] if c.use_trunk else 0.0
    dxi = c.omega * (state[0] - state[5] - c.cmp_per_acceleration * state[6])
    xi = state[0] + period * dxi + period * period / 2 * input_dcm
    acceleration = state[6] + period * jerk
    cop = xi - (dxi + period * input_dcm) / c.omega - c.cmp_per_acceleration * acceleration
    result[problem.RESULT_COP + axis] = min(max(cop, -cop_max), cop_max)
    result[problem.RESULT_TRUNK + axis] = min(max(acceleration, -most), most)
    end = w.dcm[0]
    for i in range(n):
        end += w.dcm[1 + i] * w.x[i]
    result[problem.RESULT_DCM_END + axis] = end


class JerkCopPlanner(problem.Form):
    """Plans the CoP and the trunk acceleration with the paper's variables."""

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        """Prepare the planner; workspaces are set up when a horizon length first occurs.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
        """
        super().__init__(robot, limits, config)
        most = limits.trunk_acceleration_max
        self._numbers = problem.pack_constants(robot, limits, config, (most, most))
        self._workspaces: dict[int, tuple[Workspace, LeastDistance, LeastDistance]] = {}

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """See `Regulator`."""
        for obs, row in zip(observations, rows, strict=True):
            dcm, target = row[DCM_AHEAD : DCM_AHEAD + 2], row[TARGET : TARGET + 2]
            state = dcm, obs[TRUNK_ANGLE], obs[TRUNK_RATE], target, (0.0, 0.0), *self._previous(obs)
            row[RESULT:] = self.plan(float(row[REMAINING]), state)
        self.apply(observations, rows)

    def _previous(self, obs: Floats) -> tuple[Floats, Floats]:
        """CoP [m] and trunk acceleration [rad/s^2] in force; a new stance foot begins at the sole's centre.

        The previous action was made in the frame of its own step: its roll turns its sign at touchdown.
        """
        gait = self.limits.from_action(obs[PREVIOUS_ACTION])
        if obs[ELAPSED] < self.config.first_interval_min:
            return np.zeros(2), np.array([gait[TRUNK], -gait[TRUNK + 1]])
        return gait[COP : COP + 2], gait[TRUNK : TRUNK + 2]

    def plan(self, remaining: float, state: Floats | Sequence[ArrayLike]) -> Floats:
        """Plan from the present state to touchdown in `remaining` [s]; the result is (RESULT_SIZE,).

        Its CoP and trunk acceleration are those at the end of the control period, `first_interval_min`.
        The state (7, 2) is that of `CopPlanner.plan_batch` from the DCM on, then the CoP now, of this stance
        foot [m], with which xi' = omega (xi - CMP) (eq. 6b), and theta'' now [rad/s^2].

        Raises:
            InvalidValueError: a state that is not finite, or `remaining` is too long.
        """
        state = np.array(state, dtype=np.float64)
        if not (np.all(np.isfinite(state)) and remaining <= self.longest):
            raise InvalidValueError(
                f"stage 2 needs finite states and at most {self.longest} s to touchdown, got {remaining} s,"
                f" {state.tolist()}"
            )
        if not self.config.use_trunk:
            state[-1] = 0.0
        result = np.zeros(problem.RESULT_SIZE)
        statuses = [self._plan_axis(remaining, axis, state[:, axis], result) for axis in range(2)]
        result[problem.RESULT_STATUS] = statuses[0] if statuses[0] != problem.SOLVED else statuses[1]
        return result

    def program(
        self, remaining: float, axis: int, state: Floats, soft: bool | None = None
    ) -> QuadraticProgram:
        """The program of one axis, its state (7,) a column of that of `plan`.

        `soft` says whether theta may leave its bounds; by default as in the configured cost.
        """
        durations = problem.grid(self.config, max(remaining, problem.SHORTEST))
        workspace = self._assemble(durations, axis, state)[0]
        soft = self.config.jerk_cost == "repaired" if soft is None else soft
        weight = np.where(workspace.soft, self.config.beta_trunk_limit if soft else 0.0, 0.0)
        low, high = workspace.low.copy(), workspace.high.copy()
        return QuadraticProgram(workspace.H.copy(), workspace.f.copy(), workspace.A.copy(), low, high, weight)

    def _assemble(
        self, durations: Floats, axis: int, state: Floats
    ) -> tuple[Workspace, LeastDistance, LeastDistance]:
        """Arrays of the program, and its solvers with a hard and with a soft theta."""
        found = self._workspaces.get(durations.size)
        if found is None:
            workspace = Workspace.of(durations.size, self.config.use_trunk)
            weight = np.where(workspace.soft, self.config.beta_trunk_limit, 0.0)
            bounds = (workspace.lower, workspace.upper, workspace.v)
            hard = LeastDistance(workspace.M, np.zeros_like(weight), *bounds)
            found = workspace, hard, LeastDistance(workspace.M, weight, *bounds)
            self._workspaces[durations.size] = found
        build(durations, state, self._numbers, found[0])
        write_bounds(axis, state, self._numbers, found[0])
        return found

    def _plan_axis(self, remaining: float, axis: int, state: Floats, result: Floats) -> int:
        durations = problem.grid(self.config, max(remaining, problem.SHORTEST))
        workspace, hard, soft = self._assemble(durations, axis, state)
        status, add = problem.SOLVED, False
        if self.config.solver == "osqp":
            solution = solve_qp(self.program(remaining, axis, state), "osqp")
            if solution.status != "solved":
                solution = solve_qp(self.program(remaining, axis, state, soft=True), "osqp")
                status = problem.RELAXED if solution.status == "solved" else problem.CLIPPED
            if solution.status == "solved":
                workspace.x[:] = solution.x
        else:
            add = solve_least_distance((soft if self.config.jerk_cost == "repaired" else hard).handle) > 0
            if not add:
                add = solve_least_distance(soft.handle) > 0
                status = problem.RELAXED if add else problem.CLIPPED
        period = min(self.config.first_interval_min, durations[0])
        write_result(period, axis, state, add, self._numbers, workspace, result)
        return status
