"""What every form of stage 2 has in common: what it is asked, what it gives, how a row takes it over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..errors import InvalidValueError
from ..model.gait_box import COP, TRUNK, GaitLimits, unscaled
from ..model.observation import PREVIOUS_ACTION
from ..settings.planner_config import PlannerConfig
from ..stage_1.columns import HELD, RESULT

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
