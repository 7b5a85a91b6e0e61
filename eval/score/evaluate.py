"""Score policies on a suite: every policy meets the same pushes, in parallel, resumable."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from ...controllers.files import write_text
from ...envs.scenario.scenario import Scenario
from ..output.progress import progress_bars
from ..output.rows import RowFile
from ..output.work import Work, about
from ..rollout.environments import code_digest, env_label, preset_digest
from ..rollout.outcome import Score
from ..rollout.policy_source import Sources, guessed_seconds, open_rows, policy_sources
from ..rollout.workers import chunk_sizes, make_chunks, parallel, run_chunk
from .bounds_met import bound_summary
from .suites import Suite

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
