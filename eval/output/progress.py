"""What work is done, on standard error; standard output is left to results.

On a terminal a bar for each name; in a log, where bars are of no use, a line every half minute.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from threading import Event, Thread
from types import MappingProxyType
from typing import Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from .lines import Lines
from .work import Work

INTERVAL = 30.0  # between two lines [s]
NONE: Mapping[str, int] = MappingProxyType({})


class Bars(Protocol):
    """One count for each name, all over the same kind of work, and a note behind each."""

    def set(self, name: str, completed: int, note: str = "") -> None:
        """Show the work done so far for a name."""
        ...


class _TerminalBars:
    def __init__(self, progress: Progress, names: Sequence[str], total: int, begun: Mapping[str, int]):
        self._progress = progress
        self._tasks = {
            name: progress.add_task(name, total=total, completed=begun.get(name, 0), note="")
            for name in names
        }

    def set(self, name: str, completed: int, note: str = "") -> None:
        self._progress.update(self._tasks[name], completed=completed, note=note)


@contextmanager
def progress_bars(
    names: Sequence[str],
    total: int,
    work: Work | None = None,
    begun: Mapping[str, int] = NONE,
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
        with Progress(*_columns(), console=console, expand=False) as progress:
            yield _TerminalBars(progress, names, total, begun)
        return
    lines = Lines(names, total, begun, sys.stderr)
    with _every_interval(lines.tell):
        yield lines
    lines.tell()


def say(work: Work) -> None:
    """What a command is about to do, on standard error."""
    print(work, file=sys.stderr, flush=True)


def _columns() -> tuple[ProgressColumn, ...]:
    return (
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )


@contextmanager
def _every_interval(tell: Callable[[], None]) -> Iterator[None]:
    """Call a function every `INTERVAL` while the block runs, however long one piece of its work takes."""
    over = Event()
    thread = Thread(target=repeat, args=(tell, over.wait), daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def repeat(tell: Callable[[], None], wait: Callable[[float], bool]) -> None:
    """Call a function after each wait of `INTERVAL`, until a wait says that it is over."""
    while not wait(INTERVAL):
        tell()
