"""Every push of a suite with what became of it, for a table with a filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...score.evaluate import Evaluation
from ..labels import outcome_words, scenario_words

Row = Mapping[str, Any]
SIGNS = {"recovered": "\N{CHECK MARK}", "survived": "\N{WHITE CIRCLE}", "fell": "\N{MULTIPLICATION X}"}


@dataclass(frozen=True)
class ScenarioLine:
    """A push and one sign for each policy, with words behind those of a loss."""

    scenario_id: str
    words: str
    signs: tuple[tuple[str, str], ...]
    kind: str  # all, none or some of the policies recover


def sign_of(row: Row) -> str:
    """Of SIGNS."""
    return SIGNS["recovered" if row["recovered"] else "survived" if row["survived"] else "fell"]


def scenario_lines(evaluation: Evaluation) -> list[ScenarioLine]:
    """One line for each scenario, in the order of the suite."""
    lines = []
    for scenario, rows in evaluation.by_scenario():
        recovered = [row["recovered"] for row in rows]
        kind = "all" if all(recovered) else "some" if any(recovered) else "none"
        signs = tuple((sign_of(row), "" if row["recovered"] else outcome_words(row)) for row in rows)
        lines.append(ScenarioLine(scenario.id, scenario_words(scenario), signs, kind))
    return lines
