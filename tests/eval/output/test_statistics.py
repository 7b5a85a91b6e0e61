"""Statistics against published values, statsmodels 0.15 (written down here), scipy and their definitions.

A planted difference of 0.05 in 1024 pairs is found as often as theory says, and none as rarely.
"""

import math
from collections import Counter
from itertools import product

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output import statistics
from push_recovery.eval.output.statistics import (
    PairedCounts,
    bootstrap_interval,
    fit_logistic,
    kaplan_meier,
    mcnemar_exact,
    newcombe_interval,
    wilson_interval,
)
from scipy import stats


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
    assert counts.interval == newcombe_interval(4, 3, 2, 1)
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
    assert low < 0.0 < 0.040 < high


def test_newcombe_interval_covers_as_it_says_by_enumeration():
    """Exact coverage with 30 pairs: the probability of all tables whose interval holds the difference."""
    n = 30
    counts = product(range(n + 1), repeat=3)
    tables = [(both, a, b, n - both - a - b) for both, a, b in counts if both + a + b <= n]
    wilson = {k: wilson_interval(k, n) for k in range(n + 1)}
    with pytest.MonkeyPatch.context() as patch:  # the same 31 intervals many times over
        patch.setattr(statistics, "wilson_interval", lambda k, _: wilson[k])
        limits = np.array([newcombe_interval(*table) for table in tables])
    coverage = []
    for only_a, only_b, share in product((0.02, 0.1, 0.2, 0.35), (0.01, 0.05, 0.15), (0.3, 0.8)):
        rest = 1.0 - only_a - only_b  # a share of which is both
        weights = stats.multinomial(n, [share * rest, only_a, only_b, (1 - share) * rest]).pmf(tables)
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
    assert wilson_interval(0, 0) == (0.0, 1.0)
    with pytest.raises(InvalidValueError, match=r"\[0, trials = 3\]"):
        wilson_interval(4, 3)


def test_holm_corrects_in_steps():
    """Of statsmodels 0.15, multipletests(method="holm")."""
    assert statistics.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert statistics.holm([0.6, 0.9]) == [1.0, 1.0]
    assert statistics.holm([0.02]) == [0.02]
    assert statistics.holm([]) == []


# O-rings of 23 flights of the Space Shuttle by temperature [degrees F] (Dalal, Fowlkes and Hoadley 1989)
TEMPERATURE = [66, 70, 69, 68, 67, 72, 73, 70, 57, 63, 70, 78, 67, 53, 67, 75, 70, 81, 76, 79, 75, 76, 58]
DISTRESS = [0, 1, 0, 0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 1]
# Male budworms killed of 20 at each log2 dose (Collett 1991, Venables and Ripley 2002, section 7.2)
DOSE = np.repeat(range(6), 20)
KILLED = np.concatenate([[1] * n + [0] * (20 - n) for n in (1, 4, 9, 13, 18, 20)])


def test_the_published_fit_of_the_o_rings():
    fit = fit_logistic(TEMPERATURE, DISTRESS)
    assert fit is not None
    np.testing.assert_allclose([fit.intercept, fit.slope], [15.0429, -0.2322], atol=5e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), [7.3786, 0.1082], atol=5e-5)


def test_fit_and_band_are_those_of_statsmodels():
    fit = fit_logistic(DOSE, KILLED)
    assert fit is not None
    np.testing.assert_allclose([fit.intercept, fit.slope], [-2.81855497, 1.25894942], atol=1e-7)
    np.testing.assert_allclose(
        fit.covariance, [[0.30028956, -0.10267712], [-0.10267712, 0.04497177]], atol=1e-7
    )
    at = [0.0, 2.0, 5.0]
    np.testing.assert_allclose(fit.probability(at), [0.056330, 0.425397, 0.970003], atol=1e-6)
    low, high = fit.band(at)
    np.testing.assert_allclose(low, [0.019985, 0.306350, 0.903784], atol=1e-6)
    np.testing.assert_allclose(high, [0.148740, 0.553773, 0.991097], atol=1e-6)


@pytest.mark.parametrize("share", [0.5, 0.95])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_interval_ends_where_the_band_crosses_the_share(share, sign):
    fit = fit_logistic(sign * DOSE, KILLED)
    assert fit is not None
    interval = fit.input_interval(share)
    assert interval is not None
    low, high = interval
    assert low < fit.input_at(share) < high
    assert fit.probability(fit.input_at(share)) == pytest.approx(share)
    ends = (high, low) if sign > 0 else (low, high)  # of the band's lower and upper side
    assert fit.band(ends[0])[0] == pytest.approx(share)
    assert fit.band(ends[1])[1] == pytest.approx(share)


@pytest.mark.parametrize("yes", [[1, 1, 1, 1], [0, 0, 0, 0], [0, 0, 1, 1], [1, 1, 0, 0]])
def test_no_fit_without_an_overlap_and_no_interval_where_the_slope_may_be_none(yes):
    assert fit_logistic([1.0, 2.0, 3.0, 4.0], yes) is None
    flat = fit_logistic([0, 1, 2, 3, 0, 1, 2, 3], [1, 0, 1, 0, 0, 1, 0, 1])
    assert flat is not None
    assert flat.input_interval(0.5) is None


def test_units_of_the_input_do_not_matter():
    one, other = fit_logistic(DOSE, KILLED), fit_logistic(1000.0 * DOSE + 7.0, KILLED)
    assert None not in (one, other)
    assert other.input_at(0.5) == pytest.approx(1000.0 * one.input_at(0.5) + 7.0)
    assert other.input_interval(0.9) == pytest.approx(
        [1000.0 * end + 7.0 for end in one.input_interval(0.9) or ()]
    )


# Remission of 21 patients on 6-mercaptopurine [weeks], Freireich et al. (1963); the estimate as tabled in
# Kleinbaum and Klein, Survival Analysis.
RELAPSED = (6, 6, 6, 7, 10, 13, 16, 22, 23)
CENSORED = (6, 9, 10, 11, 17, 19, 20, 25, 32, 32, 34, 35)
TABLE = {6: 0.8571, 7: 0.8067, 10: 0.7529, 13: 0.6902, 16: 0.6275, 22: 0.5378, 23: 0.4482}


def remission():
    return kaplan_meier((*RELAPSED, *CENSORED), [True] * len(RELAPSED) + [False] * len(CENSORED))


def test_it_is_the_published_table():
    curve = remission()
    for week, share in TABLE.items():
        assert at(curve, week) == pytest.approx(share, abs=5e-5)
    assert at(curve, 5.99) == 1.0
    assert at(curve, 9) == at(curve, 7)  # a censored one changes nothing
    assert at(curve, 100) == at(curve, 23)


def at(curve, time) -> float:
    """Share that has not fallen by a time."""
    return [1.0, *curve.survival][np.searchsorted(curve.times, time, side="right")]


def test_the_interval_is_greenwoods_on_a_doubly_logarithmic_scale():
    curve = remission()
    at_risk = {6: 21, 7: 17, 10: 15, 13: 12, 16: 11, 22: 7, 23: 6}
    falls = {week: RELAPSED.count(week) for week in at_risk}
    for last in (6, 23):
        sums = sum(falls[w] / (at_risk[w] * (at_risk[w] - falls[w])) for w in at_risk if w <= last)
        share = math.prod(1 - falls[w] / at_risk[w] for w in at_risk if w <= last)
        reach = 1.959964 * math.sqrt(sums) / abs(math.log(share))
        index = int(np.flatnonzero(curve.times == last)[0])
        expected = share ** math.exp(reach), share ** math.exp(-reach)
        assert (curve.low[index], curve.high[index]) == pytest.approx(expected, rel=1e-6)


def test_without_censoring_it_is_the_share_that_stands():
    ends = [0.5, 2.0, 2.0, 3.5]
    curve = kaplan_meier(ends, [True] * 4)
    assert [at(curve, time) for time in (0.4, 0.5, 2.0, 3.5)] == pytest.approx([1.0, 0.75, 0.25, 0.0])


def test_where_nobody_or_everybody_falls_the_interval_is_whole():
    standing = kaplan_meier([4.0, 4.0, 4.0], [False] * 3)
    assert (at(standing, 4.0), standing.low[0], standing.high[0]) == (1.0, 0.0, 1.0)
    fallen = kaplan_meier([1.0, 2.0], [True, True])
    assert (at(fallen, 2.0), fallen.low[1], fallen.high[1]) == (0.0, 0.0, 1.0)
    assert 0.0 < fallen.low[0] < 0.5 < fallen.high[0] < 1.0


@pytest.mark.parametrize(
    ("estimate", "values", "happened", "message"),
    [
        (kaplan_meier, [], [], "one length >= 1"),
        (kaplan_meier, [1.0], [True, False], "one length >= 1"),
        (kaplan_meier, [-1.0], [True], "finite and >= 0"),
        (kaplan_meier, [float("nan")], [True], "finite and >= 0"),
        (fit_logistic, [1.0, 2.0], [1], "inputs"),
        (fit_logistic, [1.0, np.nan, 3.0], [1, 0, 1], "inputs"),
    ],
)
def test_bad_input_is_refused(estimate, values, happened, message):
    with pytest.raises(InvalidValueError, match=message):
        estimate(values, happened)


def test_the_interquartile_mean_leaves_out_a_quarter_on_each_side():
    assert statistics.interquartile_mean([[-100.0, 2.0, 3.0, 7.0], [4.0, 5.0, 6.0, 1e6]]) == pytest.approx(
        4.5
    )
    assert statistics.interquartile_mean([[1.0, 2.0, 9.0]]) == pytest.approx(4.0)  # floor(3 / 4) = 0
    assert statistics.interquartile_mean([[0.0, 1.0, 2.0, 3.0, 10.0]]) == pytest.approx(2.0)


def test_the_probability_of_improvement_is_mann_whitneys_u_over_the_pairs():
    rng = np.random.default_rng(1)
    a, b = rng.integers(0, 4, (5, 30)).astype(float), rng.integers(0, 3, (3, 30)).astype(float)
    expected = np.mean([stats.mannwhitneyu(a[:, k], b[:, k]).statistic / 15 for k in range(30)])
    assert statistics.probability_of_improvement(a, b) == pytest.approx(expected)
    assert statistics.probability_of_improvement(a, b) + statistics.probability_of_improvement(
        b, a
    ) == pytest.approx(1.0)
    assert statistics.probability_of_improvement([[2.0], [0.0]], [[1.0]]) == 0.5
    assert statistics.probability_of_improvement([[2.0, 5.0]], [[1.0, 5.0]]) == 0.75


def test_the_profile_counts_what_lies_above():
    profile = statistics.performance_profile([[0.0, 0.5], [0.5, 1.0]], [-1.0, 0.0, 0.4, 0.5, 1.0])
    np.testing.assert_allclose(profile, [1.0, 0.75, 0.75, 0.25, 0.0])


def test_with_one_seed_it_is_the_bootstrap_over_scenarios():
    scores = np.random.default_rng(2).exponential(size=(1, 400))
    interval = bootstrap_interval(np.mean, [scores], np.random.default_rng(3), draws=4000)
    theirs = stats.bootstrap(
        (scores[0],), np.mean, n_resamples=4000, method="percentile", rng=np.random.default_rng(4)
    ).confidence_interval
    assert interval == pytest.approx((theirs.low, theirs.high), abs=0.1 * (theirs.high - theirs.low))


def test_seeds_that_differ_widen_the_interval_and_scenarios_alone_do_not_tell():
    """Scores that depend on the seed alone: the interval is that of a normal mean of so many seeds."""
    rates = np.random.default_rng(5).normal(size=40)
    scores = np.repeat(rates[:, None], 100, axis=1)
    low, high = bootstrap_interval(np.mean, [scores], np.random.default_rng(6), draws=4000)
    assert high - low == pytest.approx(2 * 1.96 * rates.std() / np.sqrt(40), rel=0.06)


def test_scenarios_are_drawn_together_for_both_variants():
    """Two variants apart by a constant on every scenario: the pairs leave nothing to chance."""
    base = np.random.default_rng(7).normal(size=(1, 50))
    interval = bootstrap_interval(
        lambda a, b: float(np.mean(a - b)), [base + 0.25, base], np.random.default_rng(8), draws=50
    )
    assert interval == pytest.approx((0.25, 0.25))


def test_each_scenario_is_drawn_from_its_own_stratum():
    """Strata far apart, 30 scenarios in one and 10 in the other: only what differs within them counts."""
    rng = np.random.default_rng(10)
    strata = rng.permutation(np.repeat([0, 1], [30, 10]))
    scores = np.where(strata == 0, 0.0, 100.0) + rng.normal(scale=np.where(strata == 0, 1.0, 3.0))
    sizes, variances = (30, 10), [np.var(scores[strata == k]) for k in (0, 1)]
    deviation = np.sqrt(sum((n / 40) ** 2 * v / n for n, v in zip(sizes, variances, strict=True)))
    low, high = bootstrap_interval(
        np.mean, [scores[None]], np.random.default_rng(11), draws=4000, strata=strata
    )
    assert high - low == pytest.approx(2 * 1.96 * deviation, rel=0.06)
    alone = bootstrap_interval(np.mean, [scores[None]], np.random.default_rng(11), draws=400)
    assert alone[1] - alone[0] > 5 * (high - low)


def test_rates_of_strata():
    rates = statistics.stratum_rates([[1.0, 0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0, 0.0]], [0, 2, 0, 1, 2])
    np.testing.assert_allclose(rates, [[1.0, 1.0, 0.0], [0.5, 0.0, 0.0]])


def test_a_band_is_an_interval_at_every_threshold():
    scores = [np.random.default_rng(12).normal(size=(4, 25))]
    at = [-1.0, 0.0, 0.5]
    band = bootstrap_interval(
        lambda drawn: statistics.performance_profile(drawn, at), scores, np.random.default_rng(1), draws=300
    )
    assert band.shape == (2, 3)
    for k, threshold in enumerate(at):
        alone = bootstrap_interval(
            lambda drawn, t=threshold: float(np.mean(drawn > t)), scores, np.random.default_rng(1), draws=300
        )
        np.testing.assert_allclose(band[:, k], alone)


def test_draws_are_the_callers():
    scores = [np.random.default_rng(9).normal(size=(3, 20))]
    found = [bootstrap_interval(np.mean, scores, np.random.default_rng(k), draws=100) for k in (1, 1, 2)]
    assert tuple(found[0]) == tuple(found[1]) != tuple(found[2])


def test_bad_input_is_refused_seeds():
    for scores in ([1.0, 2.0], np.zeros((0, 3)), [[float("inf")]]):
        with pytest.raises(InvalidValueError, match="of shape"):
            statistics.interquartile_mean(scores)
    with pytest.raises(InvalidValueError, match="the same scenarios, got 2, 3"):
        statistics.probability_of_improvement(np.zeros((1, 2)), np.zeros((4, 3)))


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


@pytest.mark.parametrize("yes", [[0, 0, 1, 1], [1, 1, 0, 0]])
def test_outcomes_that_only_touch_do_not_overlap(yes):
    """Yes and no at 2, else apart: the likelihood rises for ever (Albert and Anderson 1984)."""
    assert fit_logistic([1.0, 2.0, 2.0, 3.0], yes) is None


def test_each_policy_draws_its_own_seeds_and_as_many_as_it_has():
    """Of 40 and of 10 seeds: the variances of both means add."""
    rates = np.random.default_rng(5).normal(size=40)
    many = np.repeat(rates[:, None], 4, axis=1)
    low, high = bootstrap_interval(
        lambda a, b: float(np.mean(a) - np.mean(b)), [many, many[:10]], np.random.default_rng(6), draws=2000
    )
    deviation = math.sqrt(rates.var() / 40 + rates[:10].var() / 10)
    assert high - low == pytest.approx(2 * 1.96 * deviation, rel=0.1)


def test_an_event_at_time_zero_counts_and_one_that_never_comes_is_refused():
    assert kaplan_meier([0.0, 1.0, 2.0], [True, True, False]).survival == pytest.approx([2 / 3, 1 / 3, 1 / 3])
    with pytest.raises(InvalidValueError):
        kaplan_meier([math.inf], [True])


def test_fewer_successes_than_none_are_refused():
    with pytest.raises(InvalidValueError):
        wilson_interval(-1, 0)
