"""The forms of stage 2 behind one interface, `Regulator`, and the choice of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidValueError
from ..model.gait_box import COP, TRUNK, GaitLimits
from ..model.observation import ELAPSED, PREVIOUS_ACTION, SWING_POSITION, TRUNK_ANGLE, TRUNK_RATE
from ..model.robot import RobotModel
from ..settings import PlannerConfig
from ..stage_1 import DCM_AHEAD, REMAINING, RESULT, TARGET
from ..stage_1 import STATUS as STATUS_COLUMN
from .double_support import DoubleSupportPlanner
from .paper_form import JerkCopPlanner
from .problem import (
    RESULT_COP,
    RESULT_DCM_END,
    RESULT_STATUS,
    RESULT_TRUNK,
    STATUS,
    CopPlan,
    Regulator,
    take_over_all,
)
from .single_support import CopPlanner, regulate_rows

Floats = NDArray[np.float64]


def make_regulator(
    robot: RobotModel, limits: GaitLimits, config: PlannerConfig, threads: int = 1
) -> Regulator:
    """Stage 2 of a configuration; the default form may be called on `threads` threads.

    About an axis that the waist lacks no trunk acceleration is planned.

    Raises:
        InvalidValueError: the paper's form is asked for double support, which it has no bounds for.
    """
    if not any(limits.trunk_accelerations):
        config = replace(config, use_trunk=False)
    if not (config.use_cop or config.use_trunk):
        return NoStage2()
    if config.double_support > 0 and config.form == "jerk":
        raise InvalidValueError(
            f"stage 2 plans double support ({config.double_support} s) in form 'zoh' only, got form 'jerk'; "
            "set double_support to 0 or choose form 'zoh'"
        )
    if config.double_support > 0:
        return WithDoubleSupport(robot, limits, config)
    return _single_support(robot, limits, config, threads)


def _single_support(robot: RobotModel, limits: GaitLimits, config: PlannerConfig, threads: int) -> Regulator:
    if config.use_trunk and not all(limits.trunk_accelerations):
        return OneAxisTrunk(robot, limits, config, threads)
    return _any_trunk(robot, limits, config, threads)


def _any_trunk(robot: RobotModel, limits: GaitLimits, config: PlannerConfig, threads: int) -> Regulator:
    if not (config.use_cop or config.use_trunk):
        return NoStage2()
    if config.form == "zoh" and config.solver == "daqp":
        return DefaultForm(robot, limits, config, threads)
    return OneByOne(robot, limits, config)


class NoStage2:
    """CoP and trunk acceleration of stage 1 stay; the DCM at touchdown is the one that it expects."""

    workers, decides = 1 << 16, False

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """See `Regulator`."""


class DefaultForm:
    """`CopPlanner`'s problem, solved by DAQP from compiled code."""

    decides = True

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig, threads: int = 1):
        self.planner, self.workers = CopPlanner(robot, limits, config, threads), threads
        self._packed = self.planner.packed

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """See `Regulator`."""
        if regulate_rows(observations, rows, self._packed[worker]) > 0:
            self.planner.refuse(observations, rows)


class OneByOne:
    """The paper's form, or the default one solved by OSQP as a second opinion: a call a row."""

    workers, decides = 1, True

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        self._limits, self._config = limits, config
        self._paper = JerkCopPlanner(robot, limits, config) if config.form == "jerk" else None
        self._plain = CopPlanner(robot, limits, config) if config.form == "zoh" else None

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """See `Regulator`."""
        for obs, row in zip(observations, rows, strict=True):
            plan, result = self._plan(obs, row), row[RESULT:]
            result[RESULT_COP : RESULT_COP + 2] = plan.cop
            result[RESULT_TRUNK : RESULT_TRUNK + 2] = plan.trunk_acceleration
            result[RESULT_DCM_END : RESULT_DCM_END + 2] = plan.dcm_end
            result[RESULT_STATUS] = STATUS.index(plan.status)
        _take_over(observations, rows, self._limits, self._config)

    def _plan(self, obs: Floats, row: Floats) -> CopPlan:
        ahead, target = row[DCM_AHEAD : DCM_AHEAD + 2], row[TARGET : TARGET + 2]
        state = float(row[REMAINING]), ahead, obs[TRUNK_ANGLE], obs[TRUNK_RATE], target
        if self._plain is not None:
            return self._plain.plan(*state)
        assert self._paper is not None  # noqa: S101
        return self._paper.plan(*state, (0.0, 0.0), *self._previous(obs))

    def _previous(self, obs: Floats) -> tuple[Floats, Floats]:
        """CoP [m] and trunk acceleration [rad/s^2] in force; a new stance foot begins at the sole's centre.

        The previous action was made in the frame of its own step: its roll turns its sign at touchdown.
        """
        gait = self._limits.from_action(obs[PREVIOUS_ACTION])
        if obs[ELAPSED] < self._config.first_interval_min:
            return np.zeros(2), np.array([gait[TRUNK], -gait[TRUNK + 1]])
        return gait[COP : COP + 2], gait[TRUNK : TRUNK + 2]


class OneAxisTrunk:
    """A trunk that swings about one axis only: about the other the program has no trunk acceleration.

    The axes do not couple in single support, so each comes from a program for both of them.
    """

    decides = True

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig, threads: int = 1):
        self._with = _any_trunk(robot, limits, config, threads)
        self._without = _any_trunk(robot, limits, replace(config, use_trunk=False), threads)
        self.workers = min(self._with.workers, self._without.workers)
        axis = limits.trunk_accelerations.index(0.0)
        pairs = COP, TRUNK, RESULT + RESULT_COP, RESULT + RESULT_TRUNK, RESULT + RESULT_DCM_END
        self._columns = [first + axis for first in pairs]

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """See `Regulator`."""
        other = rows.copy()
        self._with.regulate(observations, rows, worker)
        self._without.regulate(observations, other, worker)
        rows[:, self._columns] = other[:, self._columns]


class WithDoubleSupport:
    """Both axes at once while both feet stand for most of the coming period, one by one from then on."""

    workers, decides = 1, True

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        self._single = _single_support(robot, limits, config, 1)
        self._both = DoubleSupportPlanner(robot, limits, config)
        self._limits, self._config = limits, config
        self._last = config.double_support - 0.5 * config.first_interval_min

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """See `Regulator`."""
        double = observations[:, ELAPSED] < self._last
        for where, regulate in ((~double, self._single.regulate), (double, self._regulate_both)):
            if where.any():
                part = rows[where]
                regulate(observations[where], part)
                rows[where] = part

    def _regulate_both(self, observations: Floats, rows: Floats) -> None:
        inputs = np.column_stack(
            [rows[:, REMAINING], np.maximum(observations[:, ELAPSED], 0.0),
             observations[:, SWING_POSITION][:, :2], rows[:, DCM_AHEAD : DCM_AHEAD + 2],
             observations[:, TRUNK_ANGLE], observations[:, TRUNK_RATE], rows[:, TARGET : TARGET + 2]]
        )  # fmt: skip
        rows[:, RESULT:], statuses = self._both.plan_all(inputs)
        rows[:, STATUS_COLUMN] = [STATUS.index(status) for status in statuses]
        _take_over(observations, rows, self._limits, self._config)


def _take_over(observations: Floats, rows: Floats, limits: GaitLimits, config: PlannerConfig) -> None:
    take_over_all(observations, rows, limits.box, config.use_cop, config.use_trunk)
