"""What recovering took: medians over the pushes that all policies recover from, so that they compare."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from .evaluate import Evaluation

Row = Mapping[str, Any]
COLUMNS = (
    "policy", "recovered after [s]", "steps", "smallest margin [cm]", "largest lean [deg]",
    "peak torque [N m]", "mean torque [N m]", "energy [kJ]",
)  # fmt: skip
_SHOWN = {  # measure of a row -> factor to the unit of its column, digits
    "recovered_after": (1.0, 2), "steps": (1.0, 0), "smallest_margin": (100.0, 1),
    "trunk_excursion": (math.degrees(1.0), 1), "peak_torque": (1.0, 0), "mean_torque": (1.0, 1),
    "energy": (1e-3, 2),
}  # fmt: skip
MEASURED = tuple(_SHOWN)[1:]  # what only rows with measures tell
NOTE = (
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
