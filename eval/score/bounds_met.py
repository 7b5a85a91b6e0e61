"""Which bounds the falls of a policy met, beside those of the episodes it recovered from.

The keys of rows say `limit` for such a bound, as they did in all rows that were ever written.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...controllers.whole_body.bounds_met import BOUNDS
from ..rollout.outcome import Outcome

Row = Mapping[str, Any]
COLUMNS = (
    "limit",
    "first in falls",
    "met in falls",
    "time in falls",
    "met in recovered",
    "time in recovered",
)
NOTE = (
    "Limits count from the start of the first push on; docs/evaluation.md says what each is. First: falls "
    "that met it first. Met: share of the episodes that met it. Time: mean share of the time until the end.\n"
)


def bounds_of(rows: Iterable[Row]) -> dict[str, dict[str, float]]:
    """Bound -> how many rows met it first, what share of them met it, mean share of the time.

    Bounds that no row met are left out.
    """
    rows, found = list(rows), {}
    for name in BOUNDS:
        shares = [row.get("limit_shares", {}).get(name, 0.0) for row in rows]
        if any(shares):
            found[name] = {
                "first": sum(row.get("first_limit") == name for row in rows),
                "met": sum(share > 0.0 for share in shares) / len(rows),
                "time": sum(shares) / len(rows),
            }
    return found


def bound_summary(rows: Iterable[Row]) -> dict[str, dict[str, dict[str, float]]]:
    """`bounds_of` the falls and of the episodes that recovered."""
    rows = list(rows)
    return {
        "falls": bounds_of(row for row in rows if not row["survived"]),
        "recovered": bounds_of(row for row in rows if row["recovered"]),
    }


def bound_cells(rows: Iterable[Row]) -> list[tuple[str, ...]]:
    """One row of cells for each bound that was met, in COLUMNS."""
    summary = bound_summary(rows)
    falls, recovered = summary["falls"], summary["recovered"]
    nothing = {"first": 0, "met": 0.0, "time": 0.0}
    cells = []
    for name in BOUNDS:
        if name in falls or name in recovered:
            fell, stood = falls.get(name, nothing), recovered.get(name, nothing)
            numbers = fell["met"], fell["time"], stood["met"], stood["time"]
            cells.append((name, str(fell["first"]), *(f"{number:.2f}" for number in numbers)))
    return cells


def first_bounds(rows: Iterable[Row]) -> str:
    """Bounds that falls met first, the most frequent first, with their counts."""
    falls = bounds_of(row for row in rows if not row["survived"])
    counts = sorted(((-entry["first"], name) for name, entry in falls.items() if entry["first"]))
    return ", ".join(f"{name} {-count}" for count, name in counts) or "-"


def fall_bounds(force: float, outcome: Outcome) -> dict[str, Any]:
    """What a frontier's row keeps of a failed force [N]."""
    return {
        "force_N": force,
        "failure_reason": outcome.failure_reason,
        "first_limit": outcome.first_limit,
        "limits_met": dict(outcome.limits_met),
        "limit_shares": dict(outcome.limit_shares),
    }


def fall_cell(falls: Sequence[Row]) -> str:
    """Of the weakest force that failed: the bound met first, and the three met for the longest time."""
    if not falls or falls[0]["first_limit"] is None:
        return "-"
    shares = falls[0]["limit_shares"]
    longest = sorted(shares, key=lambda name: (-shares[name], BOUNDS.index(name)))[:3]
    return f"{falls[0]['first_limit']}; " + ", ".join(f"{name} {shares[name]:.2f}" for name in longest)
