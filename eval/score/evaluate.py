"""Score policies on a suite: every policy meets the same pushes, in parallel, resumable, paired.

Which bounds the falls of a policy met, beside those of the episodes it recovered from.

The keys of rows say `limit` for such a bound, as they did in all rows that were ever written.

Score policies on a suite: every policy meets the same pushes, in parallel, resumable.

Two policies on the same pushes: paired counts, exact McNemar test, score interval.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.files import write_text
from ...controllers.whole_body.limits import BOUNDS
from ...envs.scenario.scenario import Scenario
from ..output.progress import Work, about, progress_bars
from ..output.rows import RowFile
from ..output.statistics import PairedCounts
from ..rollout.environments import code_digest, env_label, preset_digest
from ..rollout.outcome import Outcome, Score
from ..rollout.policy_source import Sources, guessed_seconds, open_rows, policy_sources
from ..rollout.workers import chunk_sizes, make_chunks, parallel, run_chunk
from .suites import Suite

Row = Mapping[str, Any]
COLUMNS = (
    "limit",
    "first in falls",
    "met in falls",
    "time in falls",
    "met in recovered",
    "time in recovered",
)
BOUNDS_NOTE = (
    "Limits count from the start of the first push on; docs/evaluation.md says what each is. First: falls "
    "that met it first. Met: share of the episodes that met it. Time: mean share of the time until the end.\n"
)


def bounds_of(rows: Iterable[Row]) -> dict[str, dict[str, float]]:
    """Bound -> how many rows met it first, what share of them met it, mean share of the time.

    Bounds that no row met are left out.
    """
    rows, found = list(rows), {}
    for name in BOUNDS:
        shares = [row.get("limit_shares", {}).get(name, 0.0) for row in rows]
        if any(shares):
            found[name] = {
                "first": sum(row.get("first_limit") == name for row in rows),
                "met": sum(share > 0.0 for share in shares) / len(rows),
                "time": sum(shares) / len(rows),
            }
    return found


def bound_summary(rows: Iterable[Row]) -> dict[str, dict[str, dict[str, float]]]:
    """`bounds_of` the falls and of the episodes that recovered."""
    rows = list(rows)
    return {
        "falls": bounds_of(row for row in rows if not row["survived"]),
        "recovered": bounds_of(row for row in rows if row["recovered"]),
    }


def bound_cells(rows: Iterable[Row]) -> list[tuple[str, ...]]:
    """One row of cells for each bound that was met, in COLUMNS."""
    summary = bound_summary(rows)
    falls, recovered = summary["falls"], summary["recovered"]
    nothing = {"first": 0, "met": 0.0, "time": 0.0}
    cells = []
    for name in BOUNDS:
        if name in falls or name in recovered:
            fell, stood = falls.get(name, nothing), recovered.get(name, nothing)
            numbers = fell["met"], fell["time"], stood["met"], stood["time"]
            cells.append((name, str(fell["first"]), *(f"{number:.2f}" for number in numbers)))
    return cells


def first_bounds(rows: Iterable[Row]) -> str:
    """Bounds that falls met first, the most frequent first, with their counts."""
    falls = bounds_of(row for row in rows if not row["survived"])
    counts = sorted(((-entry["first"], name) for name, entry in falls.items() if entry["first"]))
    return ", ".join(f"{name} {-count}" for count, name in counts) or "-"


def fall_bounds(force: float, outcome: Outcome) -> dict[str, Any]:
    """What a frontier's row keeps of a failed force [N]."""
    return {
        "force_N": force,
        "failure_reason": outcome.failure_reason,
        "first_limit": outcome.first_limit,
        "limits_met": dict(outcome.limits_met),
        "limit_shares": dict(outcome.limit_shares),
    }


def fall_cell(falls: Sequence[Row]) -> str:
    """Of the weakest force that failed: the bound met first, and the three met for the longest time."""
    if not falls or falls[0]["first_limit"] is None:
        return "-"
    shares = falls[0]["limit_shares"]
    longest = sorted(shares, key=lambda name: (-shares[name], BOUNDS.index(name)))[:3]
    return f"{falls[0]['first_limit']}; " + ", ".join(f"{name} {shares[name]:.2f}" for name in longest)


FORMAT = 3  # of the rows
KEY = ("policy", "scenario_id")  # of a row
SCORED = ("recovered", "survived", "failure_reason", "impulse")  # fields that a score is made of
Rows = dict[str, list[dict[str, Any]]]  # policy -> rows in the suite's order


@dataclass(frozen=True)
class Evaluation:
    """Outcomes of policies on one suite."""

    suite: Suite
    env_id: str
    rows: Rows
    directory: Path
    wall_time: float  # of this run, without resumed rows [s]

    def score(self, policy: str) -> Score:
        """Over the whole suite."""
        return Score.of(self.rows[policy])

    def by_scenario(self) -> Iterator[tuple[Scenario, list[dict[str, Any]]]]:
        """Each scenario with the rows of all policies."""
        for scenario, *rows in zip(self.suite.scenarios, *self.rows.values(), strict=True):
            yield scenario, rows

    def to_dict(self) -> dict[str, Any]:
        """The contract's object."""
        return {
            "suite": self.suite.summary(),
            "env": self.env_id,
            "policies": {name: self.score(name).to_dict() for name in self.rows},
            "out": str(self.directory),
        }


def configuration(suite: Suite, env_id: str) -> dict[str, Any]:
    """What the rows of a directory belong to: suite, environment, and the code behind them."""
    names = {"format": FORMAT, "suite": suite.summary(), "env": env_id, "code": code_digest()}
    return names | preset_digest(env_id)


def evaluate(
    suite: Suite,
    env_id: str,
    policies: Any,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
    on_row: Callable[[dict[str, Any]], None] | None = None,
) -> Evaluation:
    """Run every policy on every scenario of the suite; rows present in the directory are kept.

    Args:
        suite: scenarios.
        env_id: environment.
        policies: names, files, MODULE:ATTRIBUTE or objects, or a mapping of labels to them.
        workers: processes.
        directory: where outcomes.jsonl, config.json and the reports go; by default under runs/.
        overwrite: start over where the directory holds rows.
        on_row: called after each new row is on disk.

    Raises:
        PushRecoveryError: unknown names, a directory of another configuration, unreadable files.
    """
    sources = policy_sources(policies)
    sizes = chunk_sizes(env_id, sources)
    config = configuration(suite, env_id)
    label = f"{suite.name}-{env_label(env_id)}"
    store, digests = open_rows(label, config, sources, KEY, SCORED, directory, overwrite)
    began = time.perf_counter()
    with store:
        _run_missing(store, suite, env_id, sources, digests, sizes, workers, on_row)
    rows = {name: [store.rows[name, s.id] for s in suite.scenarios] for name in sources}
    return Evaluation(suite, env_id, rows, store.directory, time.perf_counter() - began)


def _run_missing(
    store: RowFile,
    suite: Suite,
    env_id: str,
    sources: Sources,
    digests: Mapping[str, str | None],
    sizes: Mapping[str, int],
    workers: int,
    on_row: Callable[[dict[str, Any]], None] | None,
) -> None:
    """Append the rows that the store lacks, with a bar for each policy (key of `digests` and `sizes`)."""
    policies = list(digests)
    missing = {name: [s for s in suite.scenarios if (name, s.id) not in store.rows] for name in policies}
    chunks = make_chunks(missing, sizes, workers)
    ids = {scenario.id for scenario in suite.scenarios}
    done = {
        name: [row for key, row in store.rows.items() if key[0] == name and key[1] in ids]
        for name in policies
    }
    length = about(guessed_seconds(env_id, missing, sources, workers))
    work = Work(f"{suite.name}: {_counted(policies, suite)}", length, store.directory)
    begun = {name: len(rows) for name, rows in done.items()}
    with progress_bars(policies, len(suite.scenarios), work, begun) as bars:
        for outcome in chain.from_iterable(parallel(env_id, run_chunk, chunks, workers, sources)):
            row = {**outcome.to_dict(), "policy_sha256": digests[outcome.policy]}
            store.append(row)
            done[outcome.policy].append(row)
            score = Score.of(done[outcome.policy])
            bars.set(outcome.policy, score.episodes, f"recovered {score.rate:.3f}")
            if on_row is not None:
                on_row(row)


def _counted(policies: list[str], suite: Suite) -> str:
    whose = policies[0] if len(policies) == 1 else f"each of {len(policies)} policies"
    return f"{len(suite.scenarios)} episodes of {whose}"


def write_reports(evaluation: Evaluation, markdown: str) -> Path:
    """Write report.json and report.md into the directory; returns the path of the latter."""
    content = evaluation.to_dict()
    for name, entry in content["policies"].items():
        entry["limits"] = bound_summary(evaluation.rows[name])
    content["wall_time_s"] = round(evaluation.wall_time, 3)
    write_text(evaluation.directory / "report.json", json.dumps(content, indent=1) + "\n")
    path = evaluation.directory / "report.md"
    write_text(path, markdown)
    return path


@dataclass(frozen=True)
class Comparison:
    """Recovery of a against b."""

    a: str
    b: str
    suite: Suite
    counts: PairedCounts
    survived: tuple[int, int]  # of a, of b
    evaluation: Evaluation  # of both

    @property
    def directory(self) -> Path:
        """Of the rows."""
        return self.evaluation.directory

    def to_dict(self) -> dict[str, Any]:
        """The contract's object; rate_difference = rate of a - rate of b."""
        return {
            "a": self.a,
            "b": self.b,
            "suite": self.suite.name,
            "pairs": self.counts.pairs,
            "both": self.counts.both,
            "only_a": self.counts.only_a,
            "only_b": self.counts.only_b,
            "neither": self.counts.neither,
            "mcnemar_p": self.counts.p_value,
            "rate_difference": self.counts.rate_difference,
            "ci95": list(self.counts.interval),
            "survived_a": self.survived[0],
            "survived_b": self.survived[1],
        }


def compare(
    a: Any,
    b: Any,
    suite: Suite,
    env_id: str,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
) -> Comparison:
    """Evaluate both on the suite (rows in the directory are kept) and pair their outcomes.

    Args:
        a: a name, a file, MODULE:ATTRIBUTE, an object, or a mapping of one label to one of them.
        b: the same.
        suite: scenarios.
        env_id: environment.
        workers: processes.
        directory: where outcomes.jsonl and config.json go; by default under runs/.
        overwrite: start over where the directory holds rows.

    Raises:
        PushRecoveryError: as `evaluate`; InvalidValueError too where these are not two policies.
    """
    sources = policy_sources([a, b])
    if len(sources) != 2:
        raise InvalidValueError(f"two policies are compared, got {len(sources)}: {', '.join(sources)}")
    evaluation = evaluate(suite, env_id, sources, workers, directory, overwrite)
    first, second = sources
    return Comparison(
        first,
        second,
        suite,
        PairedCounts.of_rows(evaluation.rows[first], evaluation.rows[second]),
        (evaluation.score(first).survived, evaluation.score(second).survived),
        evaluation,
    )
