"""Questions to stage 2 and its answers in every form, and its program written out densely, axis by axis.

The dense program is what OSQP solves as a second opinion, and the oracle of the tests.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..array_table import tuple_reader
from ..errors import InvalidValueError
from ..jit import njit
from ..model.gait_box import COP, TRUNK, GaitLimits, unscaled
from ..model.observation import PREVIOUS_ACTION
from ..model.robot import RobotModel
from ..qp import QuadraticProgram, solve_qp
from ..settings import PlannerConfig
from ..stage_1 import HELD, RESULT

Floats = NDArray[np.float64]

# Columns of a result, which lies in a stage 1 row from RESULT on; of a pair the first one
RESULT_COP = 0  # pair [m]
RESULT_TRUNK = 2  # pair, trunk acceleration [rad/s^2]
RESULT_DCM_END = 4  # pair, predicted DCM at touchdown [m]
RESULT_STATUS = 6  # index into STATUS
RESULT_SIZE = 7

# "clipped": the solver failed, the unconstrained optimum was clipped; "invalid": an input is impossible;
# "daqp": OSQP did not converge, DAQP's plan stands in; "relaxed": the paper's form gave up its hard limit of
# the trunk
STATUS = ("solved", "clipped", "invalid", "daqp", "relaxed")
SOLVED, CLIPPED, INVALID, FROM_DAQP, RELAXED = range(len(STATUS))

SHORTEST = 1e-3  # a shorter (or negative) remaining time is planned as this [s]
LONGEST_MARGIN = 0.3  # horizons reach this far beyond the longest step [s]

_PREVIOUS = PREVIOUS_ACTION.start


class Regulator(Protocol):
    """Stage 2: CoP and trunk acceleration for the steps that stage 1 has planned."""

    workers: int  # so many threads may call `regulate` at a time, each under a number of its own
    decides: bool  # False where CoP and trunk stay those of stage 1

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """Write CoP, trunk acceleration and the columns from RESULT on into stage 1 rows (n, ROW_SIZE).

        Args:
            observations: (n, 36).
            rows: of `StepPlanner.plan`, changed in place.
            worker: 0 to `workers` - 1.

        Raises:
            InvalidValueError: a state that no plan exists for.
        """
        ...


class NoStage2:
    """CoP and trunk acceleration of stage 1 stay; the DCM at touchdown is the one that it expects."""

    workers, decides = 1 << 16, False

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """See `Regulator`."""


class OneAxisTrunk:
    """A trunk that swings about one axis only: about the other the program has no trunk acceleration.

    The axes do not couple in single support, so each comes from a regulator of both of them.

    Args:
        with_trunk: plans trunk accelerations about both axes.
        without: plans none.
        missing: the axis that the waist lacks, 0 pitch, 1 roll.
    """

    decides = True

    def __init__(self, with_trunk: Regulator, without: Regulator, missing: int):
        self._with, self._without = with_trunk, without
        self.workers = min(with_trunk.workers, without.workers)
        pairs = COP, TRUNK, RESULT + RESULT_COP, RESULT + RESULT_TRUNK, RESULT + RESULT_DCM_END
        self._columns = [first + missing for first in pairs]

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """See `Regulator`."""
        other = rows.copy()
        self._with.regulate(observations, rows, worker)
        self._without.regulate(observations, other, worker)
        rows[:, self._columns] = other[:, self._columns]


def as_rows(rows: Floats, columns: int) -> Floats:
    """Input rows of a batch; InvalidValueError for another shape."""
    rows = np.ascontiguousarray(rows, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise InvalidValueError(f"rows must have shape (n, {columns}), got {rows.shape}")
    return rows


def cop_bounds(limits: GaitLimits, config: PlannerConfig) -> tuple[float, float]:
    """Largest |CoP| along x and y that a plan may use: half a sole less its margin, which leaves some [m]."""
    bounds = limits.cop_x_max - config.cop_margin_x, limits.cop_y_max - config.cop_margin_y
    if min(bounds) <= 0:
        raise InvalidValueError(f"the CoP margins leave no sole: half sizes {bounds} m must be positive")
    return bounds


class Constants(NamedTuple):
    """Scalars of the compiled loops; those of `PlannerConfig` have its names. Switches are 1 or 0."""

    omega: float  # [1/s]
    cmp_per_acceleration: float  # j / (m g) [m s^2]
    cop_x: float  # half size of a sole less the margin [m]
    cop_y: float
    pitch: float  # largest trunk acceleration [rad/s^2]
    roll: float
    torque: float  # tau_max / j [rad/s^2]
    gravity: float  # gravity torque per sin(lean) / j [rad/s^2]
    angle: float  # [rad]
    repaired: float  # the cost of the paper's form is the repaired one
    double_support: float
    first_interval_min: float
    sampling_time: float
    tail_intervals: float
    tail_sampling_time: float
    trunk_debt: float
    beta_cop: float
    beta_dcm_acceleration: float
    beta_trunk: float
    beta_trunk_rate: float
    beta_dcm: float
    beta_trunk_angle: float
    use_cop: float
    use_trunk: float


constants_of = tuple_reader(Constants)


def pack_constants(
    robot: RobotModel, limits: GaitLimits, config: PlannerConfig, accelerations: tuple[float, float]
) -> Floats:
    """`Constants` as an array, with the largest trunk accelerations in pitch and roll [rad/s^2].

    Margins that leave no CoP, and a zero where no optimum is unique without a weight, are refused.
    """
    bounds = cop_bounds(limits, config)
    own = "beta_dcm_acceleration" if config.form == "jerk" else "beta_cop"
    for name in (own, "beta_trunk", "beta_trunk_limit"):
        if not getattr(config, name) > 0:
            raise InvalidValueError(f"PlannerConfig.{name} must be positive, got {getattr(config, name)}")
    return np.array(
        Constants(
            robot.omega, robot.cmp_per_trunk_acceleration, *bounds, *accelerations,
            robot.trunk_torque_max / robot.trunk_inertia, config.trunk_gravity / robot.trunk_inertia,
            robot.trunk_angle_max, float(config.jerk_cost == "repaired"),
            **config.numbers(Constants._fields),
        )
    )  # fmt: skip


class Form:
    """What the forms of stage 2 have in common: one robot, step box and configuration; see `Regulator`."""

    workers, decides = 1, True

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        self.robot, self.limits, self.config = robot, limits, config
        self.longest = limits.duration_max + LONGEST_MARGIN  # time to touchdown that it plans for [s]

    def __reduce__(self) -> tuple[Any, ...]:  # with scratch memory of its own
        return type(self), (self.robot, self.limits, self.config)

    def apply(self, observations: Floats, rows: Floats) -> None:
        """`apply_results` of this configuration."""
        apply_results(observations, rows, self.limits.box, self.config.use_cop, self.config.use_trunk)


@njit(cache=True)
def factorise(H: Any, n: int, L: Any) -> None:
    """L of H = L L' from the lower triangle of H, n rows of each; both may be one array."""
    for i in range(n):
        for j in range(i + 1):
            total = H[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(total) if i == j else total / L[j, j]


@njit(cache=True)
def solve_lower(L: Any, b: Any) -> None:
    """Solve L x = b in place of b."""
    for i in range(b.shape[0]):
        total = b[i]
        for k in range(i):
            total -= L[i, k] * b[k]
        b[i] = total / L[i, i]


@njit(cache=True)
def solve_upper(L: Any, b: Any) -> None:
    """Solve L' x = b in place of b."""
    for i in range(b.shape[0] - 1, -1, -1):
        b[i] /= L[i, i]
        for k in range(i):
            b[k] -= L[i, k] * b[i]


@njit(cache=True)
def acceleration_interval(angle: float, gravity: float, torque: float, box: float) -> tuple[float, float]:
    """|j a - gravity torque sin(angle)| <= tau_max, all over j, within the gait box; never empty."""
    shift = gravity * math.sin(angle)
    low = min(max(shift - torque, -box), box)
    high = max(min(shift + torque, box), -box)
    return low, high


@njit(cache=True, forceinline=True)
def apply_results(observations, rows, box, use_cop, use_trunk):  # pragma: no cover
    """Make each row's result its CoP and trunk acceleration; where the step is held, the previous action's.

    As little remains then, a DCM off by d asks for a CoP off by d / (exp(omega T) - 1): noise becomes blows.
    """
    for i in range(rows.shape[0]):
        obs, row = observations[i], rows[i]
        for axis in range(2):
            if use_cop and row[HELD] > 0.0:
                j = COP + axis
                row[RESULT + RESULT_COP + axis] = unscaled(obs[_PREVIOUS + j], box[0, j], box[1, j])
            row[COP + axis] = row[RESULT + RESULT_COP + axis]
            if use_trunk:
                j = TRUNK + axis
                if row[HELD] > 0.0:
                    row[RESULT + RESULT_TRUNK + axis] = unscaled(obs[_PREVIOUS + j], box[0, j], box[1, j])
                row[j] = row[RESULT + RESULT_TRUNK + axis]


@dataclass(frozen=True)
class ExplicitProblem:
    """Inputs x = (z_0..z_{N-1}, a_0..a_{K-1}); where an input is not used, its part is absent."""

    qp: QuadraticProgram
    durations: Floats  # (K,), the first N of them until touchdown [s]
    cops: int  # N, or 0 where the CoP stays at the reference
    accelerations: int  # K, or 0 where the trunk is not used
    reference: float  # [m]
    dcm_free: float  # DCM at touchdown with all inputs zero [m]
    dcm_row: Floats  # (n,)

    def first(self, x: Floats) -> tuple[float, float]:
        """CoP [m] and trunk acceleration [rad/s^2] of the first interval."""
        cop = float(x[0]) if self.cops else self.reference
        return cop, float(x[self.cops]) if self.accelerations else 0.0

    def dcm_end(self, x: Floats) -> float:
        """Predicted DCM at touchdown [m]."""
        return float(self.dcm_free - self.dcm_row @ x)


def solve_again(programs: Sequence[tuple[QuadraticProgram, Sequence[ExplicitProblem]]], out: Floats) -> None:
    """Replace a result by OSQP's of programs, each of one or more axes; DAQP's stays where it gives up."""
    axes: list[tuple[ExplicitProblem, Floats]] = []
    for qp, parts in programs:
        solution = solve_qp(qp, "osqp")
        if solution.status != "solved":
            out[RESULT_STATUS] = FROM_DAQP
            return
        axes += zip(parts, np.split(solution.x, len(parts)), strict=True)
    for i, (axis, x) in enumerate(axes):
        out[RESULT_COP + i], out[RESULT_TRUNK + i] = axis.first(x)
        out[RESULT_DCM_END + i] = axis.dcm_end(x)
    out[RESULT_STATUS] = SOLVED


def grid(config: PlannerConfig, remaining: float) -> Floats:
    """Durations of the intervals until touchdown: a first one, then whole ones [s]."""
    whole = max(math.floor((remaining - config.first_interval_min) / config.sampling_time + 1e-9), 0)
    return np.array([remaining - whole * config.sampling_time] + [config.sampling_time] * whole)


def explicit_problem(
    robot: RobotModel, config: PlannerConfig, until: Floats, partial: int, state: Floats, cop: Floats,
    accelerations: tuple[float, float],
) -> ExplicitProblem:  # fmt: skip
    """Build the problem of one axis on any grid by unrolling the model, with no use of its structure.

    Args:
        robot: physical constants.
        config: weights.
        until: (N,) durations of the intervals until touchdown [s].
        partial: the inputs of so many first intervals are weighted by their share of a whole one.
        state: (4,) DCM now [m], lean [rad], its rate [rad/s], DCM wanted at touchdown [m].
        cop: (3, N) its reference, lower and upper bound [m].
        accelerations: lower and upper bound of the trunk's [rad/s^2].
    """
    durations = np.concatenate([until, np.full(config.tail_intervals, config.tail_sampling_time)])
    N, K = until.size, durations.size
    cops, trunks = N if config.use_cop else 0, K if config.use_trunk else 0
    dcm, angles, rates = _unrolled(robot, config, durations, state[:3], cop[0])

    share = durations / config.sampling_time
    share[partial:] = 1.0
    own = np.concatenate([config.beta_cop * share[:cops], config.beta_trunk * share[:trunks]])
    n = own.size
    H, f = np.diag(own), np.zeros(n)
    f[:cops] -= own[:cops] * cop[0, :cops]
    terms = [(config.beta_dcm, dcm - np.eye(n + 1)[0] * state[3])]
    if trunks:
        terms += [(config.beta_trunk_rate, rate) for rate in rates]
        terms += [(config.beta_trunk_angle, angle) for angle in angles]
    for weight, row in terms:
        H += weight * np.outer(row[1:], row[1:])
        f += weight * row[0] * row[1:]
    soft = np.array(angles)[:, 1:] if trunks else np.zeros((0, n))
    offset = np.array(angles)[:, 0] if trunks else np.zeros(0)
    limit, (least, most) = robot.trunk_angle_max, accelerations
    lower = np.concatenate([cop[1, :cops], np.full(trunks, least), -limit - offset])
    upper = np.concatenate([cop[2, :cops], np.full(trunks, most), limit - offset])
    weights = np.concatenate([np.zeros(n), np.full(offset.size, config.beta_trunk_limit)])
    qp = QuadraticProgram(H, f, np.concatenate([np.eye(n), soft]), lower, upper, weights)
    return ExplicitProblem(qp, durations, cops, trunks, float(cop[0, 0]), float(dcm[0]), -dcm[1:])


def _unrolled(
    robot: RobotModel, config: PlannerConfig, durations: Floats, start: Floats, references: Floats
) -> tuple[Floats, list[Floats], list[Floats]]:
    """Affine maps [constant, inputs] (n + 1,) of what the inputs of one axis lead to.

    Returns:
        The DCM at touchdown [m], with the debt of the trunk less what the tail will move the CMP, discounted
        to touchdown; the trunk's angle [rad] and its rate [rad/s] after each interval.
    """
    until = references.size
    cops, accelerations = config.use_cop * until, config.use_trunk * durations.size
    size = 1 + cops + accelerations
    xi, theta, omega = np.zeros(size), np.zeros(size), np.zeros(size)
    xi[0], theta[0], omega[0] = start
    angles, rates = [], []
    for k, d in enumerate(durations):
        z, a = np.zeros(size), np.zeros(size)
        if cops and k < until:
            z[1 + k] = 1.0
        elif not cops and k < until:
            z[0] = references[k]
        if accelerations:
            a[1 + cops + k] = 1.0
        if k < until:
            e = math.exp(robot.omega * d)
            xi = e * xi - (e - 1) * (z + robot.cmp_per_trunk_acceleration * a)
        elif config.trunk_debt:
            before, after = (math.exp(-robot.omega * durations[until:j].sum()) for j in (k, k + 1))
            xi = xi - robot.cmp_per_trunk_acceleration * (before - after) * a
        theta, omega = theta + d * omega + d * d / 2 * a, omega + d * a
        angles.append(theta)
        rates.append(omega)
    return xi, angles, rates
