"""Score policies on a suite: every policy meets the same pushes, in parallel, resumable, paired."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.whole_body.limits import LIMIT_NAMES
from ...envs.scenario.scenario import Scenario
from ..output.progress import Work, about, progress_bars
from ..output.statistics import PairedCounts
from ..rollout import environments, policy_source
from ..rollout.outcome import Row, Score, check_row
from ..rollout.workers import chunk_sizes, make_chunks, parallel, run_chunk
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
        """Counts of a policy over the whole suite."""
        return Score.of(self.rows[policy])

    def by_scenario(self) -> Iterator[tuple[Scenario, list[dict[str, Any]]]]:
        """Each scenario with the rows of all policies."""
        for scenario, *rows in zip(self.suite.scenarios, *self.rows.values(), strict=True):
            yield scenario, rows

    def to_dict(self) -> dict[str, Any]:
        """JSON object of all policies."""
        return {
            "suite": self.suite.summary(),
            "env": self.env_id,
            "policies": {name: self.score(name).to_dict() for name in self.rows},
            "out": str(self.directory),
        }


def limits_met(rows: Iterable[Row]) -> dict[str, dict[str, float]]:
    """Limit -> how many rows met it first, what share of them met it, mean share of the time.

    Limits that no row met are left out.
    """
    rows, found = list(rows), {}
    for name in LIMIT_NAMES:
        shares = [row.get("limit_shares", {}).get(name, 0.0) for row in rows]
        if any(shares):
            found[name] = {
                "first": sum(row.get("first_limit") == name for row in rows),
                "met": sum(share > 0.0 for share in shares) / len(rows),
                "time": sum(shares) / len(rows),
            }
    return found


def limit_summary(rows: Iterable[Row]) -> dict[str, dict[str, dict[str, float]]]:
    """`limits_met` by the falls and by the episodes that recovered."""
    rows = list(rows)
    return {
        "falls": limits_met(row for row in rows if not row["survived"]),
        "recovered": limits_met(row for row in rows if row["recovered"]),
    }


def configuration(suite: Suite, env_id: str) -> dict[str, Any]:
    """All that the rows of a directory belong to: suite, environment, and the code behind them."""
    names = {"format": FORMAT, "suite": suite.summary(), "env": env_id, "code": environments.code_digest()}
    return names | environments.preset_digest(env_id)


def evaluate(
    suite: Suite,
    env_id: str,
    policies: Any,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
) -> Evaluation:
    """Run every policy on every scenario of the suite; rows present in the directory are kept.

    Arguments as those of `eval.api.evaluate`.

    Raises:
        PushRecoveryError: unknown names, a directory of another configuration, unreadable files.
    """
    sources = policy_source.policy_sources(policies)
    sizes = chunk_sizes(env_id, sources, suite.scenarios)
    config = configuration(suite, env_id)
    label = f"{suite.name}-{environments.env_label(env_id)}"
    store, digests = policy_source.open_rows(label, config, sources, KEY, SCORED, directory, overwrite)
    began = time.perf_counter()
    with store:
        store.check_rows(check_row)
        missing = {name: [s for s in suite.scenarios if (name, s.id) not in store.rows] for name in sources}
        done = {
            name: [store.rows[name, s.id] for s in suite.scenarios if (name, s.id) in store.rows]
            for name in sources
        }
        whose = f"each of {len(sources)} policies" if len(sources) > 1 else next(iter(sources))
        what = f"{suite.name}: {len(suite.scenarios)} episodes of {whose}"
        seconds = policy_source.guessed_seconds(env_id, missing, sources, workers)
        work = Work(what, about(seconds), store.directory)
        begun = {name: len(rows) for name, rows in done.items()}
        chunks = make_chunks(missing, sizes, workers)
        with progress_bars(list(sources), len(suite.scenarios), work, begun) as bars:
            for outcome in chain.from_iterable(parallel(env_id, run_chunk, chunks, workers, sources)):
                row = {**outcome.to_dict(), "policy_sha256": digests[outcome.policy]}
                store.append(row)
                done[outcome.policy].append(row)
                score = Score.of(done[outcome.policy])
                bars.set(outcome.policy, score.episodes, f"recovered {score.rate:.3f}")
    rows = {name: [store.rows[name, s.id] for s in suite.scenarios] for name in sources}
    return Evaluation(suite, env_id, rows, store.directory, time.perf_counter() - began)


@dataclass(frozen=True)
class Comparison:
    """Recovery of a against b: two policies of one evaluation."""

    a: str
    b: str
    evaluation: Evaluation  # of both

    @cached_property
    def counts(self) -> PairedCounts:
        """Pairs of outcomes on the same pushes."""
        return PairedCounts.of_rows(self.evaluation.rows[self.a], self.evaluation.rows[self.b])

    @property
    def suite(self) -> Suite:
        """The pushes that both met."""
        return self.evaluation.suite

    @property
    def directory(self) -> Path:
        """Directory of the rows."""
        return self.evaluation.directory

    def to_dict(self) -> dict[str, Any]:
        """JSON object; rate_difference = rate of a - rate of b."""
        counts = self.counts
        return {
            "a": self.a,
            "b": self.b,
            "suite": self.suite.name,
            "pairs": counts.pairs,
            **asdict(counts),
            "mcnemar_p": counts.p_value,
            "rate_difference": counts.rate_difference,
            "ci95": list(counts.interval),
            "survived_a": self.evaluation.score(self.a).survived,
            "survived_b": self.evaluation.score(self.b).survived,
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

    Raises:
        PushRecoveryError: as `evaluate`; InvalidValueError too where these are not two policies.
    """
    sources = policy_source.policy_sources([a, b])
    if len(sources) != 2:
        raise InvalidValueError(f"two policies are compared, got {len(sources)}: {', '.join(sources)}")
    evaluation = evaluate(suite, env_id, sources, workers, directory, overwrite)
    first, second = sources
    return Comparison(first, second, evaluation)
