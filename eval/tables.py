"""Tables for terminals and reports."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .evaluate import SUBSET, Evaluation
from .limit_summary import COLUMNS as LIMIT_COLUMNS
from .limit_summary import NOTE, first_limits, limit_cells
from .outcome import Score

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
        met = first_limits(evaluation.rows[name])
        cells.append((name, counts, *rate_cells(score), part, str(score.survived), reasons, met))
    return cells


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


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
    return f"# Evaluation\n\n{evaluation_title(evaluation)}\n\n{table}\n{note}{limits_markdown(evaluation)}"


def limits_markdown(evaluation: Evaluation) -> str:
    """A table of the limits met for each policy; nothing where none was."""
    tables = {name: limit_cells(rows) for name, rows in evaluation.rows.items()}
    parts = [f"\n{name}\n\n{markdown_table(LIMIT_COLUMNS, cells)}" for name, cells in tables.items() if cells]
    return f"\n## Limits\n{''.join(parts)}\n{NOTE}" if parts else ""


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on standard output; brackets are units here, no markup."""
    table = Table(title=escape(title), title_justify="left")
    for index, column in enumerate(columns):
        table.add_column(escape(column), overflow="fold" if index in {0, len(columns) - 1} else "ellipsis")
    for row in rows:
        table.add_row(*map(escape, row))
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)
    console.print(table)
