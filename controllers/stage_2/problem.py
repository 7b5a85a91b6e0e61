"""Stage 2: what every form of it is asked and gives, and its program written out densely.

What every form of stage 2 has in common: what it is asked, what it gives, how a row takes it over.

The program of stage 2 written out densely, axis by axis: what OSQP solves, and the oracle of the tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidValueError
from ..jit import njit
from ..model.gait_box import COP, TRUNK, GaitLimits, unscaled
from ..model.observation import PREVIOUS_ACTION
from ..model.robot import RobotModel
from ..qp import QuadraticProgram
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

_PREVIOUS = PREVIOUS_ACTION.start


@dataclass(frozen=True)
class CopPlan:
    """What to do now, in the canonical frame, relative to the stance sole's centre."""

    cop: Floats  # (2,) [m]
    trunk_acceleration: Floats  # (2,) towards +x, +y [rad/s^2]
    dcm_end: Floats  # (2,) predicted DCM at touchdown [m]
    status: str  # one of STATUS


def plan_of(result: Floats, status: str) -> CopPlan:
    """The plan of a result (RESULT_SIZE,) or of its first six columns; read-only from here on."""
    result.flags.writeable = False
    cop, trunk = result[RESULT_COP : RESULT_COP + 2], result[RESULT_TRUNK : RESULT_TRUNK + 2]
    return CopPlan(cop, trunk, result[RESULT_DCM_END : RESULT_DCM_END + 2], status)


def cop_bounds(limits: GaitLimits, config: PlannerConfig) -> tuple[float, float]:
    """Largest |CoP| along x and y that a plan may use: half a sole less its margin [m].

    Raises:
        InvalidValueError: a margin leaves none.
    """
    bounds = limits.cop_x_max - config.cop_margin_x, limits.cop_y_max - config.cop_margin_y
    if min(bounds) <= 0:
        raise InvalidValueError(f"the CoP margins leave no sole: half sizes {bounds} m must be positive")
    return bounds


def require_positive(config: PlannerConfig, *names: str) -> None:
    """Refuse a configuration in which one of these numbers is not positive.

    Raises:
        InvalidValueError: names it.
    """
    for name in names:
        if not getattr(config, name) > 0:
            raise InvalidValueError(f"PlannerConfig.{name} must be positive, got {getattr(config, name)}")


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


@njit(cache=True, forceinline=True)
def take_over(obs, row, box, use_cop, use_trunk):  # pragma: no cover
    """A row's own result into its CoP and trunk acceleration; the previous action's where its step is held.

    As little remains then, a DCM off by d asks for a CoP off by d / (exp(omega T) - 1): noise becomes blows.
    """
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


@njit(cache=True)
def take_over_all(observations, rows, box, use_cop, use_trunk):  # pragma: no cover
    """`take_over` of every row."""
    for i in range(rows.shape[0]):
        take_over(observations[i], rows[i], box, use_cop, use_trunk)


SHORTEST = 1e-3  # a shorter (or negative) remaining time is planned as this [s]


@dataclass(frozen=True)
class ExplicitProblem:
    """Inputs x = (z_0..z_{N-1}, a_0..a_{K-1}); where an input is not used, its part is absent."""

    qp: QuadraticProgram
    durations: NDArray[np.float64]  # (K,), the first N of them until touchdown [s]
    cops: int  # N, or 0 where the CoP stays at the reference
    accelerations: int  # K, or 0 where the trunk is not used
    reference: float  # [m]
    dcm_free: float  # DCM at touchdown with all inputs zero [m]
    dcm_row: NDArray[np.float64]  # (n,)

    def first(self, x: NDArray[np.float64]) -> tuple[float, float]:
        """CoP [m] and trunk acceleration [rad/s^2] of the first interval."""
        cop = float(x[0]) if self.cops else self.reference
        return cop, float(x[self.cops]) if self.accelerations else 0.0

    def dcm_end(self, x: NDArray[np.float64]) -> float:
        """Predicted DCM at touchdown [m]."""
        return float(self.dcm_free - self.dcm_row @ x)


def grid(config: PlannerConfig, remaining: float) -> NDArray[np.float64]:
    """Durations of the intervals until touchdown: a first one, then whole ones [s]."""
    whole = max(math.floor((remaining - config.first_interval_min) / config.sampling_time + 1e-9), 0)
    return np.array([remaining - whole * config.sampling_time] + [config.sampling_time] * whole)


def explicit_problem(
    robot: RobotModel, config: PlannerConfig, remaining: float, dcm: float, angle: float, rate: float,
    target: float, reference: float, cop_max: float, acceleration_low: float, acceleration_high: float,
) -> ExplicitProblem:  # fmt: skip
    """Build the problem by unrolling the model, with no use of its structure."""
    until = grid(config, max(remaining, SHORTEST))
    if not config.use_cop:
        reference = min(max(reference, -cop_max), cop_max)
    N = until.size
    return write_out(
        robot, config, until, 1, (dcm, angle, rate, target), np.full(N, reference), np.full(N, -cop_max),
        np.full(N, cop_max), acceleration_low, acceleration_high,
    )  # fmt: skip


def write_out(
    robot: RobotModel, config: PlannerConfig, until: NDArray[np.float64], partial: int,
    state: tuple[float, float, float, float], references: NDArray[np.float64], cop_low: NDArray[np.float64],
    cop_high: NDArray[np.float64], acceleration_low: float, acceleration_high: float,
) -> ExplicitProblem:  # fmt: skip
    """Build the problem of one axis on any grid.

    Args:
        robot: physical constants.
        config: weights.
        until: (N,) durations of the intervals until touchdown [s].
        partial: the inputs of so many first intervals are weighted by their share of a whole one.
        state: DCM now [m], lean [rad], its rate [rad/s], DCM wanted at touchdown [m].
        references: (N,) of the CoP [m].
        cop_low: (N,) [m].
        cop_high: (N,) [m].
        acceleration_low: of the trunk [rad/s^2].
        acceleration_high: [rad/s^2].
    """
    durations = np.concatenate([until, np.full(config.tail_intervals, config.tail_sampling_time)])
    N, K = until.size, durations.size
    cops, accelerations = N if config.use_cop else 0, K if config.use_trunk else 0
    n = cops + accelerations
    states = _unrolled(robot, config, durations, N, state[:3], references)

    share = durations / config.sampling_time
    share[partial:] = 1.0
    own = np.concatenate([config.beta_cop * share[:cops], config.beta_trunk * share[:accelerations]])
    H, f = _cost(config, states, own, references[:cops], state[3])
    soft = np.array(states.angles)[:, 1:] if accelerations else np.zeros((0, n))
    offset = np.array(states.angles)[:, 0] if accelerations else np.zeros(0)
    limit = robot.trunk_angle_max
    lower = np.concatenate([cop_low[:cops], np.full(accelerations, acceleration_low), -limit - offset])
    upper = np.concatenate([cop_high[:cops], np.full(accelerations, acceleration_high), limit - offset])
    weights = np.concatenate([np.zeros(n), np.full(offset.size, config.beta_trunk_limit)])
    qp = QuadraticProgram(H, f, np.concatenate([np.eye(n), soft]), lower, upper, weights)
    free, row = float(states.dcm[0]), -states.dcm[1:]
    return ExplicitProblem(qp, durations, cops, accelerations, float(references[0]), free, row)


class _States(NamedTuple):
    """Affine maps [constant, inputs] (n + 1,) of what the inputs lead to."""

    dcm: NDArray[np.float64]  # at touchdown [m]; less, with the debt of the trunk, what the tail will cost
    angles: list[NDArray[np.float64]]  # of the trunk after each interval [rad]
    rates: list[NDArray[np.float64]]  # [rad/s]


def _cost(
    config: PlannerConfig, states: _States, own: NDArray[np.float64], references: NDArray[np.float64],
    target: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """H (n, n) and f (n,): the inputs' own weights (n,), and squares of the states' affine maps."""
    n, cops = own.size, references.size
    H, f = np.diag(own), np.zeros(n)
    f[:cops] -= own[:cops] * references
    terms = [(config.beta_dcm, states.dcm - np.eye(n + 1)[0] * target)]
    if n > cops:
        terms += [(config.beta_trunk_rate, rate) for rate in states.rates]
        terms += [(config.beta_trunk_angle, angle) for angle in states.angles]
    for weight, row in terms:
        H += weight * np.outer(row[1:], row[1:])
        f += weight * row[0] * row[1:]
    return H, f


def _unrolled(
    robot: RobotModel, config: PlannerConfig, durations: NDArray[np.float64], until: int,
    start: tuple[float, ...], references: NDArray[np.float64],
) -> _States:  # fmt: skip
    """The states of one axis, one interval after the other, the first `until` of them before touchdown.

    The debt of the trunk is what the tail will move the CMP, discounted to touchdown.
    """
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
    return _States(xi, angles, rates)
