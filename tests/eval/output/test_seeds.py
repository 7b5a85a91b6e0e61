"""Aggregates over training seeds, against their definitions and against scipy."""

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output.statistics import (
    bootstrap_band,
    bootstrap_interval,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
    stratum_rates,
)
from scipy import stats


def mean(scores):
    return float(scores.mean())


def gain(a, b):
    return float(a.mean() - b.mean())


def test_the_interquartile_mean_leaves_out_a_quarter_on_each_side():
    assert interquartile_mean([[-100.0, 2.0, 3.0, 7.0], [4.0, 5.0, 6.0, 1e6]]) == pytest.approx(4.5)
    assert interquartile_mean([[1.0, 2.0, 9.0]]) == pytest.approx(4.0)  # floor(3 / 4) = 0
    assert interquartile_mean([[0.0, 1.0, 2.0, 3.0, 10.0]]) == pytest.approx(2.0)


def test_the_probability_of_improvement_is_mann_whitneys_u_over_the_pairs():
    rng = np.random.default_rng(1)
    a, b = rng.integers(0, 4, (5, 30)).astype(float), rng.integers(0, 3, (3, 30)).astype(float)
    expected = np.mean([stats.mannwhitneyu(a[:, k], b[:, k]).statistic / 15 for k in range(30)])
    assert probability_of_improvement(a, b) == pytest.approx(expected)
    assert probability_of_improvement(a, b) + probability_of_improvement(b, a) == pytest.approx(1.0)
    assert probability_of_improvement([[2.0], [0.0]], [[1.0]]) == 0.5
    assert probability_of_improvement([[2.0, 5.0]], [[1.0, 5.0]]) == 0.75


def test_the_profile_counts_what_lies_above():
    profile = performance_profile([[0.0, 0.5], [0.5, 1.0]], [-1.0, 0.0, 0.4, 0.5, 1.0])
    np.testing.assert_allclose(profile, [1.0, 0.75, 0.75, 0.25, 0.0])


def test_with_one_seed_it_is_the_bootstrap_over_scenarios():
    scores = np.random.default_rng(2).exponential(size=(1, 400))
    interval = bootstrap_interval(mean, [scores], np.random.default_rng(3), draws=4000)
    theirs = stats.bootstrap(
        (scores[0],), np.mean, n_resamples=4000, method="percentile", rng=np.random.default_rng(4)
    ).confidence_interval
    assert interval == pytest.approx((theirs.low, theirs.high), abs=0.1 * (theirs.high - theirs.low))


def test_seeds_that_differ_widen_the_interval_and_scenarios_alone_do_not_tell():
    """Scores that depend on the seed alone: the interval is that of a normal mean of so many seeds."""
    rates = np.random.default_rng(5).normal(size=40)
    scores = np.repeat(rates[:, None], 100, axis=1)
    low, high = bootstrap_interval(mean, [scores], np.random.default_rng(6), draws=4000)
    assert high - low == pytest.approx(2 * 1.96 * rates.std() / np.sqrt(40), rel=0.06)


def test_scenarios_are_drawn_together_for_both_arms():
    """Two arms apart by a constant on every scenario: the pairs leave nothing to chance."""
    base = np.random.default_rng(7).normal(size=(1, 50))
    interval = bootstrap_interval(gain, [base + 0.25, base], np.random.default_rng(8), draws=50)
    assert interval == pytest.approx((0.25, 0.25))


def test_each_scenario_is_drawn_from_its_own_stratum():
    """Strata far apart, 30 scenarios in one and 10 in the other: only what differs within them counts."""
    rng = np.random.default_rng(10)
    strata = rng.permutation(np.repeat([0, 1], [30, 10]))
    scores = np.where(strata == 0, 0.0, 100.0) + rng.normal(scale=np.where(strata == 0, 1.0, 3.0))
    sizes, variances = (30, 10), [np.var(scores[strata == k]) for k in (0, 1)]
    deviation = np.sqrt(sum((n / 40) ** 2 * v / n for n, v in zip(sizes, variances, strict=True)))
    low, high = bootstrap_interval(mean, [scores[None]], np.random.default_rng(11), draws=4000, strata=strata)
    assert high - low == pytest.approx(2 * 1.96 * deviation, rel=0.06)
    alone = bootstrap_interval(mean, [scores[None]], np.random.default_rng(11), draws=400)
    assert alone[1] - alone[0] > 5 * (high - low)


def test_rates_of_strata():
    rates = stratum_rates([[1.0, 0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0, 0.0]], [0, 2, 0, 1, 2])
    np.testing.assert_allclose(rates, [[1.0, 1.0, 0.0], [0.5, 0.0, 0.0]])


def test_a_band_is_an_interval_at_every_threshold():
    scores = [np.random.default_rng(12).normal(size=(4, 25))]
    at = [-1.0, 0.0, 0.5]
    band = bootstrap_band(
        lambda drawn: performance_profile(drawn, at), scores, np.random.default_rng(1), draws=300
    )
    assert band.shape == (2, 3)
    for k, threshold in enumerate(at):
        alone = bootstrap_interval(
            lambda drawn, t=threshold: float(np.mean(drawn > t)), scores, np.random.default_rng(1), draws=300
        )
        np.testing.assert_allclose(band[:, k], alone)


def test_draws_and_level_are_the_callers():
    scores = [np.random.default_rng(9).normal(size=(3, 20))]
    same = [bootstrap_interval(mean, scores, np.random.default_rng(seed), draws=100) for seed in (1, 1, 2)]
    assert same[0] == same[1] != same[2]
    narrow = bootstrap_interval(mean, scores, np.random.default_rng(1), level=0.5, draws=100)
    assert same[0][0] < narrow[0] < narrow[1] < same[0][1]


def test_bad_input_is_refused():
    rng = np.random.default_rng(0)
    for scores in ([1.0, 2.0], np.zeros((0, 3)), [[float("inf")]]):
        with pytest.raises(InvalidValueError, match="of shape"):
            interquartile_mean(scores)
    with pytest.raises(InvalidValueError, match="the same scenarios, got 2, 3"):
        probability_of_improvement(np.zeros((1, 2)), np.zeros((4, 3)))
    with pytest.raises(InvalidValueError, match="level"):
        bootstrap_interval(mean, [np.zeros((1, 2))], rng, level=1.0)
