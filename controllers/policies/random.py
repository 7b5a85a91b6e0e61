"""Uniform actions, the floor that any policy must beat."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..model.gait_box import GAIT_SIZE
from ..model.observation import OBSERVATION_SIZE, as_batch

Actions = NDArray[np.float32]


class RandomPolicy:
    """Uniform actions, drawn from a hash of the observation so that equal episodes get equal actions."""

    def __init__(
        self, name: str = "random", observation_size: int = OBSERVATION_SIZE, action_size: int = GAIT_SIZE
    ):
        self.name, self.observation_size, self.action_size = name, observation_size, action_size

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Actions, Any]:
        """Actions (action_size,) or (n, action_size), float32 in [-1, 1], and the state, unchanged."""
        batch, single = as_batch(observation, self.observation_size)
        if not np.isfinite(batch).all():
            raise InvalidValueError("observation must be finite, got NaN or infinity")
        actions = np.empty((len(batch), self.action_size), dtype=np.float32)
        for obs, action in zip(batch, actions, strict=True):
            rng = np.random.default_rng(zlib.crc32(obs.tobytes()))
            action[:] = rng.uniform(-1.0, 1.0, self.action_size)
        return (actions[0] if single else actions), state
