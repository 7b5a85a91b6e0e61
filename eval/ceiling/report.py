"""The ceiling as a table and as a report: the policies, and what they and the searches recover together."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...controllers.files import write_text
from ..output.statistics import PairedCounts
from ..output.tables import markdown_table
from ..score.report import COLUMNS, RECOVERED_NOTE, evaluation_cells, evaluation_title
from .answers import FILE, Answers
from .neighbours import FORCES, NEIGHBOURS, TURNS
from .run import Ceiling
from .search import CEILING

REPORT = "report.md"
SHARE_COLUMNS = ("policy", "recovered", "share of the ceiling", "below it", "p")
NOTE = (
    f"`{CEILING}`: pushes that a policy recovers from, or for which a search with hindsight found an answer: "
    "a lower bound on what is possible with these actions.\n"
)


def ceiling_cells(found: Ceiling) -> list[tuple[str, ...]]:
    """One row of cells for each policy and the ceiling, in COLUMNS of an evaluation."""
    return evaluation_cells(replace(found.evaluation, rows=found.rows))


def share_cells(found: Ceiling) -> list[tuple[str, ...]]:
    """How near each policy comes to the ceiling, in SHARE_COLUMNS."""
    rows, most = found.rows, found.score.recovered
    cells = []
    for name in found.evaluation.rows:
        pairs = PairedCounts.of_rows(rows[CEILING], rows[name])
        recovered = pairs.both + pairs.only_b
        share = f"{recovered / most:.3f}" if most else "-"
        cells.append((name, str(recovered), share, str(pairs.only_a), f"{pairs.p_value:.2g}"))
    return cells


def search_lines(found: Ceiling) -> str:
    """What was searched, at what cost, and how fragile the answers are."""
    s, searched, answered = found.settings, len(found.searched), len(found.answered)
    attempts = [row["attempts"] for row in found.answered]
    pushes = "push" if searched == 1 else "pushes"
    lines = (
        f"{searched} {pushes} lost by all policies, {answered} of them answered. Each search: at most "
        f"{s.budget} attempts ({s.generations} generations of {s.population}) at {s.size} numbers, "
        f"{s.steps} steps of {s.policy} corrected by up to {s.scale:g} times the residual's scale; "
        f"seed {s.seed}."
    )
    if not answered:
        return lines + "\n"
    robust = np.array(found.robust)
    return (
        f"{lines} Median {np.median(attempts):.0f} attempts for an answer. The same sequence also recovers "
        f"{robust.mean():.0%} of the {NEIGHBOURS} pushes within {max(FORCES):.0%} of the force and "
        f"{max(TURNS):g} degrees of the direction, in the mean of the answers, {np.median(robust):.0%} in "
        f"the median; {(robust >= 0.5).sum()} of {answered} answers recover half of them or more.\n"
    )


def write_ceiling_reports(found: Ceiling) -> Path:
    """Write report.json, report.md and answers.json beside the searches; returns the path of the report."""
    Answers.of(found).save(found.directory / FILE)
    write_text(found.directory / "report.json", json.dumps(found.to_dict(), indent=1) + "\n")
    title = evaluation_title(found.evaluation)
    table, shares = (
        markdown_table(COLUMNS, ceiling_cells(found)),
        markdown_table(SHARE_COLUMNS, share_cells(found)),
    )
    path = found.directory / REPORT
    searches = f"## Searches\n\n{search_lines(found)}"
    below = f"## Policies below it\n\n{shares}\np: exact McNemar.\n"
    write_text(path, f"# Ceiling\n\n{title}\n\n{table}\n{RECOVERED_NOTE}{NOTE}\n{searches}\n{below}")
    return path
