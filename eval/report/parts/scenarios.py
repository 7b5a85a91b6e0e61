"""Every push of a suite with what became of it, for a table with a filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...score.evaluate import Evaluation
from ..labels import effort_words, outcome_words, scenario_words

Row = Mapping[str, Any]
SIGNS = {"recovered": "\N{CHECK MARK}", "survived": "\N{WHITE CIRCLE}", "fell": "\N{MULTIPLICATION X}"}


@dataclass(frozen=True)
class ScenarioLine:
    """A push and one sign for each policy, with words behind it: what became of it, and what it took."""

    scenario_id: str
    words: str
    signs: tuple[tuple[str, str], ...]
    kind: str  # all, none or some of the policies recover
    share: str  # of F* at its moment; empty where there is none


def sign_of(row: Row) -> str:
    """Of SIGNS."""
    return SIGNS["recovered" if row["recovered"] else "survived" if row["survived"] else "fell"]


def scenario_lines(evaluation: Evaluation, shares: Mapping[str, float]) -> list[ScenarioLine]:
    """One line for each scenario, in the order of the suite; `shares` of F* by scenario, where it has one."""
    lines = []
    for scenario, rows in evaluation.by_scenario():
        recovered = [row["recovered"] for row in rows]
        kind = "all" if all(recovered) else "some" if any(recovered) else "none"
        signs = tuple((sign_of(row), _behind(row)) for row in rows)
        share = f"{shares[scenario.id]:.2f}" if scenario.id in shares else ""
        lines.append(ScenarioLine(scenario.id, scenario_words(scenario), signs, kind, share))
    return lines


def _behind(row: Row) -> str:
    """Words behind a sign."""
    told = "" if row["recovered"] else outcome_words(row), effort_words(row)
    return "; ".join(words for words in told if words)
