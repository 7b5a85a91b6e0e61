"""Jobs of the reproduction: each gives one row, written as it finishes, found again on the next run."""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from ..files import RowFile
from ..loading import code_digest
from ..progress import progress_bars
from ..workers import Runner, parallel

ENV_ID = "PushRecovery/Pendulum-v0"
NO_NUMBERS = (
    "figure_", "animation", "style", "claims", "page", "tables", "run", "command",
)  # how files begin that decide no row  # fmt: skip

Row = dict[str, Any]
Rows = Mapping[str, Row]  # by key of the job


class Job(Protocol):
    """Something to compute; frozen and picklable."""

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
    """SHA-256 over all source that decides a number here."""
    digest = hashlib.sha256(code_digest().encode())
    root = Path(importlib.import_module("...eval", __package__).__path__[0])
    files = [*root.glob("pendulum_*.py"), *root.glob("reproduction/*.py"), root / "frontier.py"]
    for path in sorted(path for path in files if not path.name.startswith(NO_NUMBERS)):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def config() -> dict[str, Any]:
    """What a directory of rows belongs to."""
    return {"reproduce": ENV_ID, "code": reproduction_digest()}


def open_store(directory: Path, overwrite: bool = False) -> RowFile:
    """Rows of a directory.

    Raises:
        InvalidValueError: it holds rows of other code.
    """
    return RowFile(directory, config(), ("key",), overwrite)


def run_jobs(jobs: Iterable[Job], store: RowFile, workers: int) -> Rows:
    """Run what the store does not hold, on several processes with a progress bar; all rows by key."""
    wanted = {key(job): job for job in jobs}
    missing = [job for name, job in wanted.items() if (name,) not in store.rows]
    try:
        with progress_bars(["reproduce"], len(wanted)) as bars:
            done = len(wanted) - len(missing)
            bars.set("reproduce", done)
            for row in parallel(ENV_ID, run_job, missing, workers):
                store.append(row)
                done += 1
                bars.set("reproduce", done, row["label"])
    finally:
        store.close()
    return {name: store.rows[name,] for name in wanted}
