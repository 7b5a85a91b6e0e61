"""Progress as lines of text, for logs and wherever else standard error is no terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from datetime import timedelta
from typing import IO


class Lines:
    """Counts, of which `tell` writes one line: all of them together, and those that have moved since.

    Args:
        names: what is counted side by side.
        total: of each.
        begun: what is there already, by name.
        out: where the lines go.
        clock: seconds from any moment on.
    """

    def __init__(
        self,
        names: Sequence[str],
        total: int,
        begun: Mapping[str, int],
        out: IO[str],
        clock: Callable[[], float] = time.monotonic,
    ):
        self._total, self._out, self._clock = total, out, clock
        self._done = {name: begun.get(name, 0) for name in names}
        self._notes = dict.fromkeys(names, "")
        self._told = dict(self._done)
        self._begun, self._began = sum(self._done.values()), clock()

    def set(self, name: str, completed: int, note: str = "") -> None:
        """Count the work done so far for a name."""
        self._notes[name] = note
        self._done[name] = completed

    def tell(self) -> None:
        """Write a line: 640/2304 in 0:01:30, about 0:03:50 left (two-stage 256/256 recovered 0.862)."""
        done, all_of_it = sum(self._done.values()), self._total * len(self._done)
        passed = self._clock() - self._began
        left = self._left(passed, done, all_of_it)
        moved = [self._part(name) for name, count in self._done.items() if count != self._told[name]]
        self._told = dict(self._done)
        behind = f" ({', '.join(moved)})" if moved else ""
        print(f"{done}/{all_of_it} in {_clock_time(passed)}{left}{behind}", file=self._out, flush=True)

    def _left(self, passed: float, done: int, all_of_it: int) -> str:
        """What is left at the rate so far; nothing before the first piece is done and after the last."""
        if done <= self._begun or done >= all_of_it:
            return ""
        return f", about {_clock_time(passed * (all_of_it - done) / (done - self._begun))} left"

    def _part(self, name: str) -> str:
        count = "" if len(self._done) == 1 else f" {self._done[name]}/{self._total}"
        return f"{name}{count} {self._notes[name]}".rstrip()


def _clock_time(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
