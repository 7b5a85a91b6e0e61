"""A scan of pushes: strengths of a grid, weakest first, until enough past the first failure is known.

Survival is not monotone in the strength: beyond the first failure there may be islands that are survived.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from ...controllers.errors import InvalidValueError

BEYOND = 100.0  # how far past the first failure a direction is scanned [N]
FORCE_CAP = 4000.0  # no scan goes further [N]
NOMINAL_STEPS = 4  # before the push
TOLERANCE = 1e-9  # of strengths that are multiples of a grid
T = TypeVar("T")


@dataclass(frozen=True)
class Scanned:
    """What a scan found, in the unit of its strengths."""

    survived: float  # largest before the first failure; 0 where none was survived
    largest_survived: float  # at all
    failed: tuple[float, ...]  # rising

    @classmethod
    def of(cls, survives: Mapping[float, bool]) -> Scanned:
        """From whether each strength was survived."""
        failed = tuple(sorted(strength for strength, ok in survives.items() if not ok))
        survived = [strength for strength, ok in survives.items() if ok]
        before = [strength for strength in survived if not failed or strength < failed[0]]
        return cls(max(before, default=0.0), max(survived, default=0.0), failed)


def scan_upwards(
    run: Callable[[Iterator[float]], Iterable[tuple[float, T]]],
    strengths: Iterable[float],
    beyond: float,
    survived: Callable[[T], bool],
) -> dict[float, T]:
    """Outcomes of rising strengths up to `beyond` past the first failure, in rising order.

    Several may run at once, so that a weaker one fails late; what was tried past the end that it sets is left
    out. So what comes out does not depend on how many run at once.

    Args:
        run: takes strengths when it has room for them; gives (strength, outcome) in any order.
        strengths: rising.
        beyond: in their unit.
        survived: whether an outcome counts as survived.
    """
    end, found = float("inf"), {}

    def wanted() -> Iterator[float]:
        for strength in strengths:
            if strength > end + TOLERANCE:
                return
            yield strength

    for strength, outcome in run(wanted()):
        found[strength] = outcome
        if not survived(outcome):
            end = min(end, strength + beyond)
    return {strength: found[strength] for strength in sorted(found) if strength <= end + TOLERANCE}


def multiples(grid: float) -> Iterator[float]:
    """The multiples of a grid [N] from the first up to FORCE_CAP."""
    return (k * grid for k in range(1, int(FORCE_CAP / grid + TOLERANCE) + 1))


def directions_deg(count: int) -> list[float]:
    """`count` directions counter-clockwise from forward [deg].

    Raises:
        InvalidValueError: fewer than one.
    """
    if count < 1:
        raise InvalidValueError(f"directions must be >= 1, got {count}")
    return [360.0 * k / count for k in range(count)]
