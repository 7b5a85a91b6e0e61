"""Inputs of the networks of a training for n robots, and what their outputs do to these robots."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..controllers.errors import InvalidValueError
from ..controllers.model.observation import OBSERVATION_SIZE, side_sign
from ..controllers.policies.mlp import NetworkInputs, input_size
from ..controllers.policies.residual import Below, ResidualRule
from ..controllers.validation import require_choice
from ..envs.episode.episodes import GaitEpisodes
from ..envs.scenario.arrays import NUMBERS
from ..envs.scenario.push import FRAMES

Array = NDArray[np.float64]
Actions = NDArray[np.float32]

IMPULSE = 100.0  # that counts as 1 [N s]
LEVER = 0.1  # of IMPULSE, whose moment counts as 1 [m]
DELIVERED = 1e-6  # of IMPULSE, as little as rounding leaves of a push that is over
WAITED = 1 << 20  # steps, more than an episode has
SENSING_ERROR = 0.05  # that counts as 1, in the units of the observation


def _impulses(episodes: GaitEpisodes) -> Array:
    """Impulse that each push has still to deliver (n, P, 2), x and y of the canonical frame, over IMPULSE."""
    pushes, motion = episodes.core.pushes, episodes.motion()
    left = (pushes.force * pushes.duration[..., None] - pushes.delivered)[..., :2] / IMPULSE
    turned = np.where(pushes.frame == FRAMES.index("heading"), 0.0, motion.heading[:, None])  # (n, P)
    cos, sin = np.cos(turned), np.sin(turned)
    forward, to_the_left = cos * left[..., 0] + sin * left[..., 1], cos * left[..., 1] - sin * left[..., 0]
    return np.stack([forward, side_sign(motion.side)[:, None] * to_the_left], axis=2)


def impulse_to_come(episodes: GaitEpisodes) -> Array:
    """Impulse that the pushes have still to deliver (n, 2), x and y of the canonical frame, over IMPULSE."""
    return _impulses(episodes).sum(axis=1)


def place_to_come(episodes: GaitEpisodes) -> Array:
    """Where what is still to come acts, and for how long (n, 6), in the canonical frame.

    The part that acts on other bodies than the pelvis (x, y), over IMPULSE; the angular impulse
    r x p  about the CoM of the body that is pushed (x, y, z), over LEVER IMPULSE, where r is the point of
    attack in the body's axes, taken as those of the heading; the longest of its pushes [s].
    """
    pushes, impulses = episodes.core.pushes, _impulses(episodes)
    x, y = impulses[..., 0], impulses[..., 1]
    forward, inward, up = np.moveaxis(pushes.offset, 2, 0)
    inward = side_sign(episodes.motion().side)[:, None] * inward
    elsewhere = pushes.body != NUMBERS["pelvis"]
    moments = -up * y, up * x, forward * y - inward * x
    duration = np.where(np.hypot(x, y) > DELIVERED, pushes.duration, 0.0).max(axis=1)
    parts = [elsewhere * x, elsewhere * y, *(moment / LEVER for moment in moments)]
    return np.stack([*(part.sum(axis=1) for part in parts), duration], axis=1)


def pushes_to_come(episodes: GaitEpisodes) -> Array:
    """Of the pushes that wait for their step (n, 3): how many, steps to the next and to the last, over 4."""
    pushes, steps = episodes.core.pushes, episodes.motion().steps
    waiting = (pushes.step >= 0) & np.isinf(pushes.start)  # (n, P)
    pause = np.where(waiting, pushes.step - steps[:, None], 0)
    following = np.where(waiting, pause, WAITED).min(axis=1) % WAITED
    return np.stack([waiting.sum(axis=1), following, pause.max(axis=1)], axis=1) / 4.0


def sensing_error(episodes: GaitEpisodes) -> Array:
    """The true observation less the observed one (n, 36), over SENSING_ERROR; zero without sensors."""
    return (episodes.core.truth - episodes.core.observation) / SENSING_ERROR


class Block(NamedTuple):
    """A block of inputs that only the value network sees, since it is known in training alone."""

    size: int
    values: Callable[[GaitEpisodes], Array]  # (n, size)


CRITIC = {
    "push": Block(2, impulse_to_come),
    "place": Block(6, place_to_come),
    "schedule": Block(3, pushes_to_come),
    "sensing": Block(OBSERVATION_SIZE, sensing_error),
}


def check_critic(names: Sequence[str]) -> tuple[str, ...]:
    """Names of blocks in their order.

    Raises:
        UnknownNameError: there is no such block.
        InvalidValueError: one stands twice.
    """
    for name in names:
        require_choice("input of the value network", name, tuple(CRITIC))
    if len(set(names)) < len(names):
        raise InvalidValueError(f"inputs of the value network stand there once each, got {list(names)}")
    return tuple(names)


def critic_size(names: Sequence[str]) -> int:
    """Length of the blocks together."""
    return sum(CRITIC[name].size for name in names)


class Actor:
    """A network that acts alone, or as a residual, on the robots of `episodes`."""

    def __init__(
        self,
        episodes: GaitEpisodes,
        inputs: Sequence[str],
        rule: ResidualRule | None = None,
        critic: Sequence[str] = (),
    ):
        self._episodes, self._rule, self._critic = episodes, rule, critic
        self._inputs = NetworkInputs(inputs, episodes.robot, episodes.limits)
        self.size = input_size(inputs, episodes.observation_size) + critic_size(critic)
        self._below = Below(*(np.zeros((episodes.n, size), np.float32) for size in (7, 1)))

    def look(self, rows: NDArray[np.int64]) -> None:
        """Take in where the robots `rows` are now."""
        if self._rule is not None and len(rows):
            below = self._rule.below(self._episodes.core.observation[rows])
            self._below.base[rows], self._below.opening[rows] = below

    @property
    def gate_closed(self) -> NDArray[np.bool_]:
        """Robots (n,) that no output acts on, since a gate is closed; none where there is no gate."""
        if self._rule is not None:
            return self._below.opening[:, 0] <= 0.0
        if (gate := self._episodes.gate) is not None:
            return gate(self._episodes.core.observation)[:, 0] <= 0.0
        return np.zeros(self._episodes.n, np.bool_)

    def inputs(self) -> NDArray[np.float32]:
        """Inputs of the networks (n, size), as seen last."""
        rows = self._inputs.rows(self._episodes.seen, None if self._rule is None else self._below)
        more = [CRITIC[name].values(self._episodes) for name in self._critic]
        return np.hstack([rows, *more]).astype(np.float32)

    def actions(self, outputs: Actions) -> Actions:
        """Actions of the episodes that outputs (n, k) in [-1, 1] stand for."""
        return outputs if self._rule is None else self._rule.total(self._below, outputs).total
