"""Tables of a protocol: this robot's policies, and the published rows under them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from ...controllers.files import write_text
from ..output.statistics import wilson_interval
from ..output.tables import markdown_table
from .kick import LEVELS, jump_of
from .published import KICK_ROWS, TOUR_ROWS, kick_note, tour_note
from .run import Results, Row
from .tour import LENGTH

FORMS = {
    "stated": "8 directions in turn, horizontal jumps of the velocity, as the paper says",
    "coded": "direction uniform, jumps with a vertical part of -0.1 to 0.2, as the program does",
    "force": "a force on the pelvis for 0.1 s with the impulse of the jump, 8 directions in turn",
}
TOUR_COLUMNS = (
    "policy",
    "runs",
    "completed",
    "95 % interval",
    "survival [s]",
    "position [cm]",
    "heading [deg]",
)
STOOD = "Share without a fall by RecoverFormer's criterion, % (Wilson, 95 %)"
RATES = {"stood": STOOD, "survived": "Survived by this project's criterion, %", "recovered": "Recovered, %"}
MEANS = {
    "time_to_stable": "Time to a base slower than 0.15 m/s [s], mean",
    "peak_tilt_deg": "Largest tilt of the trunk [degrees], mean",
}
KICK_CRITERION = (
    "By RecoverFormer's criterion an episode of 10 s is lost where the pelvis comes below 0.38 of its "
    "standing height or the trunk leans by more than 1.2 rad. Its time to stable is of little use for a "
    "robot that steps in place, whose base sways.\n"
)


def level_of(row: Row) -> int:
    """The level of a row, by its force on the G1 [N]."""
    return int(row["scenario_id"].split("-")[-2])


def rate_cell(count: int, of: int) -> str:
    """Percentage with its Wilson interval."""
    low, high = wilson_interval(count, of)
    return f"{100 * count / of:.1f} ({100 * low:.1f}-{100 * high:.1f})" if of else "-"


def kick_columns(results: Results, key: str) -> tuple[str, ...]:
    """Headings of `kick_cells`."""
    return ("level", *results.rows, *(KICK_ROWS if key == "stood" else ()))


def kick_cells(results: Results, key: str) -> list[tuple[str, ...]]:
    """A rate or a mean of each policy, level by level; beside rates of `stood`, the published ones."""
    cells, shown = [], _share if key in RATES else _mean
    for force in LEVELS:
        own = [shown([row[key] for row in rows if level_of(row) == force]) for rows in results.rows.values()]
        theirs = [f"{row[force]:.1f}" if force in row else "-" for row in KICK_ROWS.values()]
        label = f"{jump_of(force):.3f} m/s, {force} N on the G1"
        cells.append((label, *own, *(theirs if key == "stood" else ())))
    return cells


def _share(values: Sequence[Any]) -> str:
    return rate_cell(sum(values), len(values))


def _mean(values: Iterable[Any]) -> str:
    values = list(values)
    return f"{fmean(values):.2f}" if values else "-"


def kick_title(results: Results) -> str:
    """What was run, in one line."""
    each = len(results.protocol.scenarios) // len(LEVELS)
    return f"{results.env_id}: kick, {results.protocol.form}, {each} episodes a level{_collisions(results)}"


def kick_markdown(results: Results) -> str:
    """The report of `kick`."""
    parts = [f"# Kick\n\n{kick_title(results)}: {FORMS[results.protocol.form]}.\n"]
    parts += [
        f"\n## {text}\n\n{markdown_table(kick_columns(results, key), kick_cells(results, key))}"
        for key, text in (RATES | MEANS).items()
    ]
    return "".join([*parts, f"\n{KICK_CRITERION}\n{kick_note(results.protocol.robot)}"])


def kick_summary(rows: Sequence[Row]) -> dict[str, dict[str, Any]]:
    """Level -> counts, rate and means of one policy."""
    found = {}
    for force in LEVELS:
        level = [row for row in rows if level_of(row) == force]
        if level:
            counts = {key: sum(row[key] for row in level) for key in RATES}
            means = {key: fmean(row[key] for row in level) for key in MEANS}
            interval = list(wilson_interval(counts["stood"], len(level)))
            found[str(force)] = {
                "jump": jump_of(force), "episodes": len(level), **counts, "ci95": interval, **means
            }  # fmt: skip
    return found


def tour_summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Completed tours, mean survival, and errors over all segments that were begun."""
    completed = sum(row["survived"] for row in rows)
    return {
        "runs": len(rows),
        "completed": completed,
        "ci95": list(wilson_interval(completed, len(rows))),
        "survival_s": fmean(min(row["end_time"], LENGTH) for row in rows),
        "position_error_cm": fmean(error for row in rows for error in row["position_errors_cm"]),
        "heading_error_deg": fmean(error for row in rows for error in row["heading_errors_deg"]),
    }


def tour_cells(results: Results) -> list[tuple[str, ...]]:
    """One row of cells for each policy, then the published ones, both engines."""
    cells = []
    for name, rows in results.rows.items():
        told = tour_summary(rows)
        low, high = told["ci95"]
        errors = f"{told['position_error_cm']:.1f}", f"{told['heading_error_deg']:.1f}"
        share, interval = (
            f"{100 * told['completed'] / told['runs']:.1f} %",
            f"{100 * low:.1f}-{100 * high:.1f}",
        )
        cells.append((name, str(told["runs"]), share, interval, f"{told['survival_s']:.1f}", *errors))
    for name, row in TOUR_ROWS.items():
        both = ("{}/{}".format(*pair) for pair in (row.survival, row.position, row.heading))
        completed = "{}/{} %".format(*row.completed)
        cells.append((f"{name} (published)", str(row.runs), completed, "", *both))
    return cells


def tour_title(results: Results) -> str:
    """What was run, in one line."""
    return f"{results.env_id}: tour, run ids 0-{len(results.protocol.scenarios) - 1}{_collisions(results)}"


def _collisions(results: Results) -> str:
    return ", bodies collide" if results.protocol.collisions else ""


def tour_markdown(results: Results) -> str:
    """The report of `tour`."""
    table, note = markdown_table(TOUR_COLUMNS, tour_cells(results)), tour_note(results.protocol.robot)
    return f"# Tour\n\n{tour_title(results)}; published rows in MuJoCo / PhysX.\n\n{table}\n{note}"


def to_dict(results: Results) -> dict[str, Any]:
    """One JSON object of the results."""
    summary: Callable[[Sequence[Row]], dict[str, Any]] = (
        kick_summary if results.protocol.name == "kick" else tour_summary
    )
    return {
        "protocol": results.protocol.summary() | {"collisions": results.protocol.collisions},
        "env": results.env_id,
        "policies": {name: summary(rows) for name, rows in results.rows.items()},
        "out": str(results.directory),
    }


def write_reports(results: Results) -> Path:
    """Write report.json and report.md into the directory; returns the path of the latter."""
    write_text(results.directory / "report.json", json.dumps(to_dict(results), indent=1) + "\n")
    path = results.directory / "report.md"
    write_text(path, (kick_markdown if results.protocol.name == "kick" else tour_markdown)(results))
    return path
