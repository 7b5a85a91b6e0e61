"""An evaluation as tables: rates, kinds of push, effort, profiles.

What recovering took: medians over the pushes that all policies recover from, so that they compare.

Recovered and survived by kind of push: which body, how often, on which walk.

A kind is a question about a scenario; its answers split a suite into groups.

An evaluation as a table and as a report.

The same pushes on robots of several profiles, side by side: recovered and survived, and what is kept.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

from ...controllers.files import write_text
from ...envs.scenario.scenario import Scenario
from ..output.statistics import PairedCounts
from ..output.tables import markdown_table
from ..rollout.outcome import Score
from .draw import count_of, walk_of
from .evaluate import BOUNDS_NOTE, Evaluation, bound_cells, first_bounds
from .evaluate import COLUMNS as BOUND_COLUMNS

Row = Mapping[str, Any]
EFFORT_COLUMNS = (
    "policy", "recovered after [s]", "steps", "smallest margin [cm]", "largest lean [deg]",
    "peak torque [N m]", "mean torque [N m]", "energy [kJ]",
)  # fmt: skip
_SHOWN = {  # measure of a row -> factor to the unit of its column, digits
    "recovered_after": (1.0, 2), "steps": (1.0, 0), "smallest_margin": (100.0, 1),
    "trunk_excursion": (math.degrees(1.0), 1), "peak_torque": (1.0, 0), "mean_torque": (1.0, 1),
    "energy": (1e-3, 2),
}  # fmt: skip
MEASURED = tuple(_SHOWN)[1:]  # what only rows with measures tell
EFFORT_NOTE = (
    "Medians over the pushes that all policies recover from. Recovered after: from the end of the last push "
    "to the touchdown at which the recovery criterion holds. docs/evaluation.md says what each is.\n"
)
Summary = dict[str, float | None]


def effort_summary(evaluation: Evaluation) -> tuple[int, dict[str, Summary]]:
    """How many pushes all policies recover from, and medians over them by policy, in the rows' own units.

    None where no row tells of a measure, as of a pendulum's motors.
    """
    together = [pair for pair in evaluation.by_scenario() if all(row["recovered"] for row in pair[1])]
    found: dict[str, Summary] = {}
    for place, policy in enumerate(evaluation.rows):
        told = [
            {
                "recovered_after": recovered_after(rows[place], scenario.settle_time),
                **measures_of(rows[place]),
            }
            for scenario, rows in together
            if scenario.duration is None
        ]
        found[policy] = {name: _median([one.get(name) for one in told]) for name in _SHOWN}
    return len(together), found


def recovered_after(row: Row, settle_time: float) -> float | None:
    """Time from the end of the last push to recovery [s]; the episode ends `settle_time` after that push."""
    if row.get("recovered_at") is None:
        return None
    return max(row["recovered_at"] - (row["end_time"] - settle_time), 0.0)


def measures_of(row: Row) -> Mapping[str, float | None]:
    """The measures of a row; none of another robot's."""
    return row.get("measures", {})


def effort_cells(evaluation: Evaluation, labels: Mapping[str, str] | None = None) -> list[tuple[str, ...]]:
    """One row of cells for each policy, in COLUMNS; none where no row tells of any effort."""
    _, summary = effort_summary(evaluation)
    if all(value is None for one in summary.values() for name, value in one.items() if name in MEASURED):
        return []
    return [
        ((labels or {}).get(policy, policy), *(_cell(one[name], *look) for name, look in _SHOWN.items()))
        for policy, one in summary.items()
    ]


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.median(known) if known else None


def _cell(value: float | None, factor: float, digits: int) -> str:
    return "-" if value is None else f"{value * factor:.{digits}f}"


KINDS: dict[str, Callable[[Scenario], str]] = {
    "body": lambda scenario: " and ".join(sorted({push.body for push in scenario.pushes})) or "none",
    "count": count_of,
    "command": walk_of,
}


def groups_of(scenarios: Sequence[Scenario]) -> dict[str, tuple[str, ...]]:
    """Group -> ids of its scenarios, for each kind that has more than one group, in the order they come."""
    found: dict[str, tuple[str, ...]] = {}
    for answer in KINDS.values():
        groups: dict[str, list[str]] = {}
        for scenario in scenarios:
            groups.setdefault(answer(scenario), []).append(scenario.id)
        if len(groups) > 1:
            found |= {name: tuple(groups[name]) for name in sorted(groups)}
    return found


def kind_cells(scenarios: Sequence[Scenario], rows: Sequence[Row]) -> dict[str, str]:
    """Group -> "recovered / survived of scenarios", from the rows of one policy."""
    by_id = {row["scenario_id"]: row for row in rows}
    cells = {}
    for group, ids in groups_of(scenarios).items():
        inside = [by_id[name] for name in ids]
        recovered, survived = (sum(row[key] for row in inside) for key in ("recovered", "survived"))
        cells[group] = f"{recovered} / {survived} of {len(inside)}"
    return cells


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
    return f"\n## Limits\n{''.join(parts)}\n{BOUNDS_NOTE}" if parts else ""


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
