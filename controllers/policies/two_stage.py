"""The two-stage planner as a policy: observation -> stage 1 -> stage 2 -> action, one way for every arm."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..baselines.linear_mpc import LinearMpc
from ..compiled.compile_notice import announce_compilation
from ..compiled.threads import RangeThreads
from ..errors import InvalidValueError
from ..model.gait_action import scale_actions
from ..model.gait_box import GAIT_SIZE, GaitLimits
from ..model.observation import OBSERVATION_SIZE, as_batch
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from ..settings.presets import preset_config
from ..stage_1.columns import ROW_SIZE
from ..stage_1.columns import STATUS as STATUS_COLUMN
from ..stage_1.planner import StepPlanner
from ..stage_2.forms import make_regulator
from ..stage_2.interface import STATUS, Regulator
from ..validation import require_kind
from .plan import Plan, plan_of_row

Floats = NDArray[np.float64]
Actions = NDArray[np.float32]

ROWS_A_THREAD = 256  # with fewer plans, waking a thread costs what it saves


class TwoStagePolicy:
    """Stage 1, then stage 2 where CoP or trunk may be used; a pure function of the observation."""

    def __init__(
        self,
        robot: RobotModel | None = None,
        limits: GaitLimits | None = None,
        config: PlannerConfig | None = None,
        *,
        adapt: bool = True,
        name: str = "two-stage",
        threads: int = 1,
    ):
        """Build the planner.

        Args:
            robot: physical constants; the paper's by default.
            limits: step box, CoP and trunk bounds; the paper's for the robot by default.
            config: weights and margins; the preset `default` by default.
            adapt: False walks the nominal gait without reaction.
            name: for tables.
            threads: that plan a batch of 512 observations or more, where stage 2's form allows it; the
                actions do not depend on them.

        Raises:
            InvalidValueError: a robot, limits or a configuration of another class, or an impossible number
                of threads.
        """
        announce_compilation()
        self.robot = RobotModel() if robot is None else require_kind("robot", robot, RobotModel)
        self.limits = (
            GaitLimits.of(self.robot) if limits is None else require_kind("limits", limits, GaitLimits)
        )
        self.config = (
            preset_config("default") if config is None else require_kind("config", config, PlannerConfig)
        )
        self.name = name
        self._threads = RangeThreads(threads)
        self._stage_1 = StepPlanner(self.robot, self.limits, self.config, adapt)
        mpc = self.config.foothold == "linear_mpc"
        make = LinearMpc if mpc else partial(make_regulator, threads=threads)
        self._stage_2: Regulator = make(self.robot, self.limits, self.config)
        self._bounds = self.limits.box, self.config.double_support
        self._rows = np.zeros((0, ROW_SIZE))  # of the last call

    @property
    def statuses(self) -> tuple[str, ...]:
        """Of stage 2's solver for each observation of the last call, for reports; empty without a stage 2."""
        rows = self._rows if self._stage_2.decides else self._rows[:0]
        return tuple(STATUS[int(index)] for index in rows[:, STATUS_COLUMN].tolist())

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Actions, Any]:
        """Action (7,) or (n, 7), float32 in [-1, 1], and the state, unchanged.

        Args:
            observation: (36,) or (n, 36), see `observation.py`.
            state: passed through; the policy has no memory.
            episode_start: ignored.
            deterministic: ignored.
        """
        batch, single = as_batch(observation)
        actions = self._decide(batch)[0]
        return (actions[0] if single else actions), state

    def plan(self, observation: ArrayLike) -> Plan:
        """The plan of one observation (36,), with what led to it."""
        batch, single = as_batch(observation)
        if not single:
            raise InvalidValueError(f"plan takes one observation ({OBSERVATION_SIZE},), got {batch.shape}")
        _, rows = self._decide(batch)
        return plan_of_row(rows[0], next(iter(self.statuses), self.name))

    def _decide(self, batch: Floats) -> tuple[Actions, Floats]:
        """Actions (n, 7) of observations (n, 36), and the rows (n, ROW_SIZE) that both stages have written.

        Raises:
            InvalidValueError: an observation that is not finite or too large, or for which no plan exists.
        """
        n = len(batch)
        actions, rows = np.empty((n, GAIT_SIZE), np.float32), np.empty((n, ROW_SIZE))
        if n < 2 * ROWS_A_THREAD or self._stage_2.workers < self._threads.threads:
            self._act(batch, actions, rows, 0)
        else:
            self._share(batch, actions, rows)
        self._rows = rows
        return actions, rows

    def _share(self, batch: Floats, actions: Actions, rows: Floats) -> None:
        """The way of `_act`, its observations shared by threads."""

        def job(worker: int, first: int, end: int) -> None:
            part = slice(first, end)
            self._act(batch[part], actions[part], rows[part], worker)

        self._threads.run(job, len(batch), ROWS_A_THREAD)

    def _act(self, batch: Floats, actions: Actions, rows: Floats, worker: int) -> None:
        """The way from observations to actions."""
        self._stage_1.plan(batch, rows)
        self._stage_2.regulate(batch, rows, worker)
        scale_actions(rows, batch, *self._bounds, actions)
