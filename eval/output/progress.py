"""Progress of long work on standard error, and how long it takes in words; standard output is for results.

On a terminal a bar for each name; in a log, where bars are of no use, a line every half minute.
"""

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from threading import Event, Thread
from types import MappingProxyType
from typing import IO, Protocol

from rich import progress
from rich.console import Console
from rich.text import Text

from ...envs.scenario.model_errors import CONTROL_STEP
from ...envs.scenario.scenario import Scenario

COMPILING = "compiling, about 2 minutes"
SMALL = 0.05  # of the work: too little to tell how long the rest takes


def compiles_lately() -> bool:
    """That of `controllers.jit`, which is loaded when it is asked: numba takes long."""
    from ...controllers import jit

    return jit.compiles_lately()


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
        self._written = dict(self._done)
        self._begun, self._began = sum(self._done.values()), clock()
        self._first: tuple[int, float] | None = None  # all of them and when, at the first piece that was done

    def set(self, name: str, completed: int, note: str = "") -> None:
        """Count the work done so far for a name."""
        self._notes[name] = note
        self._done[name] = completed
        if self._first is None and (done := sum(self._done.values())) > self._begun:
            self._first = done, self._clock()

    def tell(self) -> None:
        """Write a line: 640/2304 in 0:01:30, about 0:03:50 left (two-stage 256/256 recovered 0.862)."""
        done, all_of_it = sum(self._done.values()), self._total * len(self._done)
        passed = self._clock() - self._began
        left = self._left(passed, done, all_of_it)
        moved = [self._part(name) for name, count in self._done.items() if count != self._written[name]]
        self._written = dict(self._done)
        behind = f" ({', '.join(moved)})" if moved else ""
        print(f"{done}/{all_of_it} in {_clock_time(passed)}{left}{behind}", file=self._out, flush=True)

    def _left(self, passed: float, done: int, all_of_it: int) -> str:
        """Time left in words; before the first piece is done, what it waits for.

        The rate is that since the first piece, before which a start-up lies; that of the first one alone
        counts only where it was no small part.
        """
        if self._first is None:
            return f", {COMPILING}" if done < all_of_it and compiles_lately() else ""
        at_first, when = self._first
        if done >= all_of_it or (done == at_first and done - self._begun < SMALL * all_of_it):
            return ""
        more, lasted = done - self._begun, passed
        if done > at_first:
            more, lasted = done - at_first, self._began + passed - when
        return f", about {_clock_time(lasted * (all_of_it - done) / more)} left"

    def _part(self, name: str) -> str:
        count = "" if len(self._done) == 1 else f" {self._done[name]}/{self._total}"
        return f"{name}{count} {self._notes[name]}".rstrip()


def _clock_time(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))


# Seconds of one core for a second of one robot with its planner, on a server of 2023; finer steps of the
# physics take as much more as there are more of them, and robots that fall early less.
COST = {"Pendulum": 0.0015, "Biped": 0.015}
SENSING = 1.5  # times as much with sensors of its own
OTHERS = 0.03  # of every other robot
BEGINNING = 8.0  # until several processes have loaded the kernels [s]
EVENT = 2.0  # when the moment of the gait comes that a push waits for [s]
UNITS = (("seconds", 1.0), ("minutes", 60.0), ("hours", 3600.0))


@dataclass(frozen=True)
class Work:
    """Announcement of work before it begins, so that nobody waits without knowing for what."""

    what: str
    how_long: str
    place: Path | None = None  # of the output

    def __str__(self) -> str:
        where = "" if self.place is None else f"; output in {self.place}"
        return f"{self.what}: {self.how_long}{where}"


def about(seconds: float) -> str:
    """A guess in words: "a few seconds", "about 40 seconds"; 0 where everything is there already."""
    if seconds <= 0.0:
        return "nothing is left to run"
    if seconds < 10.0:
        return "a few seconds"
    name, unit = [entry for entry in UNITS if seconds >= 1.5 * entry[1]][-1]
    step = 10 if seconds >= 20.0 * unit else 5 if seconds >= 10.0 * unit else 1
    return f"about {step * round(seconds / unit / step)} {name}"


def robot_seconds(env_id: str, simulated: float, workers: int = 1) -> float:
    """Wall seconds for so many simulated seconds of all robots together, about, a core for each worker."""
    cost = next((value for kind, value in COST.items() if kind in env_id), OTHERS)
    return cost * simulated / max(workers, 1)


def episode_seconds(env_id: str, scenarios: Iterable[Scenario], workers: int = 1) -> float:
    """Wall seconds for one episode of each scenario, about, where no robot falls."""
    return robot_seconds(env_id, sum(_end(one) * _cost(one) for one in scenarios), workers)


def _cost(scenario: Scenario) -> float:
    """How much dearer a second is than on the exact robot."""
    return CONTROL_STEP / scenario.physics.time_step * (1.0 if scenario.sensing == "exact" else SENSING)


def _end(scenario: Scenario) -> float:
    """When an episode ends [s], about where its pushes wait for a moment of the gait."""
    starts = [push.start if isinstance(push.start, float) else EVENT for push in scenario.forces]
    ends = [start + push.duration for start, push in zip(starts, scenario.forces, strict=True)]
    return scenario.end_time(max(ends, default=0.0))


INTERVAL = 30.0  # between two lines [s]


class Bars(Protocol):
    """One count for each name, all over the same kind of work, and a note behind each."""

    def set(self, name: str, completed: int, note: str = "") -> None:
        """Show the work done so far for a name."""
        ...


class _TerminalBars(progress.Progress):
    """Bars that run to and fro, without a total, until the first piece of work is done."""

    whole = 0  # of each

    def set(self, name: str, completed: int, note: str = "") -> None:
        for task in self.tasks:
            self.update(task.id, total=self.whole)
            if task.description == name:
                self.update(task.id, completed=completed, note=note)


class _Note(progress.ProgressColumn):
    """Behind a bar its note; behind the first one, while nothing is done, that it compiles."""

    def render(self, task: progress.Task) -> Text:
        waits = task.total is None and task.id == 0 and compiles_lately()
        return Text(COMPILING if waits else task.fields["note"])


@contextmanager
def progress_bars(
    names: Sequence[str],
    total: int,
    work: Work | None = None,
    begun: Mapping[str, int] = MappingProxyType({}),
    moving: bool = True,
) -> Iterator[Bars]:
    """Say what will be done, then show how far it is while the block runs.

    Args:
        names: what is counted side by side.
        total: of each.
        work: said first.
        begun: what is there already, by name.
        moving: bars on a terminal; otherwise lines there too, for work that is timed.
    """
    console = Console(stderr=True)
    if work is not None:
        say(work)
    if moving and (console.is_interactive or console.is_jupyter):
        columns = (
            "{task.description}", progress.BarColumn(bar_width=30), progress.MofNCompleteColumn(),
            _Note(), progress.TimeElapsedColumn(), progress.TimeRemainingColumn(),
        )  # fmt: skip
        with _TerminalBars(*columns, console=console, expand=False) as bars:
            bars.whole = total
            for name in names:
                done = begun.get(name, 0)
                bars.add_task(name, total=total if done else None, completed=done, note="")
            yield bars
        return
    lines, over = Lines(names, total, begun, sys.stderr), Event()
    thread = Thread(target=repeat, args=(lines.tell, over.wait), daemon=True)
    thread.start()
    try:
        yield lines
    finally:
        over.set()
        thread.join()
    lines.tell()


def say(work: Work) -> None:
    """Announce a command's work on standard error."""
    print(work, file=sys.stderr, flush=True)


def repeat(tell: Callable[[], None], wait: Callable[[float], bool]) -> None:
    """Call a function after each wait of `INTERVAL`, until a wait says that it is over."""
    while not wait(INTERVAL):
        tell()
