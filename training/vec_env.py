"""n robots as Stable-Baselines3's `VecEnv`: of a vector environment of Gymnasium, or under training."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.env_util import is_wrapped
from stable_baselines3.common.vec_env import VecEnv

from ..controllers.errors import InvalidValueError
from ..envs.episode.episodes import GaitEpisodes
from .actor import Actor
from .reward import Reward
from .starts import Starts

Step = tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]


class SharedVecEnv(VecEnv):
    """A `VecEnv` whose attributes and methods are those of one object that all robots share."""

    def __init__(self, shared: Any, n: int, observation: gym.Space, action: gym.Space):
        self.shared = shared
        self._actions: NDArray[Any] = np.zeros(0)
        super().__init__(n, observation, action)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take actions (n, k) for `step_wait`."""
        self._actions = actions

    def close(self) -> None:
        """Nothing is held open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of what is shared, once for each of the robots asked for."""
        return [getattr(self.shared, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of what all robots share.

        Raises:
            InvalidValueError: for some of the robots only.
        """
        self._require_all(indices)
        setattr(self.shared, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of what is shared, once; its result stands for every robot.

        Raises:
            InvalidValueError: for some of the robots only.
        """
        self._require_all(indices)
        return [getattr(self.shared, method_name)(*method_args, **method_kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Any = None) -> list[bool]:
        """False: no robot has wrappers of its own."""
        return [False] * len(list(self._get_indices(indices)))

    def _require_all(self, indices: Any) -> None:
        asked = sorted(self._get_indices(indices))
        if asked != list(range(self.num_envs)):
            raise InvalidValueError(f"the {self.num_envs} robots share one environment, got indices {asked}")


class SB3VecEnv(SharedVecEnv):
    """n robots of one vector environment for Stable-Baselines3; no environment per robot.

    A robot whose episode has ended is reset at once, by a masked reset. Its info of that step is the whole
    one, with `terminal_observation`; that of the others holds `TimeLimit.truncated` only, which every info
    has. `reset_infos` holds the latest reset's info of each robot.

    Args:
        env: a vector environment that knows the reset option `reset_mask`, as those of Gymnasium do, in
            any autoreset mode but "SameStep".

    Raises:
        InvalidValueError: the environment resets within the step.
    """

    def __init__(self, env: VectorEnv):
        if env.metadata.get("autoreset_mode") is AutoresetMode.SAME_STEP:
            raise InvalidValueError(
                "SB3VecEnv resets by itself, got autoreset mode 'SameStep'; choose from: NextStep, Disabled"
            )
        self.env = env
        super().__init__(env, env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> NDArray[Any]:
        """Reset all robots with the seeds of `seed` and the scenarios of `set_options`, each used once."""
        seeds: Any = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        unknown = sorted({key for each in self._options for key in each} - {"scenario"})
        if unknown:
            raise InvalidValueError(f"reset options of SB3VecEnv are: scenario; got {unknown[0]!r}")
        scenarios = [each.get("scenario") for each in self._options]
        options = {"scenario": scenarios} if any(self._options) else None
        observations, infos = self.env.reset(seed=seeds, options=options)
        self.reset_infos = [row_of(infos, k) for k in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_wait(self) -> Step:
        """Observations, rewards, ends and infos of one step; an ended robot's observation is the new one."""
        observations, rewards, terminated, truncated, vector_info = self.env.step(self._actions)
        ended = terminated | truncated
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        if ended.any():
            for k in np.flatnonzero(ended).tolist():
                infos[k] = row_of(vector_info, k)
                infos[k]["TimeLimit.truncated"] = bool(truncated[k] and not terminated[k])
                infos[k]["terminal_observation"] = observations[k].copy()
            fresh, reset_info = self.env.reset(options={"reset_mask": ended})
            observations[ended] = fresh[ended]
            for k in np.flatnonzero(ended).tolist():
                self.reset_infos[k] = row_of(reset_info, k)
        return observations, rewards.astype(np.float32), ended, infos

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Any = None) -> list[bool]:
        """Whether the vector environment, or that of each robot where there is one, has such a wrapper."""
        env: Any = self.env
        found = False
        while isinstance(env, gym.vector.VectorWrapper):
            found, env = found or isinstance(env, wrapper_class), env.env
        each = getattr(env, "envs", [env] * self.num_envs)
        return [found or is_wrapped(each[k], wrapper_class) for k in self._get_indices(indices)]

    def close(self) -> None:
        """Close the vector environment."""
        self.env.close()


def row_of(info: dict[str, Any], k: int) -> dict[str, Any]:
    """The info of robot k out of a vector environment's: the keys whose mask is True."""
    row: dict[str, Any] = {}
    for key, values in info.items():
        if f"_{key}" not in info or not info[f"_{key}"][k]:
            continue
        if isinstance(values, dict):
            row[key] = row_of(values, k)
        else:
            value = values[k]
            row[key] = value.item() if isinstance(value, np.generic) else value
    return row


class TrainingRobots(SharedVecEnv):
    """One step is one learned action, held for some planning periods; an ended episode begins anew at once.

    What the episodes held before is lost. The info of an ended one has `failure_reason`, `recovered_at` [s]
    since the walk began, None where it has not, `terminal_observation` and `TimeLimit.truncated`, which every
    info has.
    """

    def __init__(self, episodes: GaitEpisodes, actor: Actor, starts: Starts, reward: Reward, hold: int):
        self.episodes, self.hold = episodes, hold
        self._actor, self._starts, self._reward = actor, starts, reward
        self.render_mode = None  # which Stable-Baselines3 asks for
        inputs = gym.spaces.Box(-np.inf, np.inf, (actor.size,), np.float32)
        outputs = gym.spaces.Box(-1.0, 1.0, (episodes.action_size,), np.float32)
        super().__init__(self, episodes.n, inputs, outputs)

    def reset(self) -> NDArray[np.float32]:
        """Begin all episodes."""
        self._begin(np.arange(self.num_envs))
        return self._actor.inputs()

    def step_wait(self) -> Step:
        """Inputs, rewards, ends and infos; the inputs of an ended episode are those of the next one.

        The outputs of the network are clipped to [-1, 1].
        """
        outputs = np.clip(self._actions, -1.0, 1.0).astype(np.float32)
        live, failed = np.ones(self.num_envs, np.bool_), np.zeros(self.num_envs, np.bool_)
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        for _ in range(self.hold):
            period = self.episodes.step(self._actor.actions(outputs))
            self._actor.look(np.flatnonzero(live))
            over = self._reward.period(period, live, self._actor.gate_closed)
            failed |= over & period.failed
            for k in np.flatnonzero(over).tolist():
                infos[k] = self._end(k, bool(failed[k]))
            live &= ~over
            if not live.any():
                break
        rewards = self._reward.collect(~live).astype(np.float32)
        ended = np.flatnonzero(~live)
        if len(ended):
            last = self._actor.inputs()
            for k in ended.tolist():
                infos[k]["terminal_observation"] = last[k].copy()
            self._begin(ended)
        return self._actor.inputs(), rewards, ~live, infos

    def _begin(self, rows: NDArray[np.int64]) -> None:
        for k in rows.tolist():
            self._starts.begin(k)
        self._actor.look(rows)
        self._reward.begin(rows)

    def _end(self, k: int, failed: bool) -> dict[str, Any]:
        """Info of robot k, whose episode has ended in this period."""
        recovered_at = self.episodes.monitor.recovered_at(k)
        self._starts.ended(k, not failed and recovered_at is not None)
        return {
            "failure_reason": self.episodes.failures[self.episodes.failure()[k]] if failed else None,
            "recovered_at": recovered_at,
            "TimeLimit.truncated": self._reward.bootstraps and not failed,
        }
