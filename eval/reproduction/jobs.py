"""Jobs of the reproduction: each gives one row, written as it finishes and found again by the next run."""

import hashlib
import importlib
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.model.nominal_gait import NominalGait
from ...controllers.model.observation import side_sign
from ..output.progress import Work, about, progress_bars
from ..output.rows import RowFile
from ..output.tables import Table
from ..rollout.environments import code_digest
from ..rollout.workers import Runner, parallel
from ..score.threshold import BEYOND, Scanned, multiples, scan_upwards
from .pendulum import PushKind, Variant, Walk, record

Row = dict[str, Any]
Rows = Mapping[str, Row]  # by key of the job


class Job(ABC):
    """A computation that gives one row; frozen and picklable."""

    FIELDS: ClassVar[tuple[str, ...]]  # that every row has, besides those of the job's identity

    @property
    @abstractmethod
    def text(self) -> str:
        """Words for the progress bar."""

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""

    @abstractmethod
    def run(self) -> Row:
        """The row, as JSON."""


CHUNK = 640.0  # range of forces that are tried side by side; changes no number [N]
Survives = Callable[[Sequence[float]], Sequence[bool]]


@dataclass(frozen=True)
class ScanJob(Job):
    """Scan of one direction of one variant.

    `grids` go from coarse to fine, in newtons for 0.1 s. The coarse one is scanned from its first multiple to
    BEYOND past the first failure; every finer one fills the interval that ends at the first failure so far.
    """

    FIELDS: ClassVar[tuple[str, ...]] = ("unit", "survived", "largest_survived", "failed")
    variant: Variant
    push: PushKind
    grids: tuple[float, ...] = (5.0, 1.0)
    seeds: tuple[int, ...] = (0,)  # of noise; a strength counts as survived where all of them are

    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""
        scan = {"grids": list(self.grids), "seeds": list(self.seeds), "variant": self.variant.identity()}
        return {"kind": "scan", **asdict(self.push), **scan}

    @property
    def text(self) -> str:
        """Words for the progress bar."""
        return f"{self.variant.label}, {self.push.psi_deg:g} deg"

    def run(self) -> Row:
        """Scan; strengths in the unit of the push."""
        return {"unit": self.push.unit, **scan(self._survives, self.grids, self.push.unit_strength)}

    def _survives(self, strengths: Sequence[float]) -> list[bool]:
        outcomes = self.variant.run([self.push.scenario(s, seed) for s in strengths for seed in self.seeds])
        n = len(self.seeds)
        return [all(one.survived for one in outcomes[n * k : n * (k + 1)]) for k in range(len(strengths))]


def scan(survives: Survives, grids: Sequence[float], unit: float = 1.0) -> Row:
    """Largest strength before the first failure, the largest survived, and failures; numbers in `unit`s."""
    side_by_side = max(1, round(CHUNK / grids[0]))

    def in_chunks(strengths: Iterator[float]) -> Iterator[tuple[float, bool]]:
        while chunk := list(islice(strengths, side_by_side)):
            yield from zip(chunk, survives(chunk), strict=True)

    strengths = (round(force * unit, 9) for force in multiples(grids[0]))
    survived = scan_upwards(in_chunks, strengths, BEYOND * unit, bool)
    for grid in grids[1:]:
        first = min((s for s, ok in survived.items() if not ok), default=None)
        if first is None:
            break
        below = max((s for s, ok in survived.items() if ok and s < first), default=0.0)
        count = math.ceil((first - below) / (grid * unit) - 1e-9)
        between = [round(below + k * grid * unit, 9) for k in range(1, count)]
        survived.update(zip(between, survives(between), strict=True) if between else ())
    found = asdict(Scanned.of(survived))
    return {**found, "failed": list(found["failed"])}


@dataclass(frozen=True)
class EpisodeJob(Job):
    """Outcome of one push of one variant."""

    FIELDS: ClassVar[tuple[str, ...]] = (
        "survived", "recovered", "recovered_at", "failure_reason", "end_time",
    )  # fmt: skip
    kind: ClassVar[str] = "episode"  # of the row
    variant: Variant
    push: PushKind
    strength: float

    def identity(self) -> dict[str, Any]:
        """All that decides the row, as JSON."""
        about = {**asdict(self.push), "strength": self.strength}
        return {"kind": self.kind, **about, "variant": self.variant.identity()}

    @property
    def text(self) -> str:
        """Words for the progress bar."""
        return f"{self.variant.label}, {self.strength:g} {self.push.unit}"

    def run(self) -> Row:
        """Fields of the outcome."""
        (outcome,) = self.variant.run([self.push.scenario(self.strength)])
        return {name: getattr(outcome, name) for name in self.FIELDS}


SWAY_TIME = 1.0  # the sway is that within this time of the push's onset [s]
LAST_STEPS = 2  # the final speed is that of so many steps


@dataclass(frozen=True)
class CaseJob(EpisodeJob):
    """Gait, CoP and lean in one push of one variant, in numbers."""

    FIELDS: ClassVar[tuple[str, ...]] = (
        "survived", "end_time", "step_error_before", "duration_error_before", "pushed_step",
        "cop_to_inner_edge", "peak_lean_within_1_s", "peak_lean", "final_lean",
    )  # fmt: skip
    kind: ClassVar[str] = "case"

    def run(self) -> Row:
        """Record the push and measure it."""
        return case_numbers(record(self.variant, self.push, self.strength), self.variant.gait(self.push.vx))


def case_numbers(walk: Walk, gait: NominalGait) -> Row:
    """Numbers of a recorded push as JSON; lengths [m], times [s], angles [rad], speed [m/s]."""
    time, survived = walk["time"], walk.outcome.survived
    pushed = int(np.searchsorted(walk.touchdown, walk.push_start + 1e-9, side="right")) - 1
    strides, durations = np.diff(walk.foothold, axis=0), np.diff(walk.touchdown)
    nominal = np.array([gait.length, gait.width])
    steps = np.stack([strides[:, 0], np.abs(strides[:, 1])], axis=1)
    inside = walk["step"] == pushed
    outward = side_sign(walk.foothold_side[pushed])
    inner = outward * (walk["cop_y"][inside] - walk.foothold[pushed, 1])
    lean = np.maximum(np.abs(walk["trunk_pitch"]), np.abs(walk["trunk_roll"]))
    swaying = (time >= walk.push_start) & (time <= walk.push_start + SWAY_TIME)
    numbers = {
        "survived": survived,
        "end_time": float(time[-1]),
        "step_error_before": float(np.abs(steps[:pushed] - nominal).max()),
        "duration_error_before": float(np.abs(durations[:pushed] - gait.duration).max()),
        "pushed_step": {"length": float(steps[pushed, 0]), "width": float(steps[pushed, 1]),
                        "duration": float(durations[pushed])},
        "cop_to_inner_edge": float(inner.max()),
        "peak_lean_within_1_s": float(lean[swaying].max()),
        "peak_lean": float(lean.max()),
        "final_lean": float(lean[-1]),
    }  # fmt: skip
    if survived:
        first, last = np.searchsorted(time, walk.touchdown[[-1 - LAST_STEPS, -1]])
        run = walk["com_x"][last] - walk["com_x"][first]
        numbers["final_speed"] = float(run / (time[last] - time[first]))
    return numbers


ENV_ID = "PushRecovery/Pendulum-v0"
SECONDS = 0.6  # of a core that a job takes, about
DECIDING = ("rollout", "score/threshold.py", "record/record.py", "reproduction")  # folders and files of eval


def key(job: Job) -> str:
    """Name of a job's row: a hash of its identity."""
    text = json.dumps(job.identity(), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def run_job(runner: Runner, job: Job) -> Row:
    """The task of `parallel`: the row with its key and the job's identity."""
    return {"key": key(job), **job.identity(), "label": job.text, **job.run()}


@cache
def reproduction_digest() -> str:
    """SHA-256 over controllers, envs and the files of eval that decide a number here."""
    digest = hashlib.sha256(code_digest().encode())
    root = Path(importlib.import_module("...eval", __package__).__path__[0])
    for place in (root / name for name in DECIDING):
        for path in sorted(place.glob("*.py")) if place.is_dir() else [place]:
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def config() -> dict[str, Any]:
    """The configuration that a directory of rows belongs to."""
    return {"reproduce": ENV_ID, "code": reproduction_digest()}


def open_store(directory: Path, overwrite: bool = False) -> RowFile:
    """Rows of a directory; one with rows of other code, or in use, is refused."""
    return RowFile(directory, config(), ("key",), overwrite)


def run_jobs(jobs: Iterable[Job], store: RowFile, workers: int) -> Rows:
    """Rows by key, of which the store has some; the others run in processes, with a progress bar."""
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


@dataclass(frozen=True)
class Section:
    """One part of the paper; `directions` is the number of them in scenario 2."""

    name: str
    jobs: Callable[[int], Iterable[Job]]  # directions -> what has to be computed
    summary: Callable[[Rows, int], dict[str, Any]]  # rows, directions -> its part of the result object
    tables: Callable[[dict[str, Any]], list[Table]]  # that part for people
    draw: Callable[[dict[str, Any], Path], list[Path]] = lambda content, directory: []  # its pictures
