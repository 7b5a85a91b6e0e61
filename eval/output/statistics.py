"""Statistics of success counts: Wilson intervals, exact McNemar test, paired bootstrap."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError

Z_95 = 1.959963984540054  # 97.5 % quantile of the standard normal
BOOTSTRAP_SEED = 20180609


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % Wilson score interval of a proportion (Wilson 1927); (0, 1) without trials.

    (p + z^2/2n +- z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n) with p = successes / trials.
    """
    if not 0 <= successes <= trials:
        raise InvalidValueError(f"successes must be in [0, trials = {trials}], got {successes}")
    if trials == 0:
        return (0.0, 1.0)
    p, n, z2 = successes / trials, trials, Z_95**2
    centre = p + z2 / (2 * n)
    half = Z_95 * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    low, high = (centre - half) / (1 + z2 / n), (centre + half) / (1 + z2 / n)
    return (0.0 if successes == 0 else low, 1.0 if successes == trials else high)


def mcnemar_exact(only_a: int, only_b: int) -> float:
    """Two-sided exact McNemar p-value: binomial test of the discordant pairs against 1/2; 1 without any."""
    if only_a + only_b == 0:
        return 1.0
    from scipy.stats import binomtest

    return float(binomtest(only_a, only_a + only_b, 0.5).pvalue)


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

    def bootstrap_interval(self, resamples: int = 10_000) -> tuple[float, float]:
        """95 % percentile interval of the rate difference over resampled scenarios (paired, fixed seed).

        Resampling n pairs with replacement is one multinomial draw of the four counts.
        """
        n = self.pairs
        if n == 0:
            return (0.0, 0.0)
        shares = np.array([self.both, self.only_a, self.only_b, self.neither]) / n
        draws = np.random.default_rng(BOOTSTRAP_SEED).multinomial(n, shares, size=resamples)
        low, high = np.quantile((draws[:, 1] - draws[:, 2]) / n, [0.025, 0.975])
        return (float(low), float(high))
