"""Statistics of outcomes: score intervals, paired tests, logistic curves, survival, and training seeds.

Scores of several training seeds are arrays (seeds, scenarios), where what is not trained has one seed; they
are compared as Agarwal et al. (2021), Deep Reinforcement Learning at the Edge of the Statistical Precipice,
NeurIPS, recommend.
"""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    def of(cls, a: NDArray[np.bool_], b: NDArray[np.bool_]) -> Self:
        """Count pairs from two (n,) arrays in the same order of scenarios."""
        if a.shape != b.shape:
            raise InvalidValueError(f"pairs need equal lengths, got {a.shape} and {b.shape}")
        return cls(int(np.sum(a & b)), int(np.sum(a & ~b)), int(np.sum(~a & b)), int(np.sum(~a & ~b)))

    @classmethod
    def of_rows(
        cls, a: Sequence[Mapping[str, Any]], b: Sequence[Mapping[str, Any]], field: str = "recovered"
    ) -> Self:
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


Array = NDArray[np.float64]
Z = 1.959963984540054  # of a 95 % interval of the normal distribution
TOLERANCE = 1e-8  # of the gradient, with inputs of mean 0 and variance 1


@dataclass(frozen=True)
class LogisticFit:
    """Maximum-likelihood fit of P(yes) = 1 / (1 + exp(-(a + b x)))."""

    intercept: float  # a
    slope: float  # b, by unit of x
    covariance: Array  # (2, 2) of (a, b): inverse of the information at the fit

    def probability(self, x: ArrayLike) -> Array:
        """P(yes) at each x."""
        return _expit(self.intercept + self.slope * np.asarray(x, dtype=np.float64))

    def band(self, x: ArrayLike) -> tuple[Array, Array]:
        """95 % band of P(yes) at each x, low and high: that of a + b x by its normal distribution (Wald)."""
        x = np.asarray(x, dtype=np.float64)
        (aa, ab), (_, bb) = self.covariance
        half = Z * np.sqrt(aa + 2.0 * ab * x + bb * x**2)
        middle = self.intercept + self.slope * x
        return _expit(middle - half), _expit(middle + half)

    def input_at(self, share: float) -> float:
        """The x at which P(yes) = share, (log(share / (1 - share)) - a) / b."""
        return (_logit(share) - self.intercept) / self.slope

    def input_interval(self, share: float) -> tuple[float, float] | None:
        """95 % interval of `input_at`: all x whose band holds the share (Fieller 1954).

        The roots of (a + b x - l)^2 = z^2 (v_aa + 2 v_ab x + v_bb x^2), l the logit of the share. None where
        the slope may be 0, b^2 <= z^2 v_bb: the interval has no end then.
        """
        (aa, ab), (_, bb) = Z**2 * self.covariance
        off = self.intercept - _logit(share)
        square, linear, constant = self.slope**2 - bb, off * self.slope - ab, off**2 - aa
        if square <= 0.0:
            return None
        root = math.sqrt(max(linear**2 - square * constant, 0.0))
        return float((-linear - root) / square), float((-linear + root) / square)


def fit_logistic(x: ArrayLike, yes: ArrayLike) -> LogisticFit | None:
    """Fit the curve by maximum likelihood; None where it has no finite maximum.

    There is one exactly where the outcomes overlap: some yes above some no, and some yes below some no
    (Albert and Anderson 1984, Biometrika 71, 1-10).

    Args:
        x: inputs (n,).
        yes: outcomes (n,).

    Raises:
        InvalidValueError: lists of different length, or an input that is not finite.
    """
    x, yes = np.asarray(x, dtype=np.float64), np.asarray(yes, dtype=np.bool_)
    if x.shape != yes.shape or x.ndim != 1 or not np.isfinite(x).all():
        raise InvalidValueError(
            f"inputs must be finite, one an outcome, got shapes {x.shape} and {yes.shape}"
        )
    if not (yes.any() and (~yes).any() and x[yes].min() < x[~yes].max() and x[~yes].min() < x[yes].max()):
        return None
    from scipy.optimize import minimize

    middle, spread = float(x.mean()), float(x.std())
    design = np.column_stack([np.ones_like(x), (x - middle) / spread])

    def loss(at: Array) -> float:
        return float(np.logaddexp(0.0, np.where(yes, -1.0, 1.0) * (design @ at)).sum())

    def gradient(at: Array) -> Array:
        return design.T @ (_expit(design @ at) - yes)

    def information(at: Array) -> Array:
        share = _expit(design @ at)
        return (design * (share * (1.0 - share))[:, None]).T @ design

    found = minimize(
        loss, np.zeros(2), jac=gradient, hess=information, method="trust-exact", options={"gtol": TOLERANCE}
    )
    back = np.array([[1.0, -middle / spread], [0.0, 1.0 / spread]])  # to the unit of x
    intercept, slope = back @ found.x
    covariance = back @ np.linalg.inv(information(found.x)) @ back.T
    return LogisticFit(float(intercept), float(slope), np.asarray(covariance, dtype=np.float64))


def _expit(x: Array) -> Array:
    from scipy.special import expit

    return expit(x)


def _logit(share: float) -> float:
    return math.log(share / (1.0 - share))


@dataclass(frozen=True)
class SurvivalCurve:
    """S, a step function: its value from each time on, 1 before the first."""

    times: Array  # ends of episodes, each once, rising [s], or numbers of pushes
    survival: Array  # share that stands after each
    low: Array  # of its 95 % interval
    high: Array


def kaplan_meier(ends: Sequence[float], fell: Sequence[bool]) -> SurvivalCurve:
    """Kaplan and Meier's (1958) estimate of survival from episodes of which some end without a fall.

        S(t) = product over t_i <= t of (1 - d_i / n_i),

    d_i falls at t_i of the n_i episodes that last until then; an episode that ends at t_i without a fall is
    among these. The 95 % interval is that of log(-log S) with Greenwood's variance, which stays in [0, 1]:

        S^exp(-+1.96 s),   s^2 = sum over t_i <= t of d_i / (n_i (n_i - d_i)) / log(S)^2,

    and 0 to 1 where S is 0 or 1.

    Args:
        ends: of the episodes [s], or the number of pushes they have had.
        fell: whether each ended by a fall; the others are censored.

    Raises:
        InvalidValueError: no episode, lists of different length, or an end that is negative or not finite.
    """
    times, falls = np.asarray(ends, dtype=np.float64), np.asarray(fell, dtype=np.bool_)
    if times.shape != falls.shape or times.ndim != 1 or not times.size:
        raise InvalidValueError(
            f"ends and fell must be lists of one length >= 1, got shapes {times.shape} and {falls.shape}"
        )
    if not (np.isfinite(times) & (times >= 0.0)).all():
        raise InvalidValueError("ends of episodes must be finite and >= 0")
    from scipy.stats import CensoredData, ecdf

    found = ecdf(CensoredData(uncensored=times[falls], right=times[~falls])).sf
    survival = np.asarray(found.probabilities, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # that there is none where S is 0 or 1
        interval = found.confidence_interval(0.95, method="log-log")
    low, high = (np.asarray(side.probabilities, dtype=np.float64) for side in (interval.low, interval.high))
    sure = (survival > 0.0) & (survival < 1.0)
    return SurvivalCurve(
        np.asarray(found.quantiles, dtype=np.float64),
        survival,
        np.where(sure, low, 0.0),
        np.where(sure, high, 1.0),
    )


LEVEL = 0.95  # of a bootstrap's interval


def interquartile_mean(scores: ArrayLike) -> float:
    """Mean of the scores between the quartiles, of all seeds and scenarios together.

    The lowest and the highest floor(n / 4) of the n scores are left out.
    """
    from scipy.stats import trim_mean

    return float(trim_mean(_scores(scores)[0].ravel(), 0.25))


def probability_of_improvement(a: ArrayLike, b: ArrayLike) -> float:
    """How often a seed of a does better than one of b: mean over the scenarios of P(a > b) + P(a = b) / 2.

    Args:
        a: scores (seeds, scenarios).
        b: scores (seeds, the same scenarios); the number of seeds may differ.
    """
    first, second = _scores(a, b)
    difference = first[:, None, :] - second[None, :, :]
    return float(np.mean(0.5 * (1.0 + np.sign(difference))))


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> Array:
    """Share of the runs, of all seeds and scenarios, with a score above each threshold (thresholds,)."""
    runs = np.sort(_scores(scores)[0].ravel())
    above = runs.size - np.searchsorted(runs, np.asarray(thresholds, dtype=np.float64), side="right")
    return above / runs.size


def stratum_rates(scores: ArrayLike, strata: ArrayLike) -> Array:
    """Mean score of each seed in each stratum (seeds, strata): tasks that a share of successes is a score of.

    Args:
        scores: of single scenarios (seeds, scenarios), such as 1 for recovered.
        strata: number of the stratum of each scenario, from 0 on without gaps.
    """
    members = np.eye(int(np.max(strata)) + 1)[np.asarray(strata)]
    return _scores(scores)[0] @ members / members.sum(axis=0)


def bootstrap_interval(
    statistic: Callable[..., float | Array],
    scores: Sequence[ArrayLike],
    rng: np.random.Generator,
    draws: int = 2000,
    strata: ArrayLike | None = None,
) -> Array:
    """95 % percentile interval of a statistic of policies under another choice of seeds and scenarios.

    Each draw takes seeds of every policy with replacement, each policy for itself, then scenarios, the same
    for all, which keeps the pairs, and each from its own stratum. With few seeds it is too narrow: the
    variance of the mean of n drawn seeds lacks the factor n / (n - 1), which at five is a fifth of it.

    Args:
        statistic: of arrays (seeds, scenarios), as many as `scores` has, in the order of the strata.
        scores: of the policies, over the same scenarios.
        rng: of the draws.
        draws: how many.
        strata: number of the stratum of each scenario; one of all without.

    Returns:
        Low and high end (2, shape of the statistic).

    Raises:
        InvalidValueError: policies over different numbers of scenarios.
    """
    policies = _scores(*scores)
    group = np.zeros(policies[0].shape[1], dtype=np.int64) if strata is None else np.asarray(strata)
    order = np.argsort(group, kind="stable")
    _, number, sizes = np.unique(group, return_inverse=True, return_counts=True)
    first = (np.cumsum(sizes) - sizes)[number]
    found = []
    for _ in range(draws):
        seeds = [rng.integers(len(one), size=len(one)) for one in policies]
        columns = order[first + rng.integers(sizes[number])]  # for each scenario one of its stratum
        drawn = (one[np.ix_(rows, columns)] for one, rows in zip(policies, seeds, strict=True))
        found.append(statistic(*drawn))
    return np.quantile(np.array(found), (0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)), axis=0)


def _scores(*scores: ArrayLike) -> list[Array]:
    """Scores as arrays (seeds, scenarios), over the same scenarios."""
    found = [np.asarray(one, dtype=np.float64) for one in scores]
    for one in found:
        if one.ndim != 2 or not one.size or not np.isfinite(one).all():
            raise InvalidValueError(f"scores must be finite and of shape (seeds, scenarios), got {one.shape}")
    if len({one.shape[1] for one in found}) != 1:
        raise InvalidValueError(
            f"scores must be over the same scenarios, got {', '.join(str(one.shape[1]) for one in found)}"
        )
    return found
