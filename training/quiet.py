"""Spend no learned action on a walk that a gated residual can't change."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np

from ..controllers.errors import InvalidValueError
from ..envs.residual import ResidualAction

MAX_EPISODES = 1000  # in a row without one moment at which the gate opens


class SkipQuiet(gym.Wrapper):
    """Walks on by itself while the gate of the residual is shut; each step of it is one that matters.

    The reward of the periods in between is added to that of the step before them. An episode at its time
    limit counts as ended, since what follows a quiet end is never seen from here: the return is the reward
    until then, lost from the moment of a fall.

    Args:
        env: An environment with a gated residual among its wrappers.
        residual: That wrapper.
    """

    def __init__(self, env: gym.Env, residual: ResidualAction):
        super().__init__(env)
        self._residual = residual
        self._rest = np.zeros(residual.action_space.shape or (), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode at the first moment at which the gate is open; one without is left out."""
        for _ in range(MAX_EPISODES):
            observation, info = self.env.reset(seed=seed, options=options)
            ended = False
            while self._residual.opening == 0.0 and not ended:
                observation, _, terminated, truncated, info = self.env.step(self._rest)
                ended = terminated or truncated
            if not ended:
                return observation, info
            seed = None  # the next one is another
        raise InvalidValueError(
            f"the gate {self._residual.gate} m stayed shut in {MAX_EPISODES} episodes: no push opens it"
        )

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """One learned action, then on to the next moment at which the gate is open."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        total = float(reward)
        while self._residual.opening == 0.0 and not (terminated or truncated):
            observation, reward, terminated, truncated, info = self.env.step(self._rest)
            total += float(reward)
        return observation, total, terminated or truncated, False, info
