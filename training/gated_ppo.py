"""PPO for a gated residual: no learned action is spent on a walk that it can't change."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from ..controllers.policies.residual_gate import ResidualGate
from .gated_rollout import Array, Streams

Mask = NDArray[np.bool_]


class GateNormalize(VecNormalize):
    """`VecNormalize` with statistics of the moments at which the gate is open; `GatedPPO` steps through it.

    Args:
        venv: the robots.
        gate: of their residual.
        kwargs: of `VecNormalize`.
    """

    def __init__(self, venv: VecEnv, gate: ResidualGate, **kwargs: Any):
        super().__init__(venv, **kwargs)
        self.gate = gate

    @property
    def robots(self) -> VecEnv:
        """The robots, whose observations and rewards are not normalised."""
        assert self.venv is not None  # noqa: S101
        return self.venv

    def reset(self) -> NDArray[np.float64]:
        """Begin all episodes; their observations as they are."""
        self.returns = np.zeros(self.num_envs)
        observations = self.robots.reset()
        assert isinstance(observations, np.ndarray)  # noqa: S101
        self.old_obs = observations
        return observations

    def is_open(self, observations: NDArray[np.float64]) -> Mask:
        """Where the gate is open (n,) at observations (n, 36)."""
        return self.gate(observations)[:, 0] > 0.0

    def arrive(self, observations: NDArray[np.float64]) -> Array:
        """Normalised observations (m, 36) of robots that are to act, which the statistics gain."""
        statistics: Any = self.obs_rms
        statistics.update(observations)
        normalised = self.normalize_obs(observations)
        assert isinstance(normalised, np.ndarray)  # noqa: S101
        return normalised

    def earn(self, rows: list[int], rewards: NDArray[np.float64], ended: Mask) -> NDArray[np.float32]:
        """Normalised rewards (m,) of choices of the robots `rows`, which the statistics gain."""
        self.returns[rows] = self.returns[rows] * self.gamma + rewards
        self.ret_rms.update(self.returns[rows])
        self.returns[np.array(rows)[ended]] = 0.0
        return self.normalize_reward(rewards)


class GatedPPO(PPO):
    """PPO in which a robot acts only while its gate is open, and walks on by itself while it is shut.

    All robots move at once, whether they act or not, and a rollout is as many learned actions as PPO asks
    for, of any robots. The reward of a walk is added to that of the action before it. An episode at its time
    limit counts as ended, since what follows a quiet end is never seen from here: the return is the reward
    until then, lost from the moment of a fall. An action whose reward is not yet known when a rollout ends is
    part of the next.
    """

    _streams: Streams

    def _setup_learn(self, *args: Any, **kwargs: Any) -> Any:
        before = self._last_obs
        result = super()._setup_learn(*args, **kwargs)
        if self._last_obs is not before:
            self._streams = Streams(self.n_envs)
            self._arrive(self._last_obs)
        return result

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_streams"]

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Move the robots until n_rollout_steps x n_envs learned actions have earned their reward."""
        assert isinstance(env, GateNormalize)  # noqa: S101
        self.policy.set_training_mode(False)
        wanted, before = n_rollout_steps * env.num_envs, self.num_timesteps
        callback.on_rollout_start()
        while self._streams.count < wanted:
            observations, rewards, dones, infos = env.robots.step(self._choose())
            dones = self._account(observations, rewards, dones)
            self.num_timesteps = before + min(self._streams.count, wanted)
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            self._update_info_buffer(infos, dones)
        self._fill(rollout_buffer, wanted)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    @property
    def _robots(self) -> GateNormalize:
        assert isinstance(self.env, GateNormalize)  # noqa: S101
        return self.env

    def _arrive(self, observations: Any) -> None:
        """Robots that are not in the middle of an action and find the gate open are to act next."""
        free = np.array([choice is None for choice in self._streams.pending])
        rows = np.flatnonzero(free & self._robots.is_open(observations)).tolist()
        if rows:
            self._streams.observe(rows, self._robots.arrive(observations[rows]))

    def _choose(self) -> Array:
        """Actions (n, 7) within the box; zero for robots that are not to act."""
        space: Any = self.action_space
        actions, rows = np.zeros((self.n_envs, *space.shape), np.float32), self._streams.due
        if rows:
            with torch.no_grad():
                chosen = self.policy(torch.as_tensor(self._streams.observations(rows)))
            action, value, log_prob = (part.numpy() for part in chosen)
            self._streams.choose(rows, action, value[:, 0], log_prob)
            actions[rows] = np.clip(action, space.low, space.high)
        return actions

    def _account(self, observations: Any, rewards: Any, dones: Any) -> Mask:
        """Give the rewards to whom they belong; returns the ended episodes (n,) that had a learned action."""
        streams, robots = self._streams, self._robots
        complete, acted = streams.step(rewards, dones, robots.is_open(observations))
        if complete:
            choices = [streams.made[k][-1] for k in complete]
            sums = np.array([choice.reward for choice in choices])
            for choice, reward in zip(choices, robots.earn(complete, sums, dones[complete]), strict=True):
                choice.reward = float(reward)
        self._arrive(observations)
        self._last_obs = observations
        return acted

    def _fill(self, rollout_buffer: RolloutBuffer, wanted: int) -> None:
        """Put the choices into the buffer, robot by robot; PPO takes them from it in random order."""
        streams, values, rows = self._streams, np.zeros(0), self._streams.due
        if rows:
            with torch.no_grad():
                values = self.policy.predict_values(torch.as_tensor(streams.observations(rows))).numpy()[:, 0]
        choices, advantages = streams.take(wanted, values.tolist(), self.gamma, self.gae_lambda)
        rollout_buffer.reset()
        columns = self.n_envs, self.n_steps

        def put(into: Any, each: Any) -> None:
            into[:] = np.array(each, np.float32).reshape(*columns, *into.shape[2:]).swapaxes(0, 1)

        put(rollout_buffer.observations, [choice.observation for choice in choices])
        put(rollout_buffer.actions, [choice.action for choice in choices])
        put(rollout_buffer.rewards, [choice.reward for choice in choices])
        put(rollout_buffer.values, [choice.value for choice in choices])
        put(rollout_buffer.log_probs, [choice.log_prob for choice in choices])
        put(rollout_buffer.episode_starts, [choice.first for choice in choices])
        put(rollout_buffer.advantages, advantages)
        rollout_buffer.returns = rollout_buffer.advantages + rollout_buffer.values
        rollout_buffer.pos, rollout_buffer.full = self.n_steps, True
