"""The two-stage planner as a policy, observation -> stage 1 -> stage 2 -> action, and all analytic policies.

The variants of the planner, the paper's and the field's baselines are this one policy under other settings.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError, UnknownNameError
from ..jit import RangeThreads, announce_compilation, njit
from ..model.gait_box import COP, DURATION, GAIT_SIZE, STEP, TRUNK, GaitLimits
from ..model.nominal_gait import NOMINAL_SIZE, NominalGait, scale_action
from ..model.observation import ELAPSED, OBSERVATION_SIZE, as_batch
from ..model.robot import RobotModel
from ..settings import PAPER_SUFFIX, VARIANTS, PlannerConfig, load_preset, named_preset, preset_config
from ..stage_1 import DCM_END, HELD, NOMINAL, OFFSET, REMAINING, ROW_SIZE, STATUS, TARGET, StepPlanner
from ..stage_2.problem import STATUS as STATUS_NAMES
from ..stage_2.problem import NoStage2, OneAxisTrunk, Regulator
from ..stage_2.single_support import CopPlanner
from ..validation import require_kind

Actions = NDArray[np.float32]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """Decision of the planner for one observation, canonical frame."""

    gait: Floats  # (7,), units of GAIT_NAMES
    offset: Floats  # DCM offset b that stage 1 expects, (2,) [m]
    nominal: NominalGait
    dcm_target: Floats  # xi_des = u_T + b_nom, (2,) [m]
    dcm_end: Floats  # DCM that stage 2 expects at touchdown, (2,) [m]; u_T + b without stage 2
    remaining: float  # until the new foot carries load [s]
    held: bool  # the step plan is the previous one
    status: str  # of stage 2's solver, or the policy's name without a stage 2

    @classmethod
    def of_row(cls, row: Floats, status: str) -> Plan:
        """The plan in a row (ROW_SIZE,) that both stages have written."""
        return cls(
            gait=row[:GAIT_SIZE],
            offset=row[OFFSET : OFFSET + 2],
            nominal=NominalGait(*row[NOMINAL : NOMINAL + NOMINAL_SIZE].tolist()),
            dcm_target=row[TARGET : TARGET + 2],
            dcm_end=row[DCM_END : DCM_END + 2],
            remaining=float(row[REMAINING]),
            held=bool(row[HELD]),
            status=status,
        )

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


def make_regulator(
    robot: RobotModel, limits: GaitLimits, config: PlannerConfig, threads: int = 1
) -> Regulator:
    """Stage 2 of a configuration; the default form may be called on `threads` threads.

    About an axis that the waist lacks no trunk acceleration is planned.

    Raises:
        InvalidValueError: the paper's form is asked for double support, which it has no bounds for.
    """
    if config.foothold == "linear_mpc":
        from .linear_mpc import LinearMpc

        return LinearMpc(robot, limits, config)
    both = config.double_support > 0
    if not any(limits.trunk_accelerations):
        config = config.replace(use_trunk=False)
    if both and config.form == "jerk" and (config.use_cop or config.use_trunk):
        raise InvalidValueError(
            f"stage 2 plans double support ({config.double_support} s) in form 'zoh' only, got form 'jerk'; "
            "set double_support to 0 or choose form 'zoh'"
        )

    def single_support(use_trunk: bool) -> Regulator:
        own = config.replace(use_trunk=use_trunk)
        if not (own.use_cop or use_trunk):
            return NoStage2()
        if own.form == "zoh":
            return CopPlanner(robot, limits, own, 1 if both else threads)
        from ..stage_2.paper_form import JerkCopPlanner

        return JerkCopPlanner(robot, limits, own)

    single = single_support(config.use_trunk)
    if config.use_trunk and not all(limits.trunk_accelerations):
        single = OneAxisTrunk(single, single_support(False), limits.trunk_accelerations.index(0.0))
    if not (both and single.decides):
        return single
    from ..stage_2.double_support import DoubleSupportPlanner, WithDoubleSupport

    return WithDoubleSupport(DoubleSupportPlanner(robot, limits, config), single)


ROWS_A_THREAD = 256  # with fewer plans, waking a thread costs what it saves


@njit(cache=True, nogil=True)
def scale_actions(gaits, observations, low, high, double_support, actions):  # pragma: no cover
    """`scale_action` of every row, whose first seven columns are gait variables, into actions (n, 7)."""
    for i in range(gaits.shape[0]):
        scale_action(gaits[i], observations[i], low, high, double_support, actions[i])


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
        robot = RobotModel() if robot is None else robot
        self.robot, self.name = require_kind("robot", robot, RobotModel), name
        self.limits = require_kind("limits", GaitLimits.of(robot) if limits is None else limits, GaitLimits)
        config = preset_config("default") if config is None else config
        self.config = require_kind("config", config, PlannerConfig)
        self._threads = RangeThreads(threads)
        self._stage_1 = StepPlanner(self.robot, self.limits, self.config, adapt)
        self._stage_2 = make_regulator(self.robot, self.limits, self.config, self._threads.threads)
        self._standers: dict[int, Any] = {}  # a `Stander` for each thread that has met a standing robot
        self._bounds = self.limits.low, self.limits.high, self.config.double_support
        self._rows = np.zeros((0, ROW_SIZE))  # of the last call

    @property
    def statuses(self) -> tuple[str, ...]:
        """Statuses of stage 2's solver for each observation of the last call; empty without a stage 2."""
        rows = self._rows if self._stage_2.decides else self._rows[:0]
        return tuple(STATUS_NAMES[int(index)] for index in rows[:, STATUS].tolist())

    def predict(
        self, observation: ArrayLike, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Any]:
        """Action (7,) or (n, 7), float32 in [-1, 1], and the state, unchanged: the policy has no memory.

        The observation is (36,) or (n, 36), see `model/observation`; the other arguments are ignored.
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
        return Plan.of_row(rows[0], next(iter(self.statuses), self.name))

    def _decide(self, batch: Floats) -> tuple[Actions, Floats]:
        """Actions (n, 7) of observations (n, 36), and the rows (n, ROW_SIZE) that both stages have written.

        Raises:
            InvalidValueError: an observation that is not finite or too large, or for which no plan exists.
        """
        n = len(batch)
        actions, rows = np.empty((n, GAIT_SIZE), np.float32), np.empty((n, ROW_SIZE))

        def act(worker: int, first: int, end: int) -> None:
            seen, own = batch[first:end], rows[first:end]
            if standing := self._stage_1.plan(seen, own):
                self._act_standing(seen, own, standing, worker)
            else:
                self._stage_2.regulate(seen, own, worker)
            scale_actions(own, seen, *self._bounds, actions[first:end])

        if n < 2 * ROWS_A_THREAD or self._stage_2.workers < self._threads.threads:
            act(0, 0, n)
        else:
            self._threads.run(act, n, ROWS_A_THREAD)
        self._rows = rows
        return actions, rows

    def _act_standing(self, batch: Floats, rows: Floats, standing: int, worker: int) -> None:
        """Stage 2 where so many robots stand on both feet."""
        if (stander := self._standers.get(worker)) is None:
            from .standing import Stander

            stages = self._stage_1, self._stage_2
            stander = Stander(self.robot, self.limits, self.config, *stages, worker)
            self._standers[worker] = stander
        if standing < len(batch):
            walking = batch[:, ELAPSED] >= 0.0
            part = rows[walking]
            self._stage_2.regulate(batch[walking], part, worker)
            rows[walking] = part
        stander.plan(batch, rows)


class RandomPolicy:
    """Uniform actions, drawn from a hash of the observation so that equal episodes get equal actions."""

    batchable = memoryless = True

    def __init__(
        self, name: str = "random", observation_size: int = OBSERVATION_SIZE, action_size: int = GAIT_SIZE
    ):
        self.name, self.observation_size, self.action_size = name, observation_size, action_size

    def predict(
        self, observation: ArrayLike, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Any]:
        """Actions (action_size,) or (n, action_size), float32 in [-1, 1], and the state, unchanged."""
        batch, single = as_batch(observation, self.observation_size)
        if not np.isfinite(batch).all():
            raise InvalidValueError("observation must be finite, got NaN or infinity")
        actions = np.empty((len(batch), self.action_size), dtype=np.float32)
        for obs, action in zip(batch, actions, strict=True):
            rng = np.random.default_rng(zlib.crc32(obs.tobytes()))
            action[:] = rng.uniform(-1.0, 1.0, self.action_size)
        return (actions[0] if single else actions), state


POLICY_NAMES = (*VARIANTS, "random")


def make_policy(
    name: str, robot: RobotModel | None = None, limits: GaitLimits | None = None, preset: str = "default"
) -> TwoStagePolicy | RandomPolicy:
    """Build an analytic policy by name.

    The variants differ in what they may use. Their weights are the preset's, except for variants with gains
    of their own (`arms` of a preset), and the two `-paper` ones, which put the paper's Table II into it.

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
    config = config.replace(**VARIANTS[name].settings)
    return TwoStagePolicy(robot, limits, config, adapt=name != "passive", name=name)
