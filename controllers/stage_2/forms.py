"""Stage 2 as the policies call it: from observations and stage 1 rows to CoP and trunk acceleration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..errors import InvalidValueError
from ..model.gait_box import GaitLimits, unscaled
from ..model.observation import ELAPSED, PREVIOUS_ACTION, SWING_POSITION, TRUNK_ANGLE, TRUNK_RATE
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from ..stage_1.planner import DCM_AHEAD, HELD, REMAINING, TARGET
from .double_support import DoubleSupportPlanner
from .kernel import INPUTS
from .paper_form import JerkCopPlanner
from .planner import STATUS, CopPlanner

TRUNK_STATE = slice(TRUNK_ANGLE.start, TRUNK_RATE.stop)
_TRUNK, _AHEAD, _TARGET = TRUNK_ANGLE.start, DCM_AHEAD.start, TARGET.start
_PREVIOUS = PREVIOUS_ACTION.start

Floats = NDArray[np.float64]
CopRule = Callable[[Floats, Floats], tuple[Floats, list[str]]]


def make_cop_rule(
    robot: RobotModel, limits: GaitLimits, config: PlannerConfig, threads: int = 1
) -> CopRule | None:
    """Stage 2 over observations (n, 36) and stage 1 rows, or None where it has nothing to decide.

    The rule gives CoP, trunk acceleration and expected DCM at touchdown, (n, 6), and a status for each. The
    default form plans a large batch on `threads` threads.

    Raises:
        InvalidValueError: the paper's form is asked for double support, which it has no bounds for.
    """
    if not (config.use_cop or config.use_trunk):
        return None
    if config.double_support > 0 and config.form == "jerk":
        raise InvalidValueError(
            f"stage 2 plans double support ({config.double_support} s) in form 'zoh' only, got form 'jerk'; "
            "set double_support to 0 or choose form 'zoh'"
        )
    single = _single_rule(robot, limits, config, threads)
    if config.double_support == 0:
        return single
    return _phased_rule(single, DoubleSupportPlanner(robot, limits, config))


def _single_rule(robot: RobotModel, limits: GaitLimits, config: PlannerConfig, threads: int) -> CopRule:
    if config.form == "zoh" and config.solver == "daqp":
        return CompiledRule(CopPlanner(robot, limits, config, threads))
    if config.form == "zoh":
        return _looped_rule(CopPlanner(robot, limits, config), None)
    return _looped_rule(JerkCopPlanner(robot, limits, config), limits)


def _phased_rule(single: CopRule, planner: DoubleSupportPlanner) -> CopRule:
    """Both axes at once while both feet stand for most of the coming period, one by one from then on."""
    last = planner.config.double_support - 0.5 * planner.config.first_interval_min

    def rule(batch: Floats, rows: Floats) -> tuple[Floats, list[str]]:
        result, statuses = np.empty((len(batch), 7)), [""] * len(batch)
        double = batch[:, ELAPSED] < last
        for where, plan in ((np.flatnonzero(~double), single), (np.flatnonzero(double), both)):
            if len(where):
                ends, found = plan(batch[where], rows[where])
                result[where, :6] = ends[:, :6]
                for k, status in zip(where.tolist(), found, strict=True):
                    statuses[k] = status
        return result[:, :6], statuses

    def both(batch: Floats, rows: Floats) -> tuple[Floats, list[str]]:
        inputs = np.column_stack(
            [rows[:, REMAINING], np.maximum(batch[:, ELAPSED], 0.0), batch[:, SWING_POSITION][:, :2],
             rows[:, DCM_AHEAD], batch[:, TRUNK_STATE], rows[:, TARGET]]
        )  # fmt: skip
        return planner.plan_all(inputs)

    return rule


@njit(cache=True)
def write_input(obs, row, out):  # pragma: no cover
    """A row (11,) of `CopPlanner.plan_batch`; the CoP's reference is the centre of the sole."""
    out[0] = row[REMAINING]
    for k in range(2):
        out[1 + k] = row[_AHEAD + k]
        out[3 + k], out[5 + k] = obs[_TRUNK + k], obs[_TRUNK + 2 + k]
        out[7 + k] = row[_TARGET + k]
        out[9 + k] = 0.0


@njit(cache=True)
def hold_inputs(obs, row, low, high, use_cop, use_trunk, result):  # pragma: no cover
    """Where the step plan is held, so are CoP and trunk acceleration (`result` 0-3): the previous action's.

    As little remains then, a DCM off by d asks for a CoP off by d / (exp(omega T) - 1): noise becomes blows.
    """
    if row[HELD] > 0.0:
        for i in range(4):
            if use_cop if i < 2 else use_trunk:
                j = 3 + i
                result[i] = unscaled(obs[_PREVIOUS + j], low[j], high[j])


@njit(cache=True)
def _write_inputs(batch, rows, inputs):  # pragma: no cover
    for i in range(batch.shape[0]):
        write_input(batch[i], rows[i], inputs[i])


class CompiledRule:
    """The default form, solved by DAQP from compiled code."""

    def __init__(self, planner: CopPlanner):
        self.planner = planner

    def __call__(self, batch: Floats, rows: Floats) -> tuple[Floats, list[str]]:
        """See `make_cop_rule`."""
        inputs = np.empty((len(batch), INPUTS))
        _write_inputs(batch, rows, inputs)
        result = self.planner.plan_batch(inputs)
        return result, [STATUS[int(index)] for index in result[:, 6].tolist()]


def _looped_rule(planner: CopPlanner | JerkCopPlanner, limits: GaitLimits | None) -> CopRule:
    """One call a row; the jerk form also takes the previous CoP and acceleration out of the observation."""
    period = planner.config.first_interval_min

    def rule(batch: Floats, rows: Floats) -> tuple[Floats, list[str]]:
        result, statuses = np.empty((len(batch), 6)), []
        for obs, row, out in zip(batch, rows, result, strict=True):
            state = (row[REMAINING], row[DCM_AHEAD], obs[TRUNK_ANGLE], obs[TRUNK_RATE], row[TARGET])
            if limits is None:
                plan = planner.plan(*state)
            else:
                plan = planner.plan(*state, (0.0, 0.0), *_previous(obs, limits, period))  # type: ignore[call-arg]
            out[0:2], out[2:4], out[4:6] = plan.cop, plan.trunk_acceleration, plan.dcm_end
            statuses.append(plan.status)
        return result, statuses

    return rule


def _previous(obs: Floats, limits: GaitLimits, period: float) -> tuple[Floats, Floats]:
    """CoP [m] and trunk acceleration [rad/s^2] in force now; a new stance foot begins at the sole's centre.

    The previous action was made in the frame of its own step, so that its roll turns its sign at touchdown.
    """
    gait = limits.from_action(obs[PREVIOUS_ACTION])
    if obs[ELAPSED] < period:
        return np.zeros(2), np.array([gait[5], -gait[6]])
    return gait[3:5], gait[5:7]
