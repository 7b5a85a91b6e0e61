"""Which robots of a core act on the true state and which on their own sensors, and the arrays of both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from ...controllers.validation import require_choice
from ..scenario.scenario import ONBOARD, SENSING
from ..sensing.onboard import Sensing


class Senses:
    """The sensing of n robots, each its own; `kinds` holds the arrays of exact sensing, then of onboard.

    The latter are made for the first robot that has sensors.
    """

    def __init__(self, n: int, exact: Sensing, make_onboard: Callable[[], Sensing], forced: str | None):
        """Let all robots act on the true state, or on what is forced on them.

        Args:
            n: number of robots.
            exact: arrays of exact sensing.
            make_onboard: makes those of onboard sensing.
            forced: sensing of every robot, whatever its scenario says; None: what that says.

        Raises:
            UnknownNameError: for another sensing.
        """
        if forced is not None:
            require_choice("sensing", forced, SENSING)
        self.forced = forced
        self.kinds = [exact]
        self.onboard = np.full(n, forced == ONBOARD)
        self._make, self._runs = make_onboard, [(0, n)]
        if forced == ONBOARD:
            self.kinds.append(make_onboard())

    @property
    def last(self) -> Sensing:
        """Of robots that act on their own sensors, once there are any; until then the exact one."""
        return self.kinds[-1]

    def of(self, k: int) -> int:
        """Which of `kinds` robot k has."""
        return int(self.onboard[k])

    def assign(self, k: int, sensing: str) -> bool:
        """Give robot k the sensing of a scenario; returns whether a kind has come with it."""
        self.onboard[k] = (self.forced or sensing) == ONBOARD
        changes = np.flatnonzero(np.diff(self.onboard)) + 1
        self._runs = list(pairwise([0, *changes.tolist(), len(self.onboard)]))
        if comes := self.of(k) == len(self.kinds):
            self.kinds.append(self._make())
        return comes

    def alike(self, first: int, end: int) -> Iterator[tuple[int, int, int]]:
        """(kind, first, end) of neighbours that sense alike, over the robots first..end-1."""
        for start, stop in self._runs:
            if start < end and stop > first:
                yield self.of(start), max(start, first), min(stop, end)
