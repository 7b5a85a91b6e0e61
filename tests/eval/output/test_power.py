"""A planted difference of 0.05 in 1024 pairs is found as often as theory says, and none as rarely."""

import math
from collections import Counter

import numpy as np
import pytest
from push_recovery.eval.output.statistics import PairedCounts, mcnemar_exact
from scipy import stats

PAIRS, REPETITIONS, LEVEL = 1024, 2000, 0.05
PLANTED = 0.05  # rate of a minus rate of b
BOTH = 0.5  # share of the pushes that both recover from, of those on which they agree
# Standard errors that a share of REPETITIONS may be off: one in 6000 of a right one is farther
FARTHEST = 3.8


def outcomes(only_a: float, only_b: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Two policies on PAIRS pushes, REPETITIONS times; the shares are what is planted."""
    u = np.random.default_rng(seed).random((REPETITIONS, PAIRS))
    both = (u >= only_a + only_b) & (u < only_a + only_b + BOTH * (1.0 - only_a - only_b))
    return both | (u < only_a), both | ((u >= only_a) & (u < only_a + only_b))


def share_found(only_a: float, only_b: float, seed: int) -> float:
    """How often the project's own counts and test say that the policies differ."""
    found = [PairedCounts.of(a, b) for a, b in zip(*outcomes(only_a, only_b, seed), strict=True)]
    tables = Counter((counts.only_a, counts.only_b) for counts in found)
    return sum(times for table, times in tables.items() if mcnemar_exact(*table) < LEVEL) / REPETITIONS


def exact_power(only_a: float, only_b: float) -> float:
    """Of the binomial test on the pairs that differ, over all tables: no normal approximation.

    The number m of pairs that differ is binomial, and so is that of a among them. The test of m pairs is
    two-sided with equal tails, so it rejects where twice the smaller tail is below LEVEL.
    """
    different = only_a + only_b
    power = 0.0
    low, high = stats.binom(PAIRS, different).interval(1.0 - 1e-9)
    for m in range(int(low), int(high) + 1):
        k = np.arange(m + 1)
        half = stats.binom(m, 0.5)
        rejected = 2.0 * np.minimum(half.cdf(k), half.sf(k - 1)) < LEVEL
        power += (
            stats.binom.pmf(m, PAIRS, different) * stats.binom.pmf(k, m, only_a / different)[rejected].sum()
        )
    return power


def asymptotic_power(only_a: float, only_b: float) -> float:
    """Connor (1987), Biometrics 43, 207-211: of McNemar's test without correction for continuity."""
    different, gain = only_a + only_b, only_a - only_b
    quantile = stats.norm.ppf(1.0 - LEVEL / 2.0)
    reach = abs(gain) * math.sqrt(PAIRS) - quantile * math.sqrt(different)
    return float(stats.norm.cdf(reach / math.sqrt(different - gain**2)))


def farthest(share: float) -> float:
    return FARTHEST * math.sqrt(share * (1.0 - share) / REPETITIONS)


@pytest.mark.parametrize(("different", "expected"), [(0.11, 0.998), (0.2, 0.943), (0.4, 0.700)])
def test_a_planted_difference_is_found_at_the_power_that_theory_gives(different, expected):
    only_a, only_b = (different + PLANTED) / 2.0, (different - PLANTED) / 2.0
    power = exact_power(only_a, only_b)
    assert power == pytest.approx(expected, abs=5e-4)  # as docs/evaluation.md states it
    assert power == pytest.approx(asymptotic_power(only_a, only_b), abs=0.02)
    assert share_found(only_a, only_b, seed=1) == pytest.approx(power, abs=farthest(power))


@pytest.mark.parametrize(("different", "expected"), [(0.11, 0.040), (0.2, 0.042), (0.4, 0.045)])
def test_no_difference_is_found_at_the_nominal_rate_at_most(different, expected):
    rate = exact_power(different / 2.0, different / 2.0)
    assert rate == pytest.approx(expected, abs=5e-4)
    assert LEVEL - 0.015 < rate <= LEVEL
    assert share_found(different / 2.0, different / 2.0, seed=3) == pytest.approx(rate, abs=farthest(rate))
