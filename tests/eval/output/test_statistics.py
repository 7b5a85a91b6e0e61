import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output.statistics import PairedCounts, mcnemar_exact, wilson_interval
from scipy.stats import binomtest


@pytest.mark.parametrize(("k", "n"), [(0, 7), (1, 1), (5, 20), (181, 256), (256, 256)])
def test_wilson_interval_is_scipys(k, n):
    expected = binomtest(k, n).proportion_ci(method="wilson")
    np.testing.assert_allclose(wilson_interval(k, n), (expected.low, expected.high), atol=1e-12)


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
    a = np.array([1, 1, 1, 0, 0], dtype=bool)
    b = np.array([1, 0, 0, 1, 0], dtype=bool)
    counts = PairedCounts.of(a, b)
    assert counts == PairedCounts(both=1, only_a=2, only_b=1, neither=1)
    assert counts.rate_difference == pytest.approx(a.mean() - b.mean())
    with pytest.raises(InvalidValueError, match="equal lengths"):
        PairedCounts.of(a, b[:3])


def test_bootstrap_interval_matches_resampling_of_pairs():
    rng = np.random.default_rng(0)
    a, b = rng.random(300) < 0.8, rng.random(300) < 0.7
    low, high = PairedCounts.of(a, b).bootstrap_interval()
    picks = rng.integers(300, size=(4000, 300))
    differences = a[picks].mean(axis=1) - b[picks].mean(axis=1)
    np.testing.assert_allclose((low, high), np.quantile(differences, [0.025, 0.975]), atol=0.01)
    assert PairedCounts.of(a, b).bootstrap_interval() == (low, high)
    assert PairedCounts.of(a, a).bootstrap_interval() == (0.0, 0.0)
