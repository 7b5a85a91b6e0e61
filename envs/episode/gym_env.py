"""Gymnasium's face of episodes: what one robot's environment and that of n share, and that of one robot."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any, ClassVar, Self, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.jit import njit
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.model.robot import Similarity
from ...controllers.validation import require_integer
from ..scenario.distribution import PushDistribution
from ..scenario.scenario import Scenario
from ..snapshot import RobotSnapshot
from .episodes import GaitEpisodes
from .info import InfoReader

Array = NDArray[np.float64]

RENDER_MODES = ("human", "rgb_array")

# What an action means is noted on the action space of its environment, so that a saved model knows it, since
# gait actions, corrections of a planner and held actions have equal spaces. Learning libraries save the
# spaces with a model. Wrappers that make a space of their own leave no note there.
Meaning = dict[str, Any]  # plain values, which can be read without this project
S = TypeVar("S", bound=gym.Space[Any])
NOTE = "push_recovery_meaning"  # attribute of a space
# Of a meaning; all else in it says what the environment is below them
HOLD, RESIDUAL = "hold", "residual"


def noted(space: gym.Space[Any] | None) -> Meaning | None:
    """The meaning that was noted on a space; None where nothing was."""
    return getattr(space, NOTE, None)


def note(space: S, meaning: Meaning) -> S:
    """The space with a meaning noted on it; in all else it is as before."""
    setattr(space, NOTE, meaning)
    return space


def meaning_of(episodes: GaitEpisodes) -> Meaning:
    """Meaning of an action for one planning period to the robots of episodes."""
    return {
        "environment": episodes.name,
        "robot": asdict(episodes.robot),
        "limits": asdict(episodes.limits),
        "control_hz": float(episodes.control_hz),
        **episodes.action_settings(),
    }


def note_hold(space: S, periods: int) -> S:
    """A space like this one, whose actions are held for some planning periods; itself for one period."""
    if periods == 1:
        return space
    meaning = noted(space) or {}
    return note(copy.deepcopy(space), meaning | {HOLD: meaning.get(HOLD, 1) * periods})


def note_residual(space: S, below: gym.Space[Any] | None, residual: Meaning) -> S:
    """The space with the note that its actions are residuals on a policy."""
    meaning = dict(noted(below) or {})
    inner = {key: meaning.pop(key) for key in (HOLD, RESIDUAL) if key in meaning}
    if inner:  # a hold or a residual below a residual
        meaning["below"] = inner
    return note(space, meaning | {RESIDUAL: residual})


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


def check_options(options: object, names: Sequence[str]) -> dict[str, Any]:
    """Options of `reset` as a dict.

    Raises:
        InvalidValueError: no dict.
        UnknownNameError: another key than one of `names`.
    """
    if not isinstance(options, dict | None):
        raise InvalidValueError(f"reset options must be a dict, got {options!r}")
    if unknown := sorted(set(options or {}) - set(names), key=str):
        raise UnknownNameError("reset option", unknown[0], names)
    return options or {}


class EpisodesEnv:
    """Base of the environments of one robot and of n, which are numbered from 0."""

    def _set_up(
        self, episodes: GaitEpisodes, push_distribution: dict[str, Any] | PushDistribution | None
    ) -> tuple[Any, Any]:
        """Take the episodes and what is drawn for them; returns a robot's observation and action space.

        Raises:
            InvalidValueError: neither a PushDistribution nor a dict, or an impossible field.
        """
        if isinstance(push_distribution, dict):
            push_distribution = PushDistribution.from_dict(push_distribution)
        if not isinstance(push_distribution, PushDistribution | None):
            raise InvalidValueError(
                f"push_distribution must be a PushDistribution or its dict, got {push_distribution!r}"
            )
        default = PushDistribution().scaled(Similarity.of(episodes.robot))
        self.push_distribution = default if push_distribution is None else push_distribution
        self.episodes = episodes
        self.core: Any = episodes.core
        self.monitor, self.robot, self.limits = episodes.monitor, episodes.robot, episodes.limits
        self.preset, self.double_support = episodes.preset, episodes.double_support
        self.dt = 1.0 / episodes.control_hz  # planning period [s]
        self._info = InfoReader(episodes)
        self._begun = np.zeros(episodes.n, np.bool_)  # has been reset once
        self._ended = np.zeros(episodes.n, np.bool_)  # waits for its reset
        return spaces_of(episodes)

    def _scenario(self, given: object, rng: np.random.Generator | None) -> Scenario:
        """The scenario of reset options; where none is given, one that is drawn."""
        if given is None:
            assert rng is not None  # noqa: S101
            return self.episodes.drawn(self.push_distribution, rng)
        if not isinstance(given, Scenario):
            raise InvalidValueError(f"options['scenario'] must be a Scenario, got {type(given).__name__}")
        return given

    def _begin(self, k: int, scenario: Scenario) -> None:
        self.episodes.begin(k, scenario)
        self._note_begin(k, scenario)

    def _restore(self, k: int, snapshot: RobotSnapshot, scenario: Scenario | None) -> None:
        self.episodes.restore(k, snapshot, scenario)
        self._note_begin(k, snapshot.scenario if scenario is None else scenario)

    def _note_begin(self, k: int, scenario: Scenario) -> None:
        """Robot k is in an episode of a scenario from now on."""
        self._info.begin(k, scenario)
        self._begun[k], self._ended[k] = True, False

    def _no_terms(self) -> Array:
        """Reward terms (n, terms) of robots that have not moved."""
        return np.zeros((self.episodes.n, len(self.episodes.reward_terms)))

    def __copy__(self) -> Self:
        """A copy shares nothing with its original, or is refused (a biped's)."""
        return copy.deepcopy(self)


class GaitEnv(EpisodesEnv, gym.Env[Array, NDArray[np.float32]]):
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
        self.observation_space, self.action_space = self._set_up(episodes, push_distribution)
        self.metadata = {**self.metadata, "render_fps": round(episodes.control_hz)}  # type: ignore[misc]
        self.scenario: Scenario | None = None
        self._picture: Any = None  # what `render` draws with
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
        given = check_options(options, ["scenario"]).get("scenario")
        self._begin(0, self._scenario(given, self.np_random if given is None else None))
        if self.render_mode == "human":
            self.render()
        return self._look(self._no_terms())

    def step(self, action: ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One planning period under an action in [-1, 1]; entries outside are clipped."""
        if not self._begun[0] or self._ended[0]:
            raise InvalidValueError("the episode has ended or not begun: call reset() before step()")
        period = self.episodes.step(check_action(action, shape=(self.episodes.action_size,))[None])
        for look in self.after_period:
            look()
        terminated, truncated = period.failed.item(0), period.truncated.item(0)
        self._ended[0] = terminated or truncated
        observation, info = self._look(period.reward.terms)
        if self.render_mode == "human":
            self.render()
        return observation, period.reward.total.item(0), terminated, truncated, info

    def state_snapshot(self) -> RobotSnapshot:
        """The whole state of the robot in mid-episode, which `restore` puts back.

        Raises:
            InvalidValueError: the episode has ended or not begun, or robots of this kind are not put back.
        """
        if not self._begun[0] or self._ended[0]:
            raise InvalidValueError("the episode has ended or not begun: there is nothing to go on with")
        return self.episodes.state_snapshot(0)

    def restore(
        self, snapshot: RobotSnapshot, scenario: Scenario | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Put the robot back where one was; it goes on bit for bit as that did. Returned as by `reset`.

        The snapshot may be of this environment, another one or a vector of them; see `GaitEpisodes.restore`.
        """
        self._restore(0, snapshot, scenario)
        return self._look(self._no_terms())

    def _note_begin(self, k: int, scenario: Scenario) -> None:
        super()._note_begin(k, scenario)
        self.scenario = scenario

    def _look(self, terms: Array) -> tuple[Array, dict[str, Any]]:
        """Observation and info of now, with the reward terms (1, terms)."""
        return self.episodes.seen[0].copy(), self._info.of_robot(0, terms[0])

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """The robot with its push, footholds and DCM: an image (480, 640, 3), or a window."""
        if self.render_mode is None:
            return None
        if self._picture is None:
            self._picture = self._make_picture(self.render_mode == "human")
        image = self._draw()
        return image if self.render_mode == "rgb_array" else None

    def _make_picture(self, window: bool) -> Any:
        """What `_draw` draws with; imported only now, since drawing libraries are slow to load."""
        raise NotImplementedError

    def _draw(self) -> NDArray[np.uint8] | None:
        raise NotImplementedError

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._picture is not None:
            self._picture.close()
            self._picture = None
