"""Statistics of success counts: Wilson's and Newcombe's score intervals, exact McNemar test."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % Wilson score interval of a proportion (Wilson 1927); (0, 1) without trials.

    (p + z^2/2n +- z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n) with p = successes / trials.

    Raises:
        InvalidValueError: more successes than trials, or fewer than none.
    """
    if not 0 <= successes <= trials:
        raise InvalidValueError(f"successes must be in [0, trials = {trials}], got {successes}")
    if trials == 0:
        return (0.0, 1.0)
    from scipy.stats import binomtest

    interval = binomtest(successes, trials).proportion_ci(confidence_level=0.95, method="wilson")
    return (float(interval.low), float(interval.high))


def newcombe_interval(both: int, only_a: int, only_b: int, neither: int) -> tuple[float, float]:
    """95 % score interval of a difference of paired proportions, rate of a minus rate of b.

    Newcombe (1998), Statistics in Medicine 17, 2635-2650, method 10: the Wilson intervals (l, u) of both
    rates p, their distances squared and added with the correlation phi of the pairs,

        D - sqrt((p_a - l_a)^2 - 2 phi (p_a - l_a)(u_b - p_b) + (u_b - p_b)^2)   to
        D + sqrt((u_a - p_a)^2 - 2 phi (u_a - p_a)(p_b - l_b) + (p_b - l_b)^2),  D = p_a - p_b,

    phi = (both neither - only_a only_b) / sqrt(product of the four margins), where a positive numerator loses
    half the number of pairs, but not its sign; 0 where a margin is. (-1, 1) without pairs.

    Raises:
        InvalidValueError: a negative count.
    """
    if min(both, only_a, only_b, neither) < 0:
        raise InvalidValueError(f"counts of pairs must be >= 0, got {both}, {only_a}, {only_b}, {neither}")
    pairs = both + only_a + only_b + neither
    if pairs == 0:
        return (-1.0, 1.0)
    succeeded_a, succeeded_b = both + only_a, both + only_b
    margins = succeeded_a * (pairs - succeeded_a) * succeeded_b * (pairs - succeeded_b)
    together = float(both * neither - only_a * only_b)
    together = max(together - pairs / 2, 0.0) if together > 0 else together
    phi = together / math.sqrt(margins) if margins else 0.0
    below_a, above_a = _distances(succeeded_a, pairs)
    below_b, above_b = _distances(succeeded_b, pairs)
    difference = (only_a - only_b) / pairs
    return (
        difference - math.sqrt(below_a**2 - 2 * phi * below_a * above_b + above_b**2),
        difference + math.sqrt(above_a**2 - 2 * phi * above_a * below_b + below_b**2),
    )


def _distances(successes: int, trials: int) -> tuple[float, float]:
    """How far the Wilson interval reaches below and above the share of successes."""
    low, high = wilson_interval(successes, trials)
    return successes / trials - low, high - successes / trials


def mcnemar_exact(only_a: int, only_b: int) -> float:
    """Two-sided exact McNemar p-value: binomial test of the discordant pairs against 1/2; 1 without any."""
    if only_a + only_b == 0:
        return 1.0
    from scipy.stats import binomtest

    return float(binomtest(only_a, only_a + only_b, 0.5).pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """The p values corrected for being several (Holm 1979), in the order given.

    Sorted rising, the i-th of m (from 0) becomes the largest of (m - k) p_k over k <= i, and 1 at most: the
    chance that any of them is below 0.05 without a difference is 0.05 at most, however they hang together.
    """
    order = np.argsort(p_values, kind="stable")
    scaled = np.asarray(p_values, dtype=np.float64)[order] * np.arange(len(order), 0, -1)
    found = np.empty(len(order))
    found[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return found.tolist()


@dataclass(frozen=True)
class PairedCounts:
    """Successes of two policies on the same scenarios."""

    both: int
    only_a: int
    only_b: int
    neither: int

    @classmethod
    def of(cls, a: NDArray[np.bool_], b: NDArray[np.bool_]) -> PairedCounts:
        """Count pairs from two (n,) arrays in the same order of scenarios."""
        if a.shape != b.shape:
            raise InvalidValueError(f"pairs need equal lengths, got {a.shape} and {b.shape}")
        return cls(int(np.sum(a & b)), int(np.sum(a & ~b)), int(np.sum(~a & b)), int(np.sum(~a & ~b)))

    @classmethod
    def of_rows(
        cls, a: Sequence[Mapping[str, Any]], b: Sequence[Mapping[str, Any]], field: str = "recovered"
    ) -> PairedCounts:
        """Count pairs of a field of rows in the same order of scenarios."""
        first, second = (np.array([row[field] for row in rows], dtype=bool) for rows in (a, b))
        return cls.of(first, second)

    @property
    def pairs(self) -> int:
        """Number of scenarios."""
        return self.both + self.only_a + self.only_b + self.neither

    @property
    def rate_difference(self) -> float:
        """Success rate of a minus that of b."""
        return (self.only_a - self.only_b) / self.pairs if self.pairs else 0.0

    @property
    def p_value(self) -> float:
        """Exact McNemar."""
        return mcnemar_exact(self.only_a, self.only_b)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % score interval of the rate difference; (-1, 1) without scenarios."""
        return newcombe_interval(self.both, self.only_a, self.only_b, self.neither)
