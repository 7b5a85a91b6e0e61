"""What only the value network sees: it is of no use but in training, where all is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.model.frame import side_sign
from ...controllers.model.observation import OBSERVATION_SIZE
from ...envs.episode.episodes import GaitEpisodes

Array = NDArray[np.float64]

IMPULSE = 100.0  # that counts as 1 [N s]
SENSING_ERROR = 0.05  # that counts as 1, in the units of the observation


def impulse_to_come(episodes: GaitEpisodes) -> Array:
    """What the pushes have still to deliver (n, 2), x and y of the canonical frame, over IMPULSE."""
    pushes, motion = episodes.core.pushes, episodes.motion()
    left = (pushes.force * pushes.duration[..., None] - pushes.delivered).sum(axis=1)[:, :2] / IMPULSE
    cos, sin = np.cos(motion.heading), np.sin(motion.heading)
    forward, to_the_left = cos * left[:, 0] + sin * left[:, 1], cos * left[:, 1] - sin * left[:, 0]
    return np.stack([forward, side_sign(motion.side) * to_the_left], axis=1)


def sensing_error(episodes: GaitEpisodes) -> Array:
    """What is true less what is observed (n, 36), over SENSING_ERROR; zero without sensors."""
    return (episodes.core.truth - episodes.core.observation) / SENSING_ERROR


BLOCKS: dict[str, tuple[int, Callable[[GaitEpisodes], Array]]] = {
    "push": (2, impulse_to_come),
    "sensing": (OBSERVATION_SIZE, sensing_error),
}


def check_critic(names: Sequence[str]) -> tuple[str, ...]:
    """Names of blocks in their order.

    Raises:
        UnknownNameError: there is no such block.
        InvalidValueError: one stands twice.
    """
    for name in names:
        if name not in BLOCKS:
            raise UnknownNameError("input of the value network", str(name), tuple(BLOCKS))
    if len(set(names)) < len(names):
        raise InvalidValueError(f"inputs of the value network stand there once each, got {list(names)}")
    return tuple(names)


def critic_size(names: Sequence[str]) -> int:
    """Length of the blocks together."""
    return sum(BLOCKS[name][0] for name in names)


def critic_rows(episodes: GaitEpisodes, names: Sequence[str]) -> list[Array]:
    """The blocks (n, ...) as they are now."""
    return [BLOCKS[name][1](episodes) for name in names]
