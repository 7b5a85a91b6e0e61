"""The largest push that any trajectory survives, by a linear program over trajectories.

This is the oracle of `capturability`: it shares no formula with it. Unknown are the impulse J of the push,
the CoP z_k in the sole, the trunk's acceleration a_k and the steps u_j; the durations of the steps are given,
since the DCM is not linear in them. Between nodes of a time grid, h_k apart, the inputs are constant. Per
axis, canonical frame of the first step, lambda_k = exp(omega h_k), sigma_j = 1 along x and (-1)^j along y:

    maximise  J >= 0  subject to
    xi_{k+1}    = lambda_k xi_k - (lambda_k - 1) c_k
    c_k         = sum_{j < step(k)} sigma_j u_j + z_k + (j / (m g)) a_k - J e on_k / (Delta m omega^2)
    theta_{k+1} = theta_k + h_k theta'_k + h_k^2 a_k / 2,     theta'_{k+1} = theta'_k + h_k a_k
    u_min <= u_j <= u_max,  |z_k| <= f,  |a_k| <= tau_max / j,  |theta_k| <= theta_max
    z_k = a_k = 0  before the reaction time,
    xi_N - sum_j sigma_j u_j = DCM at the start of a nominal step,  theta'_N = 0.

e = (cos psi, -sin psi) is the push's direction on left stance and on_k = 1 while it lasts (Delta); for
Delta = 0 it is a jump of the first DCM by J e / (m omega). The end is a state that walks on for ever, so
every solution is a recovery; any other end would gain at most exp(-omega t_N) x (width of the viable set),
0.03 N after ten steps of 0.3 s. Inputs that switch at nodes only cost up to 0.04 N more at h = 0.02 s, and a
stop that holds at nodes only gains less than that.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import linprog

from ..errors import InvalidValueError, PushRecoveryError, is_finite_number
from .gait_box import GaitLimits
from .nominal_gait import NominalGait, drifting_dcm_kernel, nominal_gait
from .robot import RobotModel

Array = NDArray[np.float64]

STEPS = 10  # of a trajectory by default
PENALTY = 1e4  # cost of a metre that the first DCM is moved by, over that of a push that shifts it by a metre
TOLERANCE = 1e-6  # a first DCM moved by less is not moved [m]


@dataclass(frozen=True)
class StartState:
    """When the push comes: canonical frame, relative to the stance sole."""

    dcm: tuple[float, float]  # [m]
    elapsed: float = 0.0  # since the step began [s]
    trunk_angle: tuple[float, float] = (0.0, 0.0)  # [rad]
    trunk_rate: tuple[float, float] = (0.0, 0.0)  # [rad/s]


@dataclass(frozen=True)
class TrajectoryProblem:
    """A push on left stance, and what may be done about it."""

    robot: RobotModel
    psi: float  # direction of the push, counter-clockwise from forward [rad]
    duration: float = 0.1  # of the push [s]; 0: a velocity jump
    foot: bool = True  # whether the CoP may leave the centre of the sole
    flywheel: bool = True  # whether the trunk may be accelerated
    limits: GaitLimits | None = None  # step box and sole; the paper's by default
    gait: NominalGait | None = None  # before and after; in place by default
    reaction: float = 0.0  # CoP and trunk stay nominal this long after the push began [s]
    step_durations: tuple[float, ...] | None = None  # [s]; ten times T_min by default
    start: StartState | None = None  # start of a nominal step by default
    grid: float = 0.01  # longest interval of constant inputs [s]

    def __post_init__(self) -> None:
        for name in ("psi", "duration", "reaction", "grid"):
            if not is_finite_number(getattr(self, name)):
                raise InvalidValueError(f"{name} must be finite, got {getattr(self, name)!r}")
        if self.duration < 0 or self.reaction < 0 or self.grid <= 0:
            raise InvalidValueError(
                "duration and reaction must not be negative and grid must be positive [s], "
                f"got {self.duration}, {self.reaction}, {self.grid}"
            )
        box, durations = self.box, self.durations
        low = min(box.duration_max, max(box.duration_min, self.state.elapsed + self.reaction))
        if not durations or min(durations) < box.duration_min or max(durations) > box.duration_max:
            raise InvalidValueError(
                f"step_durations must lie in [{box.duration_min}, {box.duration_max}] s, got {durations}"
            )
        if durations[0] < low:
            raise InvalidValueError(
                f"the first step must last until now and the reaction, {low} s, got {durations[0]}"
            )

    @property
    def box(self) -> GaitLimits:
        """Limits in use."""
        return GaitLimits.of(self.robot) if self.limits is None else self.limits

    @property
    def nominal(self) -> NominalGait:
        """Nominal gait in use."""
        return nominal_gait(self.robot, self.box) if self.gait is None else self.gait

    @property
    def durations(self) -> tuple[float, ...]:
        """Durations of the steps in use [s]; the first no shorter than what has passed of it."""
        if self.step_durations is not None:
            return self.step_durations
        box, since = self.box, self.state.elapsed + self.reaction
        return (min(max(box.duration_min, since), box.duration_max), *(box.duration_min,) * (STEPS - 1))

    @property
    def state(self) -> StartState:
        """Start in use."""
        return self.start or StartState(_nominal_dcm(self.robot, self.nominal, 0))


@dataclass(frozen=True)
class TrajectoryLimit:
    """The largest push and a trajectory that survives it, canonical frame of the first step."""

    impulse: float  # J [N s]
    force: float  # J / duration [N]; inf for a velocity jump
    step_durations: tuple[float, ...]  # [s]
    time: Array  # (N + 1,) nodes, from the push's onset [s]
    dcm: Array  # (N + 1, 2) [m]; after the jump, if there is one
    trunk_angle: Array  # (N + 1, 2) [rad]
    trunk_rate: Array  # (N + 1, 2) [rad/s]
    cop: Array  # (N, 2) [m], constant from node to node
    trunk_acceleration: Array  # (N, 2) [rad/s^2], likewise
    footholds: Array  # (steps + 1, 2) [m]; the first is the stance sole, at the origin
    touchdowns: Array  # (steps,) of footholds 1, 2, ... [s]


@dataclass(frozen=True)
class _Grid:
    time: Array  # (N + 1,) [s]
    step: NDArray[np.int64]  # (N,) index of the step that an interval belongs to
    touchdowns: Array  # (steps,) [s]

    def before(self, time: float) -> Array:
        """1 for intervals before a node, else 0 (N,)."""
        return (0.5 * (self.time[:-1] + self.time[1:]) < time).astype(np.float64)


def trajectory_limit(problem: TrajectoryProblem) -> TrajectoryLimit | None:
    """Solve the linear program of this module for given step durations, with HiGHS.

    Returns:
        None where the state cannot be recovered from with these durations, whatever the size of the push.
    """
    grid = _make_grid(problem)
    (matrix_x, column_x, right_x), (matrix_y, column_y, right_y) = (
        _axis_rows(problem, grid, axis) for axis in range(2)
    )
    A = sparse.bmat([[column_x, matrix_x, None], [column_y, None, matrix_y]], format="csc")
    bounds = np.vstack([[0.0, np.inf], *(_axis_bounds(problem, grid, axis) for axis in range(2))])
    cost = np.zeros(len(bounds))
    cost[0] = -1.0
    missing = [len(bounds) // 2 - 1, len(bounds) // 2, -2, -1]
    cost[missing] = PENALTY * problem.robot.mass * problem.robot.omega
    result = linprog(cost, A_eq=A, b_eq=np.concatenate([right_x, right_y]), bounds=bounds, method="highs")
    if result.status not in (0, 2):
        raise PushRecoveryError(f"HiGHS stopped without an optimum: {result.message}")
    if result.status == 2 or result.x[missing].max() > TOLERANCE:
        return None
    return _unpack(problem, grid, result.x)


def trajectory_limit_over_timing(problem: TrajectoryProblem, samples: int = 8) -> TrajectoryLimit | None:
    """The best of `trajectory_limit` over step durations that alternate, T_1, T_2, T_1, T_2, ...

    T_1 and T_2 come from `samples` values in [T_min, T_max]. T_min throughout is best where w_min < c, the
    widest DCM that a step may start with (docs/limits.md), as with the paper's limits. Where w_min > c every
    second step is best made at T_max for the lateral DCM alone, while the forward one still wants T_min; what
    this search finds there is a lower bound.

    Args:
        problem: its own step durations do not count.
        samples: of each of the two durations, both ends among them.
    """
    box, best = problem.box, None
    horizon = STEPS * box.duration_min
    first = min(max(box.duration_min, problem.state.elapsed + problem.reaction), box.duration_max)
    later = np.linspace(box.duration_min, box.duration_max, samples)
    for t_1, t_2 in itertools.product(np.linspace(first, box.duration_max, samples), later):
        odd = float(t_1) if t_1 > first else box.duration_min
        count = math.ceil(horizon / (odd + t_2) - 1e-9)
        durations = (float(t_1), float(t_2), *(odd, float(t_2)) * (count - 1))
        found = trajectory_limit(dataclasses.replace(problem, step_durations=durations))
        if found is not None and (best is None or found.impulse > best.impulse):
            best = found
    return best


def _make_grid(problem: TrajectoryProblem) -> _Grid:
    """Nodes at every touchdown, at the end of the push and of the reaction time, and between them."""
    touchdowns = np.maximum(np.cumsum(problem.durations) - problem.state.elapsed, 0.0)
    marks = [0.0, *touchdowns, problem.duration, problem.reaction]
    nodes = [0.0]
    for mark in sorted(mark for mark in marks if mark <= touchdowns[-1]):
        gap = mark - nodes[-1]
        if gap > 1e-9:
            count = math.ceil(gap / problem.grid - 1e-9)
            nodes.extend(nodes[-1] + gap * (np.arange(count) + 1.0) / count)
    time = np.array(nodes)
    middle = 0.5 * (time[:-1] + time[1:])
    return _Grid(time, np.searchsorted(touchdowns, middle), touchdowns)


def _signs(axis: int, count: int) -> Array:
    """sigma_j: outward along y is right and left in turn."""
    return np.where(np.arange(count) % 2 * axis == 1, -1.0, 1.0)


def _axis_rows(problem: TrajectoryProblem, grid: _Grid, axis: int) -> tuple[Any, Any, Array]:
    """Equalities of one axis: matrix (rows, variables), column of J (rows, 1), right side (rows,).

    Variables: xi (N + 1), theta (N + 1), theta' (N + 1), z (N), a (N), u (steps), and how far the first DCM
    is moved up and down (2), which keeps the program feasible: HiGHS does not always report that it is not.
    Rows: DCM (N), theta (N), theta' (N), first DCM (1), last DCM (1).
    """
    robot = problem.robot
    n, steps, h = len(grid.step), len(grid.touchdowns), np.diff(grid.time)
    growth = np.exp(robot.omega * h)
    now, after = sparse.eye(n, n + 1), sparse.eye(n, n + 1, 1)
    sigma = _signs(axis, steps)
    sole = (np.arange(steps) < grid.step[:, None]) * sigma  # (N, steps): the stance sole as a sum of steps
    weight = sparse.diags(growth - 1.0)
    one, none = sparse.eye(1, n + 1), None
    last = sparse.csr_matrix(([1.0], ([0], [n])), shape=(1, n + 1))
    matrix = sparse.bmat(
        [  # xi, theta, theta', z, a, u, moved
            [after - sparse.diags(growth) @ now, none, none, weight,
             robot.cmp_per_trunk_acceleration * weight, weight @ sole, none],
            [none, after - now, -sparse.diags(h) @ now, none, -sparse.diags(0.5 * h * h), none, none],
            [none, none, after - now, none, -sparse.diags(h), none, none],
            [one, none, none, none, none, none, [[-1.0, 1.0]]],
            [last, none, none, none, none, -sigma[None, :], none],
        ]
    )  # fmt: skip
    share = (math.cos(problem.psi), -math.sin(problem.psi))[axis]
    column = np.zeros((3 * n + 2, 1))
    if problem.duration > 0:
        force = share / (problem.duration * robot.mass * robot.omega**2)
        column[:n, 0] = -(growth - 1.0) * force * grid.before(problem.duration)
    else:
        column[3 * n, 0] = -share / (robot.mass * robot.omega)
    right = np.zeros(3 * n + 2)
    right[3 * n] = problem.state.dcm[axis]
    right[3 * n + 1] = _nominal_dcm(robot, problem.nominal, steps)[axis]
    return matrix, sparse.csr_matrix(column), right


def _nominal_dcm(robot: RobotModel, gait: NominalGait, steps: int) -> tuple[float, float]:
    """DCM less sole at the start of the nominal step after some steps, canonical frame of the first [m].

    It is b_nom after a step; before one, what drifts to u_nom + b_nom within T_nom.
    """
    if steps % 2 == 1:
        return gait.offset_x, gait.offset_y
    return drifting_dcm_kernel(gait.row, robot.omega, 0.0)


def _axis_bounds(problem: TrajectoryProblem, grid: _Grid, axis: int) -> Array:
    """Bounds (variables, 2) of one axis, in the order of `_axis_rows`."""
    robot, box, state = problem.robot, problem.box, problem.state
    n, steps = len(grid.step), len(grid.touchdowns)
    free = 1.0 - grid.before(problem.reaction)
    half = (box.cop_x_max, box.cop_y_max)[axis] * problem.foot * free
    flywheel = problem.flywheel and box.trunk_accelerations[axis] > 0.0
    torque = min(robot.trunk_torque_max / robot.trunk_inertia, box.trunk_accelerations[axis])
    push = torque * flywheel * free
    stop = np.full(n + 1, robot.trunk_angle_max if flywheel else np.inf)
    anything = np.full(n + 1, np.inf)
    angle, rate = np.column_stack([-stop, stop]), np.column_stack([-anything, anything])
    angle[0], rate[0] = state.trunk_angle[axis], state.trunk_rate[axis]
    if flywheel:
        rate[n] = 0.0
    step = (box.length_min, box.length_max) if axis == 0 else (box.width_min, box.width_max)
    return np.vstack(
        [np.column_stack([-anything, anything]), angle, rate, np.column_stack([-half, half]),
         np.column_stack([-push, push]), np.tile(step, (steps, 1)), [[0.0, np.inf]] * 2]
    )  # fmt: skip


def _unpack(problem: TrajectoryProblem, grid: _Grid, x: Array) -> TrajectoryLimit:
    n, steps = len(grid.step), len(grid.touchdowns)
    ends = np.cumsum([n + 1, n + 1, n + 1, n, n, steps])
    axes = [np.split(block, ends) for block in np.split(x[1:], 2)]
    xi, angle, rate, offset, acceleration = (np.column_stack([a[i] for a in axes]) for i in range(5))
    moves = np.column_stack([_signs(axis, steps) * axes[axis][5] for axis in range(2)])
    footholds = np.vstack([np.zeros(2), np.cumsum(moves, axis=0)])
    arrays = (grid.time, xi, angle, rate, offset + footholds[grid.step], acceleration, footholds,
              grid.touchdowns)  # fmt: skip
    for array in arrays:
        array.flags.writeable = False
    force = x[0] / problem.duration if problem.duration > 0 else math.inf
    return TrajectoryLimit(float(x[0]), float(force), problem.durations, *arrays)
