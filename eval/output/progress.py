"""Progress on standard error; standard output is left to results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


class Bars:
    """One bar for each name, all over the same kind of work, and a note behind each."""

    def __init__(self, progress: Progress, names: Sequence[str], total: int | None):
        self._progress = progress
        self._tasks = {name: progress.add_task(name, total=total, note="") for name in names}

    def set(self, name: str, completed: int, note: str = "") -> None:
        """Show the work done so far for a name."""
        self._progress.update(self._tasks[name], completed=completed, note=note)


@contextmanager
def progress_bars(names: Sequence[str], total: int | None) -> Iterator[Bars]:
    """Bars that stay while the block runs; a plain final state where standard error is no terminal."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), expand=False) as progress:
        yield Bars(progress, names, total)
