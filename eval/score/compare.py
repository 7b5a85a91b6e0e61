"""Two policies on the same pushes: paired counts, exact McNemar test, score interval."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ..output.statistics import PairedCounts
from ..rollout.policy_source import policy_sources
from .evaluate import Evaluation, evaluate
from .suites import Suite


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
