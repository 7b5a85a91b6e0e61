"""Episodes of n robots on one core: start, planning period, reward, end; every gait environment has them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..controllers.config import PRESETS, preset_config
from ..controllers.errors import InvalidValueError
from ..controllers.limits import GaitLimits
from ..controllers.nominal_gait import NominalGait, nominal_gait
from ..controllers.robot import RobotModel
from .gait_monitor import GaitMonitor
from .gait_reward import GaitReward, Reward
from .nominal_start import nominal_start
from .scenario import Scenario

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Motion(NamedTuple):
    """How far n robots have come."""

    steps: Ints  # (n,) completed
    com: Array  # (n, 2) in the heading frame [m]
    time: Array  # (n,) since reset [s]
    side: Ints  # (n,) stance foot, index into SIDES


class World(NamedTuple):
    """What `info` tells of n robots in the world frame."""

    dcm: Array  # (n, 2) [m]
    cop: Array  # (n, 2) [m]
    cmp: Array  # (n, 2) [m]
    loaded: Mask  # (n, 2) whether the foot carries load, in the order of SIDES


class Period(NamedTuple):
    """What came of one planning period for n robots."""

    reward: Reward
    failed: Mask  # (n,)
    truncated: Mask  # (n,)


@njit(cache=True)
def _clock(start, duration, count, fixed, settle, time, push_end, over):  # pragma: no cover
    """Write the end of the last push (n,) [s], 0 without pushes, and whether the scenario is over (n,)."""
    for k in range(time.shape[0]):
        last = 0.0 if count[k] == 0 else -np.inf
        for i in range(count[k]):
            last = max(last, start[k, i] + duration[k, i])
        push_end[k] = last
        end = last + settle[k] if np.isnan(fixed[k]) else fixed[k]
        over[k] = time[k] >= end - 1e-9


class GaitEpisodes(ABC):
    """Episodes of n robots of one kind; none depends on the others. A subclass brings the physics as `core`.

    The core offers arrays of length n: `observation`, `command`, `previous_action`, `margin` and `pushes`;
    `reset(k, scenario, start, gait, action)`; `step(gaits, actions)`; and what the abstract methods ask for.
    """

    failures: ClassVar[tuple[str, ...]]  # reasons of a fall; index 0 is none
    has_double_support: ClassVar[bool] = False  # whether the physics knows it
    core: Any

    def __init__(self, n: int, robot: RobotModel, limits: GaitLimits, preset: str, control_hz: float):
        """Set up all but the core.

        Raises:
            InvalidValueError: no robot; a rate outside 20-1000 Hz; or a preset with double support,
                which the robot does not know.
            UnknownNameError: for an unknown preset.
        """
        if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 1:
            raise InvalidValueError(f"num_envs must be a whole number >= 1, got {n!r}")
        if not (isinstance(control_hz, int | float) and 20.0 <= control_hz <= 1000.0):
            raise InvalidValueError(f"control_hz must lie within 20-1000 Hz, got {control_hz!r}")
        config = preset_config(preset)
        if config.double_support > 0 and not self.has_double_support:
            valid = [name for name, other in PRESETS.items() if other.double_support == 0]
            raise InvalidValueError(
                f"preset {preset!r} walks with double support of {config.double_support} s, which this robot "
                f"does not know; choose from: {', '.join(valid)}"
            )
        self.n, self.robot, self.limits, self.preset = int(n), robot, limits, preset
        self.control_hz = control_hz
        timing = self.touchdown_delay, self.double_support = config.touchdown_delay, config.double_support
        self.monitor = GaitMonitor(self.n, robot, limits, *timing)
        self._reward = GaitReward(robot, limits, *timing)
        self.planned = np.ones(n)  # step duration T that the last action asked for [s]
        self._count = np.zeros(n, np.int64)  # pushes
        self._fixed, self._settle = np.full(n, np.nan), np.zeros(n)  # of Scenario.end_time [s]

    @abstractmethod
    def motion(self) -> Motion:
        """Steps, CoM, time and stance sides."""

    @abstractmethod
    def failure(self) -> Ints:
        """Why the robots have fallen, (n,) index into `failures`."""

    @abstractmethod
    def world(self) -> World:
        """Points in the world and contacts; fresh arrays."""

    def gaits(self, actions: NDArray[np.float32]) -> Array:
        """Gait variables (n, 7) that actions (n, 7) mean now."""
        return self.limits.from_action(actions)

    def nominal(self, vx: float, vy: float) -> NominalGait:
        """Nominal gait of a velocity in the canonical frame [m/s]."""
        return nominal_gait(self.robot, self.limits, (vx, vy), self.touchdown_delay, self.double_support)

    def begin(self, k: int, scenario: Scenario) -> None:
        """Put robot k at the beginning of a nominal step of a scenario."""
        sign = -1.0 if scenario.stance_side == "left" else 1.0
        gait = self.nominal(scenario.command.vx, sign * scenario.command.vy)
        start = nominal_start(
            gait, self.robot.pelvis_width, self.robot.omega, self.touchdown_delay, self.double_support
        )
        values = np.array([gait.length, gait.width, gait.duration, 0.0, 0.0, 0.0, 0.0])
        self.core.reset(k, scenario, start, values, self.limits.to_action(values).astype(np.float64))
        self.monitor.reset(k)
        self.planned[k] = gait.duration
        self._count[k] = len(scenario.pushes)
        self._fixed[k] = np.nan if scenario.duration is None else scenario.duration
        self._settle[k] = scenario.settle_time

    def step(self, actions: NDArray[np.float32]) -> Period:
        """One planning period of all robots under actions (n, 7) in [-1, 1]; those at their end go on too."""
        core = self.core
        before = core.previous_action.copy()
        gaits = self.gaits(actions)
        core.step(gaits, actions.astype(np.float64))
        motion = self.motion()
        push_end, over = np.empty(self.n), np.empty(self.n, np.bool_)
        pushes = core.pushes
        _clock(
            pushes.start, pushes.duration, self._count, self._fixed, self._settle, motion.time, push_end, over
        )
        self.monitor.update(motion.steps, core.observation, motion.com, motion.time, push_end, core.command)
        self.planned = np.ascontiguousarray(gaits[:, 2])
        failed = self.failure() != 0
        reward = self._reward(core.observation, before, self.planned, core.margin, failed)
        return Period(reward, failed, over & ~failed)
