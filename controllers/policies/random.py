"""Uniform actions, the floor that any policy must beat."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..model.gait_box import GAIT_SIZE
from ..model.observation import as_batch

Actions = NDArray[np.float32]


class RandomPolicy:
    """Uniform actions, drawn from a hash of the observation so that equal episodes get equal actions."""

    def __init__(self, name: str = "random"):
        self.name = name

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Actions, Any]:
        """Action (7,) or (n, 7), float32 in [-1, 1], and the state, unchanged."""
        batch, single = as_batch(observation)
        if not np.isfinite(batch).all():
            raise InvalidValueError("observation must be finite, got NaN or infinity")
        actions = np.empty((len(batch), GAIT_SIZE), dtype=np.float32)
        for obs, action in zip(batch, actions, strict=True):
            action[:] = np.random.default_rng(zlib.crc32(obs.tobytes())).uniform(-1.0, 1.0, GAIT_SIZE)
        return (actions[0] if single else actions), state
