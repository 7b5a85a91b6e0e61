"""The frontier as a table and as a report, with the limits that the first failures met."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ...controllers.files import write_text
from ..output.tables import markdown_table
from ..score.bounds_met import fall_cell
from .scan import Frontier

NOTE = (
    "Largest force before the first failure [N] (share of F* of the robot's own box, of the paper's; largest "
    "survived at all). The paper's box is that of its Tables I and II. Falls by: the bound "
    "that the first failure met first, then the three that it met for the longest share of the time.\n"
)


def frontier_columns(frontier: Frontier) -> tuple[str, ...]:
    """Headings of `frontier_cells`."""
    names = list(frontier.rows)
    falls = ["falls by"] if len(names) == 1 else [f"{name} falls by" for name in names]
    return ("psi [deg]", "own F* [N]", "paper's F* [N]", *names, *falls)


def frontier_cells(frontier: Frontier) -> list[tuple[str, ...]]:
    """One row of cells for each direction."""
    objects = {name: frontier.to_dict(name)["directions"] for name in frontier.rows}
    cells = []
    for index, (psi, limit) in enumerate(frontier.limits.items()):
        forces = [_force_cell(entries[index]) for entries in objects.values()]
        falls = [fall_cell(rows[index]["falls"]) for rows in frontier.rows.values()]
        cells.append((f"{psi:g}", f"{limit.own:.0f}", f"{limit.paper:.0f}", *forces, *falls))
    return cells


def _force_cell(entry: dict[str, Any]) -> str:
    """Force before the first failure, its shares of both F*, and the largest survived where that is more."""
    shares = (entry["own_fraction"], entry["fraction"])
    share = ", ".join("-" if part is None else f"{part:.2f}" for part in shares)
    more = entry["largest_survived_N"]
    return f"{entry['survived_N']:.0f} ({share}" + (f"; {more:.0f})" if more > entry["survived_N"] else ")")


def write_frontier_reports(frontier: Frontier, title: str) -> Path:
    """Write report.md, whose path is returned, and report.json, with the limits of every failed force."""
    policies = {}
    for name, rows in frontier.rows.items():
        policies[name] = frontier.to_dict(name)
        for entry, row in zip(policies[name]["directions"], rows, strict=True):
            entry["falls"] = row["falls"]
    write_text(frontier.directory / "report.json", json.dumps({"policies": policies}, indent=1) + "\n")
    table = markdown_table(frontier_columns(frontier), frontier_cells(frontier))
    path = frontier.directory / "report.md"
    write_text(path, f"# Frontier\n\n{title}\n\n{table}\n{NOTE}")
    return path
