"""A sample of a suite under every variation, and what each has lost and gained against the exact robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.validation import require_choice, require_integer
from ...envs.episode.profile import EXACT
from ..output.statistics import PairedCounts
from ..rollout.outcome import Score
from ..score.evaluate import Evaluation, evaluate
from ..score.suites import Suite
from .variations import VARIATIONS


@dataclass(frozen=True)
class Change:
    """One policy under one variation, beside itself on the same pushes without."""

    variation: str
    score: Score
    recovered: PairedCounts  # a: under the variation, b: exact
    survived: PairedCounts

    def to_dict(self) -> dict[str, Any]:
        """Counts, and the difference of the recovery rates with its interval and p value."""
        return {
            "recovered": self.score.recovered,
            "survived": self.score.survived,
            "episodes": self.score.episodes,
            "lost": self.recovered.only_b,
            "gained": self.recovered.only_a,
            "rate_difference": self.recovered.rate_difference,
            "ci95": list(self.recovered.interval),
            "mcnemar_p": self.recovered.p_value,
            "survived_lost": self.survived.only_b,
            "survived_gained": self.survived.only_a,
        }


@dataclass(frozen=True)
class Sensitivity:
    """Outcomes of policies on the same pushes under every variation."""

    suite: Suite  # that the sample is of
    pushes: int  # in the sample
    variations: tuple[str, ...]  # the first is EXACT
    evaluation: Evaluation

    def changes(self, policy: str) -> list[Change]:
        """What becomes of a policy under each variation, in order."""
        rows = self.evaluation.rows[policy]
        parts = [rows[i : i + self.pushes] for i in range(0, len(rows), self.pushes)]
        found = []
        for name, part in zip(self.variations, parts, strict=True):
            pairs = (PairedCounts.of_rows(part, parts[0], field) for field in ("recovered", "survived"))
            found.append(Change(name, Score.of(part), *pairs))
        return found

    def to_dict(self) -> dict[str, Any]:
        """Policy -> variation -> counts."""
        return {
            "suite": self.suite.summary(),
            "sample": self.pushes,
            "env": self.evaluation.env_id,
            "policies": {
                policy: {change.variation: change.to_dict() for change in self.changes(policy)}
                for policy in self.evaluation.rows
            },
            "out": str(self.evaluation.directory),
        }


def sample_of(suite: Suite, count: int) -> Suite:
    """`count` scenarios of a suite, evenly spread over its order: numbers floor(i n / count)."""
    most = len(suite.scenarios)
    require_integer("sample", count, 1, most)
    scenarios = tuple(suite.scenarios[i * most // count] for i in range(count))
    return Suite(f"{suite.name}-{count}", suite.version, scenarios)


def varied_by(suite: Suite, variations: Sequence[str]) -> Suite:
    """The scenarios of a suite under each variation in turn, with ids of their own.

    Raises:
        UnknownNameError: a variation that does not exist; lists those that do.
        InvalidValueError: the first is not EXACT, or one comes twice.
    """
    for name in variations:
        require_choice("variation", name, list(VARIATIONS))
    if variations[0] != EXACT.name or len(set(variations)) < len(variations):
        raise InvalidValueError(
            f"variations must be distinct and begin with {EXACT.name!r}, got {', '.join(variations)}"
        )
    scenarios = tuple(
        replace(VARIATIONS[name].applied(scenario), id=f"{scenario.id}/{name}")
        for name in variations
        for scenario in suite.scenarios
    )
    return Suite(f"{suite.name}-sensitivity", suite.version, scenarios)


def sensitivity(
    suite: Suite,
    count: int,
    env_id: str,
    policies: Any,
    variations: Sequence[str] = tuple(VARIATIONS),
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
) -> Sensitivity:
    """Run a sample of a suite under every variation; a run that was stopped goes on where it was.

    Args:
        suite: that the sample is of; model errors and physics that its scenarios have themselves stand.
        count: scenarios of the sample.
        env_id: environment.
        policies: as those of `evaluate`.
        variations: of VARIATIONS; the exact robot comes first whether it is named or not.
        workers: processes.
        directory: of rows and reports; by default under runs/.
        overwrite: start over where the directory holds rows.

    Raises:
        PushRecoveryError: as `evaluate`, `sample_of` and `varied_by`.
    """
    names = (EXACT.name, *(name for name in variations if name != EXACT.name))
    pushes = varied_by(sample_of(suite, count), names)
    evaluation = evaluate(pushes, env_id, policies, workers, directory, overwrite)
    return Sensitivity(suite, count, names, evaluation)
