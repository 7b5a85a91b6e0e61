"""An evaluation as a table and as a report."""

from __future__ import annotations

from itertools import combinations

from ..output.statistics import PairedCounts
from ..output.tables import markdown_table
from ..rollout.outcome import Score
from .bounds_met import COLUMNS as BOUND_COLUMNS
from .bounds_met import NOTE, bound_cells, first_bounds
from .effort import COLUMNS as EFFORT_COLUMNS
from .effort import NOTE as EFFORT_NOTE
from .effort import effort_cells
from .evaluate import Evaluation
from .kinds import groups_of, kind_cells

COLUMNS = ("policy", "recovered", "rate", "95 % interval", "survived")
PAIR_COLUMNS = ("A", "B", "only A recovers", "only B recovers", "p")
REASONS = ("not recovered", "first limit of the falls")  # columns of the report besides
RECOVERED_NOTE = (
    "Recovered: no fall until 4 s after the last push; over the last two steps DCM offset within 5 cm "
    "of nominal and mean velocity within 0.15 m/s of the command. Intervals: Wilson, 95 %.\n"
)


def rate_cells(score: Score) -> tuple[str, str]:
    """Rate and Wilson interval as text."""
    low, high = score.ci95
    return f"{score.rate:.3f}", f"{low:.3f}-{high:.3f}"


def evaluation_cells(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """One row of cells for each policy, in COLUMNS."""
    cells = []
    for name in evaluation.rows:
        score = evaluation.score(name)
        cells.append((name, f"{score.recovered}/{score.episodes}", *rate_cells(score), f"{score.survived}"))
    return cells


def reason_cells(evaluation: Evaluation) -> list[tuple[str, str]]:
    """Why each policy did not recover, and what its falls met first, in REASONS."""
    cells = []
    for name, rows in evaluation.rows.items():
        failures = evaluation.score(name).failures
        reasons = ", ".join(f"{reason} {count}" for reason, count in failures.items()) or "-"
        cells.append((reasons, first_bounds(rows)))
    return cells


def evaluation_title(evaluation: Evaluation) -> str:
    """Suite, version, hash and environment in one line."""
    suite = evaluation.suite
    return (
        f"{evaluation.env_id}: suite {suite.name} v{suite.version}, {len(suite.scenarios)} pushes, "
        f"sha256 {suite.sha256[:12]}"
    )


def evaluation_markdown(evaluation: Evaluation) -> str:
    """The report as Markdown."""
    rates, reasons = evaluation_cells(evaluation), reason_cells(evaluation)
    cells = [(*cell, *why) for cell, why in zip(rates, reasons, strict=True)]
    table = markdown_table((*COLUMNS, *REASONS), cells)
    told = pairs_markdown, kinds_markdown, effort_markdown, limits_markdown
    parts = "".join(part(evaluation) for part in told)
    return f"# Evaluation\n\n{evaluation_title(evaluation)}\n\n{table}\n{RECOVERED_NOTE}{parts}"


def pairs_markdown(evaluation: Evaluation) -> str:
    """A table of every two policies on the same pushes; nothing where there is one alone."""
    lines = []
    for a, b in combinations(evaluation.rows, 2):
        pairs = PairedCounts.of_rows(evaluation.rows[a], evaluation.rows[b])
        lines.append((a, b, str(pairs.only_a), str(pairs.only_b), f"{pairs.p_value:.2g}"))
    table = markdown_table(PAIR_COLUMNS, lines)
    return f"\n## Pairs\n\n{table}\np: exact McNemar.\n" if lines else ""


def kinds_markdown(evaluation: Evaluation) -> str:
    """A table of recovered and survived by kind of push; nothing where all pushes are of one kind."""
    scenarios = evaluation.suite.scenarios
    groups = tuple(groups_of(scenarios))
    if not groups:
        return ""
    cells = {name: kind_cells(scenarios, rows) for name, rows in evaluation.rows.items()}
    lines = [(group, *(cells[name][group] for name in cells)) for group in groups]
    table = markdown_table(("kind of push", *cells), lines)
    return f"\n## Kinds of push\n\n{table}\nRecovered / survived.\n"


def effort_markdown(evaluation: Evaluation) -> str:
    """A table of what recovering took; nothing where no row tells."""
    cells = effort_cells(evaluation)
    return f"\n## Effort\n\n{markdown_table(EFFORT_COLUMNS, cells)}\n{EFFORT_NOTE}" if cells else ""


def limits_markdown(evaluation: Evaluation) -> str:
    """A table of the limits met for each policy; nothing where none was."""
    tables = {name: bound_cells(rows) for name, rows in evaluation.rows.items()}
    parts = [f"\n{name}\n\n{markdown_table(BOUND_COLUMNS, cells)}" for name, cells in tables.items() if cells]
    return f"\n## Limits\n{''.join(parts)}\n{NOTE}" if parts else ""
