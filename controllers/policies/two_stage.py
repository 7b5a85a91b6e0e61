"""The two-stage planner as a policy, its plans, and the analytic policies by name.

What the two-stage planner decided for one observation.

The two-stage planner as a policy: observation -> stage 1 -> stage 2 -> action, one way for every arm.

The analytic policies by name: the two-stage planner, its ablated arms, the paper's and the baselines.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError, UnknownNameError
from ..jit import RangeThreads, announce_compilation
from ..model.double_support import scale_actions
from ..model.gait_box import COP, DURATION, GAIT_SIZE, STEP, TRUNK, GaitLimits
from ..model.nominal_gait import NOMINAL_SIZE, NominalGait
from ..model.observation import OBSERVATION_SIZE, as_batch
from ..model.robot import RobotModel
from ..settings import ARMS, PAPER_SUFFIX, PlannerConfig, load_preset, named_preset, preset_config
from ..stage_1 import DCM_END, HELD, NOMINAL, OFFSET, REMAINING, ROW_SIZE, TARGET, StepPlanner
from ..stage_1 import STATUS as STATUS_COLUMN
from ..stage_2.problem import STATUS, Regulator
from ..stage_2.regulator import make_regulator
from ..validation import require_kind
from .interface import RandomPolicy
from .linear_mpc import LinearMpc

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """What a policy decided for one observation, canonical frame."""

    gait: Floats  # (7,), units of GAIT_NAMES
    offset: Floats  # DCM offset b that stage 1 expects, (2,) [m]
    nominal: NominalGait
    dcm_target: Floats  # xi_des = u_T + b_nom, (2,) [m]
    dcm_end: Floats  # DCM that stage 2 expects at touchdown, (2,) [m]; u_T + b without stage 2
    remaining: float  # until the new foot carries load [s]
    held: bool  # the step plan is the previous one
    status: str  # of stage 2's solver, or of the arm

    @property
    def step(self) -> Floats:
        """Foothold u_T, (2,) [m]."""
        return self.gait[STEP : STEP + 2]

    @property
    def duration(self) -> float:
        """Step duration T [s]."""
        return float(self.gait[DURATION])

    @property
    def cop(self) -> Floats:
        """CoP, (2,) [m]."""
        return self.gait[COP : COP + 2]

    @property
    def trunk_acceleration(self) -> Floats:
        """Trunk angular acceleration: pitch, roll, (2,) [rad/s^2]."""
        return self.gait[TRUNK : TRUNK + 2]


def plan_of_row(row: Floats, status: str) -> Plan:
    """The plan in a row (ROW_SIZE,) that both stages have written."""
    return Plan(
        gait=row[:GAIT_SIZE],
        offset=row[OFFSET : OFFSET + 2],
        nominal=NominalGait(*(float(value) for value in row[NOMINAL : NOMINAL + NOMINAL_SIZE])),
        dcm_target=row[TARGET : TARGET + 2],
        dcm_end=row[DCM_END : DCM_END + 2],
        remaining=float(row[REMAINING]),
        held=bool(row[HELD]),
        status=status,
    )


Actions = NDArray[np.float32]

ROWS_A_THREAD = 256  # with fewer plans, waking a thread costs what it saves


class TwoStagePolicy:
    """Stage 1, then stage 2 where CoP or trunk may be used; a pure function of the observation."""

    batchable = memoryless = True

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


POLICY_NAMES = (*ARMS, "random")


def make_policy(
    name: str,
    robot: RobotModel | None = None,
    limits: GaitLimits | None = None,
    preset: str = "default",
) -> TwoStagePolicy | RandomPolicy:
    """Build an analytic policy by name.

    The arms differ in what they may use. Their weights are the preset's, except for arms with gains of their
    own (`arms` of a preset), and the two `-paper` arms, which put the paper's Table II into it.

    Args:
        name: one of POLICY_NAMES.
        robot: physical constants; the paper's by default.
        limits: step box, CoP and trunk bounds; the paper's for the robot by default.
        preset: by name or file.

    Raises:
        UnknownNameError: for a name that is not in POLICY_NAMES or an unknown preset; lists the valid ones.
        InvalidValueError: a preset file that cannot be read.
    """
    if name not in POLICY_NAMES:
        raise UnknownNameError("policy", name, POLICY_NAMES)
    config = load_preset(preset).config(name)
    if name == "random":
        return RandomPolicy()
    if name.endswith(PAPER_SUFFIX):
        config = config.replace(**named_preset("paper").planner)
    config = config.replace(**ARMS[name].settings)
    return TwoStagePolicy(robot, limits, config, adapt=name != "passive", name=name)
