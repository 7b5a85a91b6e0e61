"""The same pushes on robots of several profiles, side by side: recovered and survived, and what is kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...controllers.files import write_text
from ..output.statistics import PairedCounts
from ..output.tables import markdown_table
from .evaluate import Evaluation
from .report import RECOVERED_NOTE, evaluation_title, rate_cells

KEPT_COLUMNS = ("policy", "recovers of its own", "survives of its own", "lost", "gained", "p")
Evaluations = Mapping[str, Evaluation]  # by profile, the first one what the others are held against


def profile_columns(evaluations: Evaluations) -> tuple[str, ...]:
    """Headings of `profile_cells`."""
    return ("policy", *(heading for name in evaluations for heading in (f"recovered, {name}", "survived")))


def profile_cells(evaluations: Evaluations) -> list[tuple[str, ...]]:
    """Rates of each policy, that of recovery with its Wilson interval, profile beside profile."""
    lines = []
    for policy in next(iter(evaluations.values())).rows:
        line = [policy]
        for evaluation in evaluations.values():
            score = evaluation.score(policy)
            rate, interval = rate_cells(score)
            line += [f"{rate} ({interval})", f"{score.survived / score.episodes:.3f}"]
        lines.append(tuple(line))
    return lines


def kept_cells(a: Evaluation, b: Evaluation) -> list[tuple[str, ...]]:
    """What each policy keeps under b of what it does under a, in KEPT_COLUMNS.

    Shares of its own number under a; lost and gained recoveries on the same pushes; exact McNemar p.
    """
    lines = []
    for policy in a.rows:
        pairs = PairedCounts.of_rows(a.rows[policy], b.rows[policy])
        before, after = a.score(policy), b.score(policy)
        shares = (after.recovered, before.recovered), (after.survived, before.survived)
        kept = [f"{new / old:.3f}" if old else "-" for new, old in shares]
        counts = str(pairs.only_a), str(pairs.only_b)
        lines.append((policy, *kept, *counts, f"{pairs.p_value:.2g}"))
    return lines


def profiles_markdown(evaluations: Evaluations) -> str:
    """The page: rates side by side, then each profile held against the first."""
    (first, base), *others = evaluations.items()
    parts = [
        f"# Profiles\n\n{evaluation_title(base)}\n\n"
        f"{markdown_table(profile_columns(evaluations), profile_cells(evaluations))}\n{RECOVERED_NOTE}"
    ]
    parts += [
        f"\n## {name} against {first}\n\n{markdown_table(KEPT_COLUMNS, kept_cells(base, evaluation))}"
        for name, evaluation in others
    ]
    return "".join(parts)


def write_profiles(evaluations: Evaluations, directory: Path) -> Path:
    """Write profiles.md into a directory; returns its path."""
    path = directory / "profiles.md"
    write_text(path, profiles_markdown(evaluations))
    return path
