"""The sensitivity of outcomes as a table and as a report."""

from __future__ import annotations

import json
from pathlib import Path

from ...controllers.files import write_text
from ..output.tables import markdown_table
from .run import Change, Sensitivity

COLUMNS = ("variation", "recovered", "survived", "lost", "gained", "difference of rates", "p")
NOTE = (
    "Lost and gained: pushes that the exact robot recovers from and this one does not, and the other way "
    "round. Difference: rate of recovery minus that of the exact robot, with its 95 % score interval "
    "(Newcombe). p: exact McNemar. What a variation is: docs/sensitivity.md.\n"
)


def sensitivity_title(result: Sensitivity, policy: str) -> str:
    """Environment, policy and suite in one line."""
    return (
        f"{result.evaluation.env_id}: {policy}, {result.pushes} pushes of suite {result.suite.name} "
        f"v{result.suite.version}, sha256 {result.suite.sha256[:12]}"
    )


def sensitivity_cells(changes: list[Change]) -> list[tuple[str, ...]]:
    """One row of cells for each variation, in COLUMNS."""
    cells = []
    for change in changes:
        score, pairs = change.score, change.recovered
        low, high = pairs.interval
        difference = f"{pairs.rate_difference:+.3f} ({low:+.3f} to {high:+.3f})"
        counts = (str(n) for n in (score.recovered, score.survived, pairs.only_b, pairs.only_a))
        compared = (difference, f"{pairs.p_value:.2g}") if change is not changes[0] else ("-", "-")
        cells.append((change.variation, *counts, *compared))
    return cells


def write_sensitivity_reports(result: Sensitivity) -> Path:
    """Write report.json and report.md into the directory; returns the path of the latter."""
    directory = result.evaluation.directory
    write_text(directory / "report.json", json.dumps(result.to_dict(), indent=1) + "\n")
    parts = [
        f"## {sensitivity_title(result, policy)}\n\n"
        + markdown_table(COLUMNS, sensitivity_cells(result.changes(policy)))
        for policy in result.evaluation.rows
    ]
    path = directory / "report.md"
    write_text(path, "# Sensitivity\n\n" + "\n".join(parts) + f"\n{NOTE}")
    return path
