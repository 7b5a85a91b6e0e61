"""Recovered and survived by kind of push: which body, how often, on which walk.

A kind is a question about a scenario; its answers split a suite into groups.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ...envs.scenario.scenario import Scenario
from .varied import count_of, walk_of

Row = Mapping[str, Any]
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
