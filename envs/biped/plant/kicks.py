"""Kicks of n robots that are still to come: jumps of the velocity at the beginning of a planning period."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...scenario.push import Kick

DUE = 1e-9  # a kick this soon after the period begins is due: times are sums of steps [s]


class Kicks:
    """In the order of their start; `done` counts those that have come, and is a robot's state."""

    def __init__(self, n: int):
        self.done = np.zeros(n, np.int64)
        self.waiting: set[int] = set()  # robots with a kick to come
        self._kicks: list[Sequence[Kick]] = [()] * n

    def assign(self, k: int, kicks: Sequence[Kick]) -> None:
        """Give robot k the kicks of a scenario, none of which has come."""
        self._kicks[k] = sorted(kicks, key=lambda kick: kick.start)
        self.pass_over(k, 0)

    def pass_over(self, k: int, done: int) -> None:
        """Let the first `done` kicks of robot k count as come."""
        self.done[k] = done
        (self.waiting.add if done < len(self._kicks[k]) else self.waiting.discard)(k)

    def due(self, k: int, now: float) -> Iterator[Kick]:
        """The kicks of robot k that come now [s]."""
        while k in self.waiting and (kick := self._kicks[k][self.done[k]]).start <= now + DUE:
            self.pass_over(k, int(self.done[k]) + 1)
            yield kick
