"""A random sample of the rows that somebody hands in, run again: every bit has to be the same."""

from __future__ import annotations

import json
import random
from typing import Any

from ...controllers.errors import InvalidValueError
from ...envs.scenario.scenario import Scenario
from ..output.progress import progress_bars
from ..output.work import Work, about
from ..rollout.policy_source import Sources, guessed_seconds, policy_sources
from ..rollout.workers import chunk_sizes, make_chunks, parallel, run_chunk
from .submission import DIGEST, Row, Submission


def sample_of(submission: Submission, size: int, seed: int | None = None) -> dict[str, list[Scenario]]:
    """Scenarios of each policy that are run again, drawn anew each time unless a seed is given."""
    generator = random.SystemRandom() if seed is None else random.Random(seed)  # noqa: S311 (a stated sample)
    scenarios = submission.suite.scenarios
    return {policy: generator.sample(scenarios, min(size, len(scenarios))) for policy in submission.rows}


def run_again(submission: Submission, samples: dict[str, list[Scenario]], workers: int = 1) -> None:
    """Run samples again.

    Raises:
        InvalidValueError: a policy is not the one that its rows state, or a row is not what comes now.
        PushRecoveryError: a policy cannot be loaded.
    """
    sources = policy_sources(list(submission.rows))
    _check_digests(submission, sources)
    rows = {(name, row["scenario_id"]): row for name, given in submission.rows.items() for row in given}
    chunks = make_chunks(samples, chunk_sizes(submission.env_id, sources), workers)
    done = dict.fromkeys(samples, 0)
    seconds = guessed_seconds(submission.env_id, samples, sources, workers)
    work = Work(f"running {sum(map(len, samples.values()))} rows again", about(seconds))
    with progress_bars(list(samples), max(map(len, samples.values())), work) as bars:
        for outcomes in parallel(submission.env_id, run_chunk, chunks, workers, sources):
            for outcome in outcomes:
                _compare(rows[outcome.policy, outcome.scenario_id], outcome.to_dict())
                done[outcome.policy] += 1
                bars.set(outcome.policy, done[outcome.policy])


def _check_digests(submission: Submission, sources: Sources) -> None:
    for name, source in sources.items():
        if source.digest() != submission.digest(name):
            raise InvalidValueError(
                f"policy {name!r} is not the one of the rows: they state SHA-256 {submission.digest(name)}, "
                f"it has {source.digest()}"
            )


def _compare(given: Row, outcome: dict[str, Any]) -> None:
    """Raise InvalidValueError where an outcome is not the row that was handed in."""
    came = json.loads(json.dumps(outcome))
    said = {key: value for key, value in given.items() if key != DIGEST}
    if differs := [key for key in sorted({*said, *came}) if said.get(key) != came.get(key)]:
        key = "recovered" if "recovered" in differs else differs[0]
        raise InvalidValueError(
            f"row {given['scenario_id']!r} of {given['policy']!r} is not what running it again gives: {key} "
            f"is {said.get(key)!r}, again {came.get(key)!r} ({len(differs)} fields differ); on another kind "
            "of machine last bits may differ"
        )
