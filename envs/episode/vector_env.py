"""n robots as one vector environment over one core, without an environment per robot."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.validation import require_integer
from ..scenario.distribution import PushDistribution
from ..scenario.scenario import Scenario
from ..snapshot import RobotSnapshot
from .episodes import GaitEpisodes, Held, hold_action
from .gym_env import EpisodesEnv, check_action, check_options, note_hold
from .info import Info, overwrite

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Actions = NDArray[np.float32]


def _each(name: str, given: Any, count: int) -> list[Any]:
    """A value for each of `count` robots, from one for all or a sequence."""
    if not isinstance(given, Sequence):
        return [given] * count
    if len(given) != count:
        raise InvalidValueError(f"{name} must be one or {count}, one for each robot, got {len(given)}")
    return list(given)


class Ended(NamedTuple):
    """Robots whose episode ended within a held action, as they were then."""

    rows: Mask  # (n,)
    observation: Array  # (n, observation_size)
    info: Info


class GaitVectorEnv(EpisodesEnv, VectorEnv[Array, Actions, NDArray[Any]]):
    """n robots under gait actions (n, 7); robot k does what it would do alone, bit for bit.

    Robots whose episode has ended start a new one by `autoreset_mode`: "NextStep", the default, at the next
    step, which ignores their action and gives reward 0; "SameStep" at once, and info has `final_obs` and
    `final_info`; "Disabled" by `reset` with a `reset_mask` only.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # type: ignore[misc]

    def __init__(
        self,
        episodes: GaitEpisodes,
        push_distribution: dict[str, Any] | PushDistribution | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        hold: int = 1,
        max_episode_steps: int | None = None,
    ):
        """Put Gymnasium's face on episodes.

        Args:
            episodes: of n robots.
            push_distribution: of the scenarios that are drawn.
            autoreset_mode: see the class.
            render_mode: None; one robot is drawn by its single environment.
            hold: planning periods for which an action is held; rewards are summed.
            max_episode_steps: after which an episode is truncated, as by Gymnasium's `TimeLimit`; None or
                -1: by its scenario alone.

        Raises:
            PushRecoveryError: an impossible push distribution, hold, limit or autoreset mode, or a render
                mode.
        """
        if render_mode is not None:
            raise InvalidValueError(
                f"a vector environment draws nothing, got render_mode {render_mode!r}; use None, or gym.make"
            )
        modes = [known.value for known in AutoresetMode]
        if not isinstance(autoreset_mode, AutoresetMode) and autoreset_mode not in modes:
            raise UnknownNameError("autoreset mode", str(autoreset_mode), modes)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.hold = require_integer("hold", hold, 1)
        endless = max_episode_steps is None or max_episode_steps == -1
        self._longest = np.inf if endless else require_integer("max_episode_steps", max_episode_steps, 1)
        self._steps = np.zeros(episodes.n, np.int64)  # of the episode
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}  # type: ignore[misc]
        self.num_envs = episodes.n
        seen, action = self._set_up(episodes, push_distribution)
        alone = self.single_observation_space, self.single_action_space = seen, note_hold(action, self.hold)
        self.observation_space, self.action_space = (batch_space(space, self.num_envs) for space in alone)
        self._rngs: list[np.random.Generator | None] = [None] * self.num_envs
        self._seeds: list[int] = [-1] * self.num_envs

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, Info]:
        """Start episodes at the beginning of a nominal step.

        Args:
            seed: of the push distribution: n seeds, or one, of which robot k takes seed + k; None goes on.
            options: "scenario": one Scenario for all or n of them (None: drawn); "reset_mask": (n,) bool, the
                robots to reset, all without it. The others stay as they are.
        """
        rows, scenarios = self._options(options)
        seeds = self._check_seeds(seed)
        for k in np.flatnonzero(rows).tolist():
            if seeds[k] is not None or self._rngs[k] is None:
                self._rngs[k], self._seeds[k] = seeding.np_random(seeds[k])
            self._begin_anew(k, scenarios[k])
        return self._look(rows, self._no_terms())

    def step(self, actions: ArrayLike) -> tuple[Array, Array, Mask, Mask, Info]:
        """One planning period (`hold` of them) under actions (n, action_size) in [-1, 1], clipped."""
        due = self._check_ready()
        checked = check_action(actions, "actions", (self.num_envs, self.episodes.action_size))
        ends: list[Ended] = []

        def at_end(over: Mask, left: int, held: Held) -> None:
            if left:
                ends.append(Ended(over, *self._look(over, held.terms.copy())))

        reward, terms, terminated, truncated = hold_action(
            self.episodes, ~due, self.hold, lambda live: self._gait_actions(checked, live), at_end
        )
        self._steps += 1
        truncated |= ~due & (self._steps >= self._longest)
        for k in np.flatnonzero(due).tolist():
            self._begin_anew(k)
        everyone = np.ones(self.num_envs, np.bool_)
        observation, info = self._look(everyone, terms, ends)
        self._ended = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            observation, info = self._reset_at_once(observation, terms, ends)
        return observation, reward, terminated, truncated, info

    def state_snapshot(self, robot: int) -> RobotSnapshot:
        """The whole state of a robot in mid-episode, which `restore` puts back in any place.

        Raises:
            InvalidValueError: there is no such robot, its episode has not begun or has ended, or robots of
                its kind are not put back.
        """
        k = require_integer("robot", robot, 0, self.num_envs - 1)
        if self._ended[k]:
            raise InvalidValueError(f"the episode of robot {k} has ended: there is nothing to go on with")
        return self.episodes.state_snapshot(k)

    def restore(
        self,
        snapshot: RobotSnapshot | Sequence[RobotSnapshot],
        robots: Sequence[int] | None = None,
        scenario: Scenario | Sequence[Scenario | None] | None = None,
    ) -> tuple[Array, Info]:
        """Put robots back where others were; they go on bit for bit as those did. Returned as by `reset`.

        Args:
            snapshot: one for all, or one for each of the robots.
            robots: which of them, all by default. The others stay as they are.
            scenario: what goes on from there, one for all or one for each; None: the snapshot's own. It may
                have other pushes that have not begun, and another end.

        Raises:
            InvalidValueError: no such robot, another number of snapshots or scenarios than of robots, or what
                `GaitEpisodes.restore` refuses.
        """
        rows = range(self.num_envs) if robots is None else robots
        asked = [require_integer("robot", k, 0, self.num_envs - 1) for k in rows]
        given, wanted = _each("snapshot", snapshot, len(asked)), _each("scenario", scenario, len(asked))
        changed = np.zeros(self.num_envs, np.bool_)
        for k, one, way in zip(asked, given, wanted, strict=True):
            self._restore(k, one, way)
            changed[k] = True
        return self._look(changed, self._no_terms())

    @property
    def np_random(self) -> tuple[np.random.Generator | None, ...]:  # type: ignore[override]
        """The robots' generators; None before the first reset."""
        return tuple(self._rngs)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Their seeds, -1 before the first reset."""
        return tuple(self._seeds)

    # Hooks of a residual

    def _gait_actions(self, actions: Actions, live: Mask) -> Actions:
        """Actions of the episodes for the actions of the robots that go on."""
        return actions

    def _more_info(self, info: Info, rows: Mask) -> None:
        """Add keys to an info of the robots `rows`."""

    # Parts of reset and step

    def _begin_anew(self, k: int, given: object = None) -> None:
        self._begin(k, self._scenario(given, self._rngs[k]))

    def _note_begin(self, k: int, scenario: Scenario) -> None:
        super()._note_begin(k, scenario)
        self._steps[k] = 0

    def _reset_at_once(self, last: Array, terms: Array, ends: Sequence[Ended]) -> tuple[Array, Info]:
        """Reset at once those that have ended; `last` are the observations before."""
        ended = self._ended.copy()
        _, final_info = self._look(ended, terms, ends)
        for k in np.flatnonzero(ended).tolist():
            self._begin_anew(k)
        observation, info = self._look(np.ones(self.num_envs, np.bool_), np.where(ended[:, None], 0.0, terms))
        final_obs = np.full(self.num_envs, None, dtype=object)
        for k in np.flatnonzero(ended).tolist():
            final_obs[k] = last[k]
        info |= {"final_obs": final_obs, "_final_obs": ended.copy(), "final_info": final_info}
        info["_final_info"] = ended.copy()
        return observation, info

    def _look(self, rows: Mask, terms: Array, ends: Sequence[Ended] = ()) -> tuple[Array, Info]:
        """Observations (n, 36), and info of the robots `rows` (n,); those of `ends` as they were then."""
        observation, info = self.episodes.seen.copy(), self._info.of_robots(rows, terms)
        self._more_info(info, rows)
        for then in ends:
            observation[then.rows] = then.observation[then.rows]
            overwrite(info, then.info, then.rows)
        return observation, info

    def _check_ready(self) -> Mask:
        """The robots (n,) that this step resets."""
        if not self._begun.all():
            never = int(self._begun.argmin())
            raise InvalidValueError(f"robot {never} has not begun: call reset() before step()")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            raise InvalidValueError(
                f"the episodes of robots {np.flatnonzero(self._ended).tolist()} have ended: "
                "call reset(options={'reset_mask': ...}) before step()"
            )
        return self._ended.copy()

    def _check_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str):
            given = list(seed)
        else:
            first = require_integer("seed", seed)
            given = [first + k for k in range(self.num_envs)]
        if len(given) != self.num_envs:
            raise InvalidValueError(f"seed must be one number or {self.num_envs}, got {len(given)}")
        return [None if value is None else require_integer("seed", value) for value in given]

    def _options(self, options: dict[str, Any] | None) -> tuple[Mask, list[Scenario | None]]:
        """The robots to reset (n,) and their scenarios, None where one is to be drawn."""
        options = check_options(options, ["scenario", "reset_mask"])
        n = self.num_envs
        try:
            rows = np.asarray(options.get("reset_mask", np.ones(n, np.bool_)))
        except (TypeError, ValueError):  # ragged
            rows = np.empty(0, np.bool_)
        if rows.dtype != np.bool_ or rows.shape != (n,) or not rows.any():
            raise InvalidValueError(
                f"options['reset_mask'] must be {n} booleans, one of them True, got {options['reset_mask']!r}"
            )
        given = options.get("scenario")
        listed = list(given) if isinstance(given, list | tuple | np.ndarray) else [given] * n
        if len(listed) != n:
            raise InvalidValueError(f"options['scenario'] must be one Scenario or {n}, got {len(listed)}")
        return rows, [None if one is None else self._scenario(one, None) for one in listed]


def vector_maker(
    single: Callable[..., gym.Env],
    episodes_of: Callable[..., GaitEpisodes],
    env_of: type[GaitVectorEnv] | None = None,
) -> Callable[..., GaitVectorEnv]:
    """The vector entry point of an environment of one robot: `num_envs` of them on one core.

    It takes arguments of `GaitVectorEnv` and then those of the single environment; what is not of the class
    `env_of`, `GaitVectorEnv` by default, goes to the episodes.
    """
    made = env_of or GaitVectorEnv

    def make(
        num_envs: int = 1,
        autoreset_mode: str = "NextStep",
        render_mode: str | None = None,
        push_distribution: dict[str, Any] | PushDistribution | None = None,
        max_episode_steps: int | None = None,
        **more: Any,
    ) -> GaitVectorEnv:
        own = {name: more.pop(name) for name in of_env & more.keys()}
        return made(
            episodes_of(num_envs, **more), push_distribution=push_distribution, autoreset_mode=autoreset_mode,
            render_mode=render_mode, max_episode_steps=max_episode_steps, **own,
        )  # fmt: skip

    def arguments(of: Callable[..., Any]) -> dict[str, inspect.Parameter]:
        return dict(inspect.signature(of).parameters)

    first, alone = list(arguments(make).values())[:-1], arguments(single)
    of_env = alone.keys() & (arguments(GaitVectorEnv) | arguments(made)).keys()
    config = getattr(episodes_of, "config_of", None)
    fields = {} if config is None else arguments(config)
    known = {"config", *(entry.name for entry in first)}  # a config comes by its fields
    rest = [
        entry
        for entry in (arguments(episodes_of) | fields | alone).values()
        if entry.default is not entry.empty and entry.name not in known
    ]
    make.__signature__ = inspect.Signature([*first, *rest])  # type: ignore[attr-defined]
    return make
