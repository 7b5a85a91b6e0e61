"""What the gait environments share: spaces, scenarios, reward, info and the recovered criterion."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.jit import njit
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.model.nominal_gait import NominalGait
from ...controllers.model.robot import RobotModel, Similarity
from ...controllers.validation import require_integer
from ..scenario.distribution import PushDistribution
from ..scenario.scenario import Scenario
from ..snapshot import RobotSnapshot
from .action_meaning import meaning_of, note
from .episodes import GaitEpisodes
from .info import InfoReader

Array = NDArray[np.float64]

RENDER_MODES = ("human", "rgb_array")


def check_action(
    action: ArrayLike, name: str = "action", shape: tuple[int, ...] = (GAIT_SIZE,)
) -> NDArray[np.float32]:
    """Actions of a shape as float32, clipped to [-1, 1]; `name` is what errors call it.

    Raises:
        InvalidValueError: for another shape, something that is no real number, or NaN or infinity.
    """
    try:
        values = np.array(action, order="C")
    except (TypeError, ValueError) as error:  # ragged
        raise InvalidValueError(f"{name} is not an array of numbers: {error}") from None
    if values.dtype != np.float32:
        values = _as_single(values, name)
    if values.shape != shape:
        raise InvalidValueError(f"{name} must have shape {shape}, got {values.shape}")
    if not _clip(values.reshape(-1)):
        bad = values if values.ndim == 1 else values[~np.isfinite(values).all(axis=1)][0]
        raise InvalidValueError(f"{name} must be finite, within [-1, 1], got {bad.tolist()}")
    return values


def _as_single(values: NDArray[Any], name: str) -> NDArray[np.float32]:
    """Real numbers as float32; finite ones beyond its range, such as 1e300, become +-1, as `_clip` has it."""
    if values.dtype == np.object_ and all(isinstance(value, int) for value in values.flat):
        values = np.clip(values, -1, 1).astype(np.float64)  # integers of any size
    if values.dtype.kind not in "biuf":
        raise InvalidValueError(f"{name} is not an array of numbers: it holds {values.dtype}")
    finite = np.isfinite(values)
    return np.where(finite, np.clip(values, -1, 1), values).astype(np.float32)


@njit(cache=True)
def _clip(values):  # pragma: no cover
    """Clip numbers (n,) to [-1, 1] in place; False, and nothing done, where one is not finite."""
    for i in range(values.shape[0]):
        if not np.isfinite(values[i]):
            return False
    for i in range(values.shape[0]):
        values[i] = min(max(values[i], np.float32(-1.0)), np.float32(1.0))
    return True


def spaces_of(episodes: GaitEpisodes) -> tuple[Any, Any]:
    """Observation space and action space of one robot of such episodes, each with a note of what it is."""
    seen = spaces.Box(-np.inf, np.inf, (episodes.observation_size,), np.float64)
    action = spaces.Box(-1.0, 1.0, (episodes.action_size,), np.float32)
    return note(seen, {"environment": episodes.name}), note(action, meaning_of(episodes))


def check_push_distribution(
    distribution: dict[str, Any] | PushDistribution | None, robot: RobotModel
) -> PushDistribution:
    """A push distribution from what a constructor takes; for None the default one, of the robot's size.

    Raises:
        InvalidValueError: neither a PushDistribution nor a dict, or an impossible field.
    """
    if isinstance(distribution, dict):
        distribution = PushDistribution.from_dict(distribution)
    if not isinstance(distribution, PushDistribution | None):
        raise InvalidValueError(
            f"push_distribution must be a PushDistribution or its dict, got {distribution!r}"
        )
    return PushDistribution().scaled(Similarity.of(robot)) if distribution is None else distribution


def check_scenario(scenario: object) -> Scenario:
    """A scenario out of reset options.

    Raises:
        InvalidValueError: for anything else.
    """
    if not isinstance(scenario, Scenario):
        raise InvalidValueError(f"options['scenario'] must be a Scenario, got {type(scenario).__name__}")
    return scenario


class GaitEnv(gym.Env[Array, NDArray[np.float32]]):
    """Base of the environments whose action is a gait: Gymnasium's face of the episodes of one robot."""

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": list(RENDER_MODES),
        "render_fps": 100,
    }

    def __init__(
        self,
        episodes: GaitEpisodes,
        render_mode: str | None,
        push_distribution: dict[str, Any] | PushDistribution | None,
    ):
        """Set up the spaces.

        Raises:
            UnknownNameError: for an unknown render mode.
            InvalidValueError: for an impossible push distribution.
        """
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise UnknownNameError("render mode", render_mode, RENDER_MODES)
        self.render_mode = render_mode
        self.push_distribution = check_push_distribution(push_distribution, episodes.robot)
        self.episodes = episodes
        self.core: Any = episodes.core
        self.monitor, self.robot, self.limits = episodes.monitor, episodes.robot, episodes.limits
        self.preset, self.double_support = episodes.preset, episodes.double_support
        self.dt = 1.0 / episodes.control_hz  # planning period [s]
        self.metadata = {**self.metadata, "render_fps": round(episodes.control_hz)}  # type: ignore[misc]
        self.observation_space, self.action_space = spaces_of(episodes)
        self._info = InfoReader(episodes)
        self.scenario: Scenario | None = None
        self._picture: Any = None  # what `render` draws with
        self._ended = True
        self.after_period: list[Callable[[], None]] = []  # called at the end of every planning period

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode at the beginning of a nominal step.

        Args:
            seed: of the push distribution.
            options: {"scenario": Scenario} runs exactly that one; without it one is drawn.

        Raises:
            InvalidValueError: a seed that is no integer >= 0, or options or a scenario that are none.
            UnknownNameError: another option.
        """
        super().reset(seed=None if seed is None else require_integer("seed", seed))
        self.scenario = self._scenario(options)
        self.episodes.begin(0, self.scenario)
        self._info.begin(0, self.scenario)
        self._ended = False
        if self.render_mode == "human":
            self.render()
        terms = np.zeros(len(self.episodes.reward_terms))
        return self.episodes.seen[0].copy(), self._info.of_robot(0, terms)

    def step(self, action: ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One planning period under an action in [-1, 1]; entries outside are clipped."""
        if self.scenario is None or self._ended:
            raise InvalidValueError("the episode has ended or not begun: call reset() before step()")
        period = self.episodes.step(check_action(action, shape=(self.episodes.action_size,))[None])
        for look in self.after_period:
            look()
        terminated, truncated = period.failed.item(0), period.truncated.item(0)
        self._ended = terminated or truncated
        info = self._info.of_robot(0, period.reward.terms[0])
        if self.render_mode == "human":
            self.render()
        return self.episodes.seen[0].copy(), period.reward.total.item(0), terminated, truncated, info

    def state_snapshot(self) -> RobotSnapshot:
        """The whole state of the robot in mid-episode, which `restore` puts back.

        Raises:
            InvalidValueError: the episode has ended or not begun, or robots of this kind are not put back.
        """
        if self._ended:
            raise InvalidValueError("the episode has ended or not begun: there is nothing to go on with")
        return self.episodes.state_snapshot(0)

    def restore(
        self, snapshot: RobotSnapshot, scenario: Scenario | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Put the robot back where one was; it goes on bit for bit as that did.

        Args:
            snapshot: of a robot of this kind, from this environment, another one or a vector of them.
            scenario: what goes on from there; None: the snapshot's own. It may have other pushes that have
                not begun, and another end.

        Returns:
            Observation (36,) and info, as `reset` gives them.

        Raises:
            InvalidValueError: a snapshot of another kind of robot, or a scenario that differs in what has
                happened already.
        """
        self.episodes.restore(0, snapshot, scenario)
        self.scenario = snapshot.scenario if scenario is None else scenario
        self._info.begin(0, self.scenario)
        self._ended = False
        terms = np.zeros(len(self.episodes.reward_terms))
        return self.episodes.seen[0].copy(), self._info.of_robot(0, terms)

    def __copy__(self) -> Self:
        """A copy shares nothing with its original, or is refused (a biped's)."""
        return copy.deepcopy(self)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._picture is not None:
            self._picture.close()
            self._picture = None

    def _scenario(self, options: dict[str, Any] | None) -> Scenario:
        if not isinstance(options, dict | None):
            raise InvalidValueError(f"reset options must be a dict, got {options!r}")
        if unknown := set(options or {}) - {"scenario"}:
            raise UnknownNameError("reset option", sorted(unknown, key=str)[0], ["scenario"])
        scenario = (options or {}).get("scenario")
        if scenario is None:
            return self.episodes.drawn(self.push_distribution, self.np_random)
        return check_scenario(scenario)

    def _nominal(self, vx: float, vy: float) -> NominalGait:
        return self.episodes.nominal(vx, vy)
