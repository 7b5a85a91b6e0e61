"""What the gait environments share: spaces, scenarios, reward, info and the recovered criterion."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from ..controllers.capturability import step_start_dcm
from ..controllers.config import PRESETS, preset_config
from ..controllers.errors import InvalidValueError, UnknownNameError
from ..controllers.limits import GAIT_SIZE, GaitLimits
from ..controllers.nominal_gait import NominalGait, nominal_gait
from ..controllers.observation import COMMAND, OBSERVATION_SIZE
from ..controllers.robot import RobotModel
from .gait_monitor import GaitMonitor
from .gait_reward import REWARD_TERMS, RewardInput
from .nominal_start import nominal_start
from .push import Push
from .scenario import PushDistribution, Scenario

Array = NDArray[np.float64]

RENDER_MODES = ("human", "rgb_array")


def check_action(action: ArrayLike, name: str = "action") -> NDArray[np.float32]:
    """A gait action (7,) as float32, clipped to [-1, 1]; `name` is what errors call it.

    Raises:
        InvalidValueError: for another shape, or NaN or infinity.
    """
    try:
        values = np.asarray(action, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(f"{name} is not an array of numbers: {error}") from None
    if values.shape != (GAIT_SIZE,):
        raise InvalidValueError(f"{name} must have shape ({GAIT_SIZE},), got {values.shape}")
    if not np.isfinite(values).all():
        raise InvalidValueError(f"{name} must be finite, within [-1, 1], got {values.tolist()}")
    return np.clip(values, -1.0, 1.0)


class GaitEnv(gym.Env[Array, NDArray[np.float32]]):
    """Base of the environments whose action is a gait; a subclass brings the physics as a core of one robot.

    The core offers arrays of length 1: `observation`, `command`, `previous_action`, `margin` and `pushes`;
    `reset(k, scenario, start, gait, action)`; `step(gaits, actions)`; and what the abstract methods ask for.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": list(RENDER_MODES),
        "render_fps": 100,
    }

    robot: RobotModel
    limits: GaitLimits
    preset: str
    dt: float  # planning period [s]
    has_double_support = False  # whether the physics knows it

    def __init__(
        self,
        robot: RobotModel,
        limits: GaitLimits,
        preset: str,
        control_hz: float,
        render_mode: str | None,
        push_distribution: dict[str, Any] | PushDistribution | None,
    ):
        """Set up spaces and monitor.

        Raises:
            InvalidValueError: for a rate outside 20-1000 Hz.
            UnknownNameError: for an unknown preset or render mode.
            InvalidValueError: the preset walks with double support, which the robot does not know.
        """
        if not (isinstance(control_hz, int | float) and 20.0 <= control_hz <= 1000.0):
            raise InvalidValueError(f"control_hz must lie within 20-1000 Hz, got {control_hz!r}")
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise UnknownNameError("render mode", render_mode, RENDER_MODES)
        self.robot, self.limits, self.preset, self.render_mode = robot, limits, preset, render_mode
        self.dt = 1.0 / control_hz
        self.metadata = {**self.metadata, "render_fps": round(control_hz)}  # type: ignore[misc]
        config = preset_config(preset)
        self.touchdown_delay, self.double_support = config.touchdown_delay, config.double_support
        if self.double_support > 0 and not self.has_double_support:
            valid = [name for name, other in PRESETS.items() if other.double_support == 0]
            raise InvalidValueError(
                f"preset {preset!r} walks with double support of {self.double_support} s, which this robot "
                f"does not know; choose from: {', '.join(valid)}"
            )
        self.action_space = spaces.Box(-1.0, 1.0, (GAIT_SIZE,), np.float32)
        self.observation_space = spaces.Box(-np.inf, np.inf, (OBSERVATION_SIZE,), np.float64)
        if isinstance(push_distribution, dict):
            push_distribution = PushDistribution.from_dict(push_distribution)
        if not isinstance(push_distribution, PushDistribution | None):
            raise InvalidValueError(
                f"push_distribution must be a PushDistribution or its dict, got {push_distribution!r}"
            )
        self.push_distribution = push_distribution or PushDistribution()
        self.monitor = GaitMonitor(1, robot, limits, self.touchdown_delay, self.double_support)
        self.scenario: Scenario | None = None
        self._picture: Any = None  # what `render` draws with
        self._ended = True
        self._omega = robot.omega
        self._nominal_of: dict[tuple[float, ...], tuple[NominalGait, tuple[float, float]]] = {}  # by command

    # The core's side

    core: Any

    @abstractmethod
    def _motion(self) -> tuple[NDArray[np.int64], Array, Array, int]:
        """Completed steps (1,), CoM (1, 2) in the heading frame [m], time (1,) [s], stance side (0 left)."""

    @abstractmethod
    def _failure(self) -> str | None:
        """Why the robot has fallen, or None."""

    @abstractmethod
    def _world_info(self) -> dict[str, Any]:
        """dcm, cop, cmp in the world frame [m], contacts."""

    # Gymnasium's side

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode at the beginning of a nominal step.

        Args:
            seed: of the push distribution.
            options: {"scenario": Scenario} runs exactly that one; without it one is drawn.
        """
        super().reset(seed=seed)
        self.scenario = self._scenario(options)
        sign = -1.0 if self.scenario.stance_side == "left" else 1.0
        command = self.scenario.command
        gait = self._nominal(command.vx, sign * command.vy)
        start = nominal_start(
            gait, self.robot.pelvis_width, self.robot.omega, self.touchdown_delay, self.double_support
        )
        values = np.array([gait.length, gait.width, gait.duration, 0.0, 0.0, 0.0, 0.0])
        self._nominal_of.clear()
        self.core.reset(0, self.scenario, start, values, self.limits.to_action(values).astype(np.float64))
        self.monitor.reset(0)
        self._ended = False
        if self.render_mode == "human":
            self.render()
        return self.core.observation[0].copy(), self._info(gait.duration, None)

    def step(self, action: ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One planning period under a gait action (7,) in [-1, 1]; entries outside are clipped."""
        if self.scenario is None or self._ended:
            raise InvalidValueError("the episode has ended or not begun: call reset() before step()")
        clipped = check_action(action)
        before = self.core.previous_action[0].tolist()
        gait = self._gait(clipped)
        self.core.step(gait[None], clipped[None].astype(np.float64))
        steps, com, time, _ = self._motion()
        push_end = self.last_push_end()
        self.monitor.update(steps, self.core.observation, com, time, np.array([push_end]), self.core.command)
        failure = self._failure()
        terms = self._reward_terms(before, float(gait[2]), failure is not None)
        truncated = failure is None and bool(time[0] >= self.scenario.end_time(push_end) - 1e-9)
        self._ended = truncated or failure is not None
        info = self._info(float(gait[2]), failure)
        info["reward_terms"] = terms
        if self.render_mode == "human":
            self.render()
        return self.core.observation[0].copy(), sum(terms.values()), failure is not None, truncated, info

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._picture is not None:
            self._picture.close()
            self._picture = None

    def last_push_end(self) -> float:
        """When the last push ends [s]: 0 without pushes, inf while a gait event has not come."""
        assert self.scenario is not None  # noqa: S101
        starts = self.core.pushes.start[0]
        return max(
            (float(starts[i]) + push.duration for i, push in enumerate(self.scenario.pushes)), default=0.0
        )

    def _scenario(self, options: dict[str, Any] | None) -> Scenario:
        if not isinstance(options, dict | None):
            raise InvalidValueError(f"reset options must be a dict, got {options!r}")
        unknown = set(options or {}) - {"scenario"}
        if unknown:
            raise UnknownNameError("reset option", sorted(unknown)[0], ["scenario"])
        scenario = (options or {}).get("scenario")
        if scenario is None:
            return self.push_distribution.sample(self.np_random)
        if not isinstance(scenario, Scenario):
            raise InvalidValueError(f"options['scenario'] must be a Scenario, got {type(scenario).__name__}")
        return scenario

    def _gait(self, action: NDArray[np.float32]) -> Array:
        """Gait variables (7,) that an action (7,) means now."""
        return self.limits.from_action(action)

    def _nominal(self, vx: float, vy: float) -> NominalGait:
        return nominal_gait(self.robot, self.limits, (vx, vy), self.touchdown_delay, self.double_support)

    def _start_dcm(self, nominal: NominalGait) -> tuple[float, float]:
        """DCM at the start of a nominal step, less the CoP's transfer: (u_T + b_nom) / lambda [m]."""
        if self.double_support == 0:
            return step_start_dcm(nominal, self.robot.pelvis_width, self._omega, self.touchdown_delay)
        decay = math.exp(-self._omega * nominal.duration)
        return (nominal.length + nominal.offset_x) * decay, (nominal.width + nominal.offset_y) * decay

    def _reward_terms(self, before: list[float], duration: float, failed: bool) -> dict[str, float]:
        obs = self.core.observation[0].tolist()
        command = tuple(obs[COMMAND])
        if command not in self._nominal_of:
            nominal = self._nominal(*command)
            self._nominal_of[command] = nominal, self._start_dcm(nominal)
        nominal, start = self._nominal_of[command]
        x = RewardInput(
            obs, before, nominal, start, duration, self._omega, float(self.core.margin[0]), failed,
            self.double_support,
        )  # fmt: skip
        return {name: term(x) for name, term in REWARD_TERMS.items()}

    def _info(self, duration: float, failure: str | None) -> dict[str, Any]:
        assert self.scenario is not None  # noqa: S101
        _, _, time, side = self._motion()
        obs = self.core.observation[0]
        return {
            "scenario_id": self.scenario.id,
            "time": float(time[0]),
            "push": self._push_info(float(time[0])),
            "capture_margin": float(self.core.margin[0]),
            "phase": min(float(obs[0]) / duration, 1.0),
            "stance_side": ("left", "right")[side],
            "failure_reason": failure,
            "recovered_at": self.monitor.recovered_at(0),
            "reward_terms": dict.fromkeys(REWARD_TERMS, 0.0),
            **self._world_info(),
        }

    def _push_info(self, time: float) -> dict[str, Any] | None:
        """The latest push that has begun, otherwise the first one; None without pushes."""
        assert self.scenario is not None  # noqa: S101
        if not self.scenario.pushes:
            return None
        starts = self.core.pushes.start[0]
        begun = [i for i in range(len(self.scenario.pushes)) if starts[i] < time]
        index = max(begun, key=lambda i: starts[i]) if begun else 0
        return push_info(self.scenario.pushes[index], float(starts[index]), self.robot.mass)


def push_info(push: Push, start: float, mass: float) -> dict[str, Any]:
    """A push for `info`; its start is None while its gait event has not come."""
    return {
        "force": push.force,
        "direction": push.direction,
        "start": start if math.isfinite(start) else None,
        "duration": push.duration,
        "body": push.body,
        "impulse": push.impulse,
        "impulse_per_kg": push.impulse_magnitude / mass,
    }
