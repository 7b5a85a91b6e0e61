"""The two-stage planner and its ablated arms, as functions of the observation alone."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..compiled.compile_notice import announce_compilation
from ..errors import InvalidValueError, UnknownNameError
from ..model.gait_box import GAIT_SIZE, GaitLimits
from ..model.nominal_gait import NominalGait
from ..model.observation import OBSERVATION_SIZE
from ..model.robot import RobotModel
from ..settings.arms import ARMS, PAPER_SUFFIX
from ..settings.planner_config import PlannerConfig
from ..settings.presets import load_preset, named_preset, preset_config
from ..stage_1.planner import (
    GAIT,
    HELD,
    NOMINAL,
    OFFSET,
    REMAINING,
    TARGET,
    scale_actions,
    stage_1_constants,
    stage_1_rows,
)
from ..stage_2.forms import CompiledRule, hold_inputs, make_cop_rule
from ..stage_2.planner import STATUS
from .compiled_two_stage import CompiledTwoStage

POLICY_NAMES = (*ARMS, "random")


Floats = NDArray[np.float64]
Actions = NDArray[np.float32]


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
        return self.gait[0:2]

    @property
    def duration(self) -> float:
        """Step duration T [s]."""
        return float(self.gait[2])

    @property
    def cop(self) -> Floats:
        """CoP, (2,) [m]."""
        return self.gait[3:5]

    @property
    def trunk_acceleration(self) -> Floats:
        """Trunk angular acceleration: pitch, roll, (2,) [rad/s^2]."""
        return self.gait[5:7]


def as_batch(observation: ArrayLike) -> tuple[Floats, bool]:
    """Observations as (n, 36) float64, and whether it was a single one.

    Raises:
        InvalidValueError: for another shape or something that is no number.
    """
    try:
        batch = np.ascontiguousarray(observation, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(f"observation is not an array of numbers: {error}") from None
    single = batch.ndim == 1
    batch = batch.reshape(1, -1) if single else batch
    if not batch.flags.writeable:  # compiled code would be compiled once more for it
        batch = batch.copy()
    if batch.ndim != 2 or batch.shape[1] != OBSERVATION_SIZE:
        raise InvalidValueError(
            f"observation must have shape ({OBSERVATION_SIZE},) or (n, {OBSERVATION_SIZE}), "
            f"got {np.shape(observation)}"
        )
    return batch, single


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
            threads: that plan a batch of 512 observations or more in the default form; the actions do not
                depend on them.
        """
        announce_compilation()
        self.robot = RobotModel() if robot is None else robot
        self.limits = GaitLimits.of(self.robot) if limits is None else limits
        self.config = preset_config("default") if config is None else config
        self.name = name
        self._adapt = adapt
        self._constants = stage_1_constants(self.robot, self.limits, self.config)
        self._low, self._high = self.limits.low, self.limits.high
        self._cop_rule = make_cop_rule(self.robot, self.limits, self.config, threads)
        self._compiled: CompiledTwoStage | None = None
        if isinstance(self._cop_rule, CompiledRule):
            planner = self._cop_rule.planner
            self._compiled = CompiledTwoStage(self.robot, self.limits, self.config, adapt, planner)
        self._statuses: Sequence[str] | Floats = ()  # or indices into STATUS

    @property
    def statuses(self) -> tuple[str, ...]:
        """Of stage 2's solver for each observation of the last call, for reports; empty without a stage 2."""
        if isinstance(self._statuses, np.ndarray):
            self._statuses = [STATUS[int(index)] for index in self._statuses.tolist()]
        return tuple(self._statuses)

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
        if self._compiled is not None:
            planned = self._compiled(batch)
            if planned is not None:
                actions, self._statuses = planned[0], planned[1][:, 6]
                return (actions[0] if single else actions), state
        rows = self._rows(batch)
        if self._cop_rule is not None:
            self._regulate(batch, rows)
        actions = scale_actions(rows, batch, self._low, self._high, self.config.double_support)
        return (actions[0] if single else actions), state

    def plan(self, observation: ArrayLike) -> Plan:
        """The plan of one observation (36,), with what led to it."""
        batch, single = as_batch(observation)
        if not single:
            raise InvalidValueError(f"plan takes one observation ({OBSERVATION_SIZE},), got {batch.shape}")
        rows = self._rows(batch)
        row = rows[0]
        dcm_end, status = row[GAIT][:2] + row[OFFSET], self.name
        if self._cop_rule is not None:
            ends, statuses = self._regulate(batch, rows)
            dcm_end, status = ends[0], statuses[0]
        return Plan(
            gait=row[GAIT],
            offset=row[OFFSET],
            nominal=NominalGait(*(float(value) for value in row[NOMINAL])),
            dcm_target=row[TARGET],
            dcm_end=dcm_end,
            remaining=float(row[REMAINING]),
            held=bool(row[HELD]),
            status=status,
        )

    def _rows(self, batch: Floats) -> Floats:
        rows, finite = stage_1_rows(batch, self._constants, self._low, self._high, self._adapt)
        if not finite:
            raise InvalidValueError("observation must be finite, got NaN or infinity")
        return rows

    def _regulate(self, batch: Floats, rows: Floats) -> tuple[Floats, list[str]]:
        """Stage 2: write CoP and trunk acceleration into the rows; returns the expected DCMs and statuses."""
        assert self._cop_rule is not None  # noqa: S101
        result, statuses = self._cop_rule(batch, rows)
        self._statuses = statuses
        uses = self.config.use_cop, self.config.use_trunk
        for i in np.flatnonzero(rows[:, HELD]):
            hold_inputs(batch[i], rows[i], self._low, self._high, *uses, result[i])
        rows[:, 3:5] = result[:, 0:2]
        if self.config.use_trunk:
            rows[:, 5:7] = result[:, 2:4]
        return result[:, 4:6], statuses


class RandomPolicy:
    """Uniform actions, drawn from a hash of the observation so that equal episodes get equal actions."""

    def __init__(self, name: str = "random"):
        self.name = name

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Actions, Any]:
        """Action (7,) or (n, 7), float32 in [-1, 1], and the state, unchanged."""
        batch, single = as_batch(observation)
        if not np.isfinite(batch).all():
            raise InvalidValueError("observation must be finite, got NaN or infinity")
        actions = np.empty((len(batch), GAIT_SIZE), dtype=np.float32)
        for obs, action in zip(batch, actions, strict=True):
            action[:] = np.random.default_rng(zlib.crc32(obs.tobytes())).uniform(-1.0, 1.0, GAIT_SIZE)
        return (actions[0] if single else actions), state


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
    config = config.replace(**ARMS[name]._asdict())
    return TwoStagePolicy(robot, limits, config, adapt=name != "passive", name=name)
