"""What differs between the robot that something was made for and another one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

CLOSE = 1e-9  # relative difference of numbers that count as one


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """The entries of two records that differ, as "mass 60 there and 33.3 here"; empty where none does.

    Entries that only one of them has are left out.
    """
    found = [
        f"{name} {_short(value)} there and {_short(here[name])} here"
        for name, value in there.items()
        if name in here and not _same(value, here[name])
    ]
    return ", ".join(found)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, bool) or not isinstance(one, int | float) or not isinstance(other, int | float):
        return bool(one == other)
    return abs(one - other) <= CLOSE * max(abs(one), abs(other))


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
