import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output import statistics
from push_recovery.eval.output.statistics import (
    PairedCounts,
    mcnemar_exact,
    newcombe_interval,
    wilson_interval,
)
from scipy.stats import multinomial


def test_wilson_interval_without_trials_and_bad_counts():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    with pytest.raises(InvalidValueError, match=r"\[0, trials = 3\]"):
        wilson_interval(4, 3)


def test_mcnemar_is_the_two_sided_sign_test():
    assert mcnemar_exact(0, 0) == 1.0
    assert mcnemar_exact(5, 5) == 1.0
    assert mcnemar_exact(0, 10) == pytest.approx(2 * 0.5**10)
    assert mcnemar_exact(3, 9) == mcnemar_exact(9, 3)


def test_paired_counts():
    a = np.array([1, 1, 1, 0, 0, 1, 1, 0, 1, 1], dtype=bool)
    b = np.array([1, 0, 0, 1, 0, 1, 1, 1, 1, 0], dtype=bool)
    counts = PairedCounts.of(a, b)
    assert counts == PairedCounts(both=4, only_a=3, only_b=2, neither=1)
    assert counts.rate_difference == pytest.approx(a.mean() - b.mean())
    with pytest.raises(InvalidValueError, match="equal lengths"):
        PairedCounts.of(a, b[:3])


# counts (both, only a, only b, neither), then the interval as printed
PUBLISHED = [
    ((36, 12, 2, 0), (0.0569, 0.3404), 5e-5),  # Newcombe (1998), Statistics in Medicine 17, 2635-2650
    ((59, 6, 16, 80), (-0.1186, -0.0046), 5e-5),  # Cavo 2012, in the R package contingencytables
    ((1, 1, 7, 12), (-0.507, -0.026), 5e-4),  # Bentur 2009, in Fagerland, Lydersen and Laake (2014)
]


@pytest.mark.parametrize(("counts", "expected", "tolerance"), PUBLISHED)
def test_newcombe_interval_is_the_published_one(counts, expected, tolerance):
    np.testing.assert_allclose(newcombe_interval(*counts), expected, rtol=0, atol=tolerance)


def test_newcombe_interval_where_all_pairs_agree():
    """Wilson's bound of 0 of n is z^2 / (n + z^2); with phi = 0 the squares of both bounds add."""
    bound = 1.959963984540054**2 / (256 + 1.959963984540054**2)
    np.testing.assert_allclose(newcombe_interval(0, 0, 0, 256), (-bound, bound), atol=1e-12)
    np.testing.assert_allclose(newcombe_interval(256, 0, 0, 0), (-bound, bound), atol=1e-12)
    assert newcombe_interval(0, 0, 0, 0) == (-1.0, 1.0)
    low, high = newcombe_interval(0, 9, 0, 0)
    bound = 1.959963984540054**2 / (9 + 1.959963984540054**2)
    assert high == pytest.approx(1.0)
    assert low == pytest.approx(1.0 - np.sqrt(2.0) * bound)


def test_newcombe_interval_refuses_negative_counts():
    with pytest.raises(InvalidValueError, match="must be >= 0"):
        newcombe_interval(3, -1, 0, 0)


@pytest.mark.parametrize("counts", [(200, 5, 0, 51), (20, 3, 11, 6), (5, 1, 1, 0), (0, 30, 2, 1)])
def test_newcombe_interval_changes_sign_with_its_policies(counts):
    both, only_a, only_b, neither = counts
    low, high = newcombe_interval(*counts)
    np.testing.assert_allclose(newcombe_interval(both, only_b, only_a, neither), (-high, -low), atol=1e-15)
    np.testing.assert_allclose(newcombe_interval(neither, only_b, only_a, both), (-high, -low), atol=1e-12)
    assert -1.0 <= low < (only_a - only_b) / sum(counts) < high <= 1.0


def test_few_discordant_pairs_leave_the_difference_open():
    """5 : 0 of 256, where the exact test has p = 0.06: the percentile bootstrap gave 0.004 to 0.039."""
    low, high = newcombe_interval(200, 5, 0, 51)
    assert mcnemar_exact(5, 0) == pytest.approx(0.0625)
    assert low < 0.0
    assert high > 0.040


def test_newcombe_interval_covers_as_it_says_by_enumeration():
    """Exact coverage with 30 pairs: the probability of all tables whose interval holds the difference."""
    n = 30
    tables = [
        (both, a, b, n - both - a - b)
        for both in range(n + 1)
        for a in range(n + 1 - both)
        for b in range(n + 1 - both - a)
    ]
    wilson = {k: wilson_interval(k, n) for k in range(n + 1)}
    with pytest.MonkeyPatch.context() as patch:  # the same 31 intervals many times over
        patch.setattr(statistics, "wilson_interval", lambda k, _: wilson[k])
        limits = np.array([newcombe_interval(*table) for table in tables])
    coverage = []
    for only_a in (0.02, 0.1, 0.2, 0.35):
        for only_b in (0.01, 0.05, 0.15):
            for share in (0.3, 0.8):  # of the rest, both
                rest = 1.0 - only_a - only_b
                cells = [share * rest, only_a, only_b, (1 - share) * rest]
                weights = multinomial(n, cells).pmf(np.array(tables))
                inside = (limits[:, 0] <= only_a - only_b) & (only_a - only_b <= limits[:, 1])
                coverage.append(weights[inside].sum())
    assert min(coverage) > 0.94
    assert 0.95 < np.mean(coverage) < 0.975


# Newcombe (1998), Statistics in Medicine 17, 857-872, table I, method 3
@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_interval_is_the_published_one(k, n, low, high):
    np.testing.assert_allclose(wilson_interval(k, n), (low, high), rtol=0, atol=5e-5)


def test_paired_counts_give_their_interval():
    assert PairedCounts(both=1, only_a=1, only_b=7, neither=12).interval == newcombe_interval(1, 1, 7, 12)
    assert PairedCounts(0, 0, 0, 0).interval == (-1.0, 1.0)


def test_holm_corrects_in_steps():
    """Of statsmodels 0.15, multipletests(method="holm")."""
    assert statistics.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert statistics.holm([0.6, 0.9]) == [1.0, 1.0]
    assert statistics.holm([0.02]) == [0.02]
    assert statistics.holm([]) == []
