"""n robots under training as Stable-Baselines3's `VecEnv`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...envs.episode.episodes import GaitEpisodes
from .actor import Actor
from .reward import Reward
from .shared_vec_env import SharedVecEnv
from .starts import Starts

Mask = NDArray[np.bool_]
Rewards = NDArray[np.float32]


class TrainingRobots(SharedVecEnv):
    """One step is one learned action, held for some planning periods; an ended episode begins anew at once.

    The info of an ended episode has `failure_reason`, `recovered_at` [s] since the walk began, None where it
    has not, `terminal_observation` and `TimeLimit.truncated`, which every info has.

    Args:
        episodes: of n robots; what they held before is lost.
        actor: what the network sees and does.
        starts: where episodes begin.
        reward: what an action is worth.
        hold: planning periods for which it is held.
    """

    def __init__(self, episodes: GaitEpisodes, actor: Actor, starts: Starts, reward: Reward, hold: int):
        self.episodes, self.hold = episodes, hold
        self._actor, self._starts, self._reward = actor, starts, reward
        self._everyone = np.arange(episodes.n)
        self.render_mode = None  # which Stable-Baselines3 asks for
        self._outputs = np.zeros((episodes.n, episodes.action_size), np.float32)
        inputs = gym.spaces.Box(-np.inf, np.inf, (actor.size,), np.float32)
        super().__init__(episodes.n, inputs, gym.spaces.Box(-1.0, 1.0, (episodes.action_size,), np.float32))

    def reset(self) -> NDArray[np.float32]:
        """Begin all episodes."""
        self._begin(self._everyone)
        return self._actor.inputs()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take outputs (n, k) of the network, which are clipped to [-1, 1]."""
        self._outputs = np.clip(actions, -1.0, 1.0).astype(np.float32)

    def step_wait(self) -> tuple[NDArray[np.float32], Rewards, Mask, list[dict[str, Any]]]:
        """Inputs, rewards, ends and infos; the inputs of an ended episode are those of the next one."""
        live, failed = np.ones(self.num_envs, np.bool_), np.zeros(self.num_envs, np.bool_)
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        for _ in range(self.hold):
            period = self.episodes.step(self._actor.actions(self._outputs))
            self._actor.look(np.flatnonzero(live))
            over = self._reward.period(period, live, self._actor.quiet)
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

    def close(self) -> None:
        """Nothing is held open."""

    @property
    def shared(self) -> TrainingRobots:
        """These robots."""
        return self
