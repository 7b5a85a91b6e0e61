"""Hold an action for several planning periods."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
from gymnasium.utils import RecordConstructorArgs

from ..episode.held_action import check_hold


class ActionHold(gym.Wrapper, RecordConstructorArgs):
    """Repeats each action for `periods` steps of the wrapped environment, or to the end of the episode.

    The reward is the sum over the steps, term by term in info["reward_terms"] too; everything else is the
    last step's. Around `ResidualAction` it holds the residual while the planner replans in every period.

    Args:
        env: The environment.
        periods: Steps for which an action is held, >= 1; 2 is 50 Hz on an environment of 100 Hz.
    """

    def __init__(self, env: gym.Env, periods: int = 1):
        check_hold(periods)
        RecordConstructorArgs.__init__(self, periods=periods)
        gym.Wrapper.__init__(self, env)
        self.periods = periods

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the wrapped environment with one action until it is due for the next."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        terms = dict(info.get("reward_terms", {}))
        for _ in range(self.periods - 1):
            if terminated or truncated:
                break
            observation, more, terminated, truncated, info = self.env.step(action)
            reward = float(reward) + float(more)
            for name, value in info.get("reward_terms", {}).items():
                terms[name] = terms.get(name, 0.0) + value
        if terms:
            info["reward_terms"] = terms
        return observation, reward, terminated, truncated, info
