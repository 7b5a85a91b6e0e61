"""A vector environment of Gymnasium as Stable-Baselines3's `VecEnv`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from ..controllers.errors import InvalidValueError
from .robots.shared_vec_env import SharedVecEnv


class SB3VecEnv(SharedVecEnv):
    """n robots of one vector environment for Stable-Baselines3; no environment per robot.

    A robot whose episode has ended is reset at once, by a masked reset. Its info of that step is the whole
    one, with `terminal_observation`; that of the others holds `TimeLimit.truncated` only, which every info
    has. `reset_infos` holds the latest reset's info of each robot.

    Args:
        env: a vector environment that knows the reset option `reset_mask`, such as one of `gym.make_vec`, in
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
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._actions: NDArray[Any] | None = None

    def reset(self) -> NDArray[Any]:
        """Reset all robots with the seeds of `seed` and the scenarios of `set_options`, each used once."""
        seeds: Any = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        observations, infos = self.env.reset(seed=seeds, options=_joined(self._options))
        self.reset_infos = [row_of(infos, k) for k in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take actions (n, 7) for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
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

    def close(self) -> None:
        """Close the vector environment."""
        self.env.close()

    @property
    def shared(self) -> VectorEnv:
        """The vector environment."""
        return self.env


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


def _joined(options: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Reset options of all robots out of one dict for each, of which only `scenario` is known."""
    unknown = sorted({key for each in options for key in each} - {"scenario"})
    if unknown:
        raise InvalidValueError(f"reset options of SB3VecEnv are: scenario; got {unknown[0]!r}")
    if not any(options):
        return None
    return {"scenario": [each.get("scenario") for each in options]}
