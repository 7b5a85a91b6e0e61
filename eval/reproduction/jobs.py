"""Jobs of the reproduction: each gives one row, written as it finishes, found again on the next run.

Tables of the reproduction: text cells under columns.
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol

from ...controllers.errors import InvalidValueError
from ..output.progress import Work, about, progress_bars
from ..output.rows import RowFile
from ..output.tables import markdown_table
from ..rollout.environments import code_digest
from ..rollout.workers import Runner, parallel


class Table(NamedTuple):
    """Text cells under columns."""

    title: str
    columns: Sequence[str]
    cells: Sequence[Sequence[str]]


def markdown(table: Table) -> str:
    """The table in Markdown under its title."""
    return f"**{table.title}**\n\n{markdown_table(table.columns, table.cells)}"


ENV_ID = "PushRecovery/Pendulum-v0"
SECONDS = 0.6  # of a core that a job takes, about
DECIDING = ("rollout", "frontier", "reproduction", "reproduction/pendulum", "reproduction/sections")  # rooms

Row = dict[str, Any]
Rows = Mapping[str, Row]  # by key of the job


class Job(Protocol):
    """Something to compute; frozen and picklable."""

    FIELDS: ClassVar[tuple[str, ...]]  # that every row of it has, besides those of its identity

    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""
        ...

    @property
    def text(self) -> str:
        """For the progress bar."""
        ...

    def run(self) -> Row:
        """The row, as JSON."""
        ...


def key(job: Job) -> str:
    """Name of a job's row: a hash of its identity."""
    text = json.dumps(job.identity(), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def run_job(runner: Runner, job: Job) -> Row:
    """The task of `parallel`: the row with its key and what it belongs to."""
    return {"key": key(job), **job.identity(), "label": job.text, **job.run()}


@cache
def reproduction_digest() -> str:
    """SHA-256 over controllers, envs and the rooms of eval that decide a number here."""
    digest = hashlib.sha256(code_digest().encode())
    root = Path(importlib.import_module("...eval", __package__).__path__[0])
    for path in (path for room in DECIDING for path in sorted((root / room).glob("*.py"))):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def config() -> dict[str, Any]:
    """What a directory of rows belongs to."""
    return {"reproduce": ENV_ID, "code": reproduction_digest()}


def open_store(directory: Path, overwrite: bool = False) -> RowFile:
    """Rows of a directory.

    Raises:
        InvalidValueError: it holds rows of other code, or another run is writing there.
    """
    return RowFile(directory, config(), ("key",), overwrite)


def run_jobs(jobs: Iterable[Job], store: RowFile, workers: int) -> Rows:
    """Run what the store does not hold, on several processes with a progress bar; all rows by key.

    Raises:
        InvalidValueError: a row of the store lacks what its job finds.
    """
    wanted = {key(job): job for job in jobs}
    for name, job in wanted.items():
        if lacks := [field for field in job.FIELDS if field not in store.rows.get((name,), job.FIELDS)]:
            raise InvalidValueError(
                f"{str(store.path)!r}: the row {name!r} lacks {', '.join(lacks)}; choose another --out, or "
                "--overwrite to start over"
            )
    missing = [job for name, job in wanted.items() if (name,) not in store.rows]
    done = len(wanted) - len(missing)
    length = about(SECONDS * len(missing) / max(workers, 1))
    work = Work(f"{len(wanted)} results of the paper", length, store.directory)
    with progress_bars(["reproduce"], len(wanted), work, {"reproduce": done}) as bars:
        for row in parallel(ENV_ID, run_job, missing, workers):
            store.append(row)
            done += 1
            bars.set("reproduce", done, row["label"])
    return {name: store.rows[name,] for name in wanted}
