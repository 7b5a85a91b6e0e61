"""What robots that act only at times have done: their learned actions, and the advantages of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..controllers.errors import InvalidValueError

Array = NDArray[np.float32]
MAX_EPISODES = 1000  # in a row without one learned action


@dataclass
class Choice:
    """A learned action; the reward goes on to the next one, or to the end of the episode."""

    observation: Array  # (observations,), normalised
    action: Array  # (actions,), not clipped
    value: float
    log_prob: float
    first: bool  # of its episode
    reward: float = 0.0
    ended: bool = False  # the episode ended before another one


class Streams:
    """The learned actions of n robots, in their order, robot by robot; each robot goes at its own pace."""

    def __init__(self, n: int):
        self.n = n
        self.made: list[list[Choice]] = [[] for _ in range(n)]  # whose reward is known
        self.pending: list[Choice | None] = [None] * n
        self._due: dict[int, Array] = {}  # robots that are to act now, and what they observe
        self._acted = [False] * n  # in this episode
        self._idle = 0  # episodes in a row without a learned action
        self._last: list[int] = []  # robots whose choice the last step completed

    @property
    def due(self) -> list[int]:
        """Robots that are to act now."""
        return sorted(self._due)

    @property
    def count(self) -> int:
        """Choices whose reward is known."""
        return sum(map(len, self.made))

    def observe(self, rows: Sequence[int], observations: Array) -> None:
        """The robots `rows` are to act now, at normalised observations."""
        self._due |= dict(zip(rows, observations, strict=True))

    def observations(self, rows: Sequence[int]) -> Array:
        """Normalised observations (len(rows), observations) of robots that are due."""
        return np.array([self._due[k] for k in rows])

    def choose(self, rows: Sequence[int], actions: Array, values: Array, log_probs: Array) -> None:
        """The robots `rows`, all due, have chosen."""
        for k, action, value, log_prob in zip(rows, actions, values, log_probs, strict=True):
            seen, first = self._due.pop(k), not self._acted[k]
            self.pending[k] = Choice(seen, action, float(value), float(log_prob), first)
            self._acted[k] = True

    def step(
        self, rewards: NDArray[np.float32], dones: NDArray[np.bool_], gate_open: NDArray[np.bool_]
    ) -> tuple[list[int], NDArray[np.bool_]]:
        """Account for one step of all robots.

        Args:
            rewards: (n,).
            dones: (n,) the episode has ended, a new one begun.
            gate_open: (n,) at the observations after it.

        Returns:
            The robots whose choice is complete, the last of their `made`, and which of the ended episodes
            (n,) had any.

        Raises:
            InvalidValueError: too many episodes in a row had none.
        """
        self._last, acted = [], np.array(self._acted) & dones
        for k, choice in enumerate(self.pending):
            if choice is None:
                continue
            choice.reward += float(rewards[k])
            if dones[k] or gate_open[k]:
                choice.ended = bool(dones[k])
                self.made[k].append(choice)
                self.pending[k] = None
                self._last.append(k)
        for k in np.flatnonzero(dones).tolist():
            self._idle = 0 if self._acted[k] else self._idle + 1
            self._acted[k] = False
        if self._idle >= MAX_EPISODES:
            raise InvalidValueError(f"the gate stayed shut in {self._idle} episodes: no push opens it")
        return self._last, acted

    def take(
        self, count: int, due_values: Sequence[float], gamma: float, decay: float
    ) -> tuple[list[Choice], NDArray[np.float32]]:
        """Take out the first `count` choices, with their advantages.

        What the last step completed beyond `count` is left for the next time.

        Args:
            count: as many as are there, or less by no more than the last step completed.
            due_values: of the robots that are due, in the order of `due`.
            gamma: discount for one choice.
            decay: lambda of generalised advantage estimation.
        """
        left = set(self._last[len(self._last) - (self.count - count) :])
        following = dict(zip(self.due, due_values, strict=True))
        following |= {k: choice.value for k, choice in enumerate(self.pending) if choice is not None}
        following |= {k: self.made[k][-1].value for k in left}
        taken, advantages = [], []
        for k, made in enumerate(self.made):
            part, self.made[k] = (made[:-1], made[-1:]) if k in left else (made, [])
            taken += part
            advantages += estimate_advantages(part, following.get(k, 0.0), gamma, decay)
        return taken, np.array(advantages, np.float32)


def estimate_advantages(
    choices: Sequence[Choice], following: float, gamma: float, decay: float
) -> list[float]:
    """Generalised advantages of successive choices of one robot.

        A_i = delta_i + gamma lambda A_i+1,   delta_i = r_i + gamma V_i+1 - V_i,

    both without what follows where an episode has ended (Schulman et al. 2016).

    Args:
        choices: in their order.
        following: value at the state after the last one.
        gamma: discount for one choice.
        decay: lambda.
    """
    advantage, out = 0.0, []
    for choice in reversed(choices):
        going = 0.0 if choice.ended else gamma
        advantage = choice.reward + going * following - choice.value + going * decay * advantage
        following = choice.value
        out.append(advantage)
    return out[::-1]
