"""An evaluation as a table and as a report."""

from __future__ import annotations

from ..output.tables import markdown_table
from ..rollout.outcome import Score
from .bounds_met import COLUMNS as BOUND_COLUMNS
from .bounds_met import NOTE, bound_cells, first_bounds
from .evaluate import SUBSET, Evaluation
from .kinds import groups_of, kind_cells

COLUMNS = (
    "policy",
    "recovered",
    "rate",
    "95 % interval",
    f"rate {SUBSET[0]:g}-{SUBSET[1]:g} N s",
    "survived",
    "not recovered",
    "first limit of the falls",
)


def rate_cells(score: Score) -> tuple[str, str]:
    """Rate and Wilson interval as text."""
    low, high = score.ci95
    return f"{score.rate:.3f}", f"{low:.3f}-{high:.3f}"


def evaluation_cells(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """One row of cells for each policy, in COLUMNS."""
    cells = []
    for name in evaluation.rows:
        score, subset = evaluation.score(name), evaluation.subset_score(name)
        low, high = subset.ci95
        part = f"{subset.rate:.3f} ({low:.3f}-{high:.3f})" if subset.episodes else "-"
        reasons = ", ".join(f"{reason} {count}" for reason, count in score.failures.items()) or "-"
        counts = f"{score.recovered}/{score.episodes}"
        met = first_bounds(evaluation.rows[name])
        cells.append((name, counts, *rate_cells(score), part, str(score.survived), reasons, met))
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
    note = (
        "Recovered: no fall until 4 s after the last push; over the last two steps DCM offset within 5 cm "
        "of nominal and mean velocity within 0.15 m/s of the command. Intervals: Wilson, 95 %.\n"
    )
    table = markdown_table(COLUMNS, evaluation_cells(evaluation))
    parts = f"{kinds_markdown(evaluation)}{limits_markdown(evaluation)}"
    return f"# Evaluation\n\n{evaluation_title(evaluation)}\n\n{table}\n{note}{parts}"


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


def limits_markdown(evaluation: Evaluation) -> str:
    """A table of the limits met for each policy; nothing where none was."""
    tables = {name: bound_cells(rows) for name, rows in evaluation.rows.items()}
    parts = [f"\n{name}\n\n{markdown_table(BOUND_COLUMNS, cells)}" for name, cells in tables.items() if cells]
    return f"\n## Limits\n{''.join(parts)}\n{NOTE}" if parts else ""
