"""Several training seeds against one another: robust means, profiles, and intervals that know of the seeds.

Agarwal et al. (2021), Deep Reinforcement Learning at the Edge of the Statistical Precipice, NeurIPS. Scores
are arrays (seeds, scenarios); an arm that is not trained has one seed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...controllers.errors import InvalidValueError

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Statistic = Callable[..., float | Array]  # of one or more arrays (seeds, scenarios)
DRAWS = 2000  # of a bootstrap


def interquartile_mean(scores: ArrayLike) -> float:
    """Mean of the scores between the quartiles, of all seeds and scenarios together.

    The lowest and the highest floor(n / 4) of the n scores are left out.
    """
    from scipy.stats import trim_mean

    return float(trim_mean(_scores(scores).ravel(), 0.25))


def probability_of_improvement(a: ArrayLike, b: ArrayLike) -> float:
    """How often a seed of a does better than one of b: mean over the scenarios of P(a > b) + P(a = b) / 2.

    Args:
        a: scores (seeds, scenarios).
        b: scores (seeds, the same scenarios); the number of seeds may differ.
    """
    first, second = _alike(a, b)
    difference = first[:, None, :] - second[None, :, :]
    return float(np.mean(0.5 * (1.0 + np.sign(difference))))


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> Array:
    """Share of the runs, of all seeds and scenarios, with a score above each threshold (thresholds,)."""
    runs = np.sort(_scores(scores).ravel())
    above = runs.size - np.searchsorted(runs, np.asarray(thresholds, dtype=np.float64), side="right")
    return above / runs.size


def stratum_rates(scores: ArrayLike, strata: ArrayLike) -> Array:
    """Mean score of each seed in each stratum (seeds, strata): tasks that a share of successes is a score of.

    Args:
        scores: of single scenarios (seeds, scenarios), such as 1 for recovered.
        strata: number of the stratum of each scenario, from 0 on without gaps.
    """
    members = np.eye(int(np.max(strata)) + 1)[np.asarray(strata)]
    return _scores(scores) @ members / members.sum(axis=0)


def bootstrap_interval(
    statistic: Callable[..., float],
    scores: Sequence[ArrayLike],
    rng: np.random.Generator,
    level: float = 0.95,
    draws: int = DRAWS,
    strata: ArrayLike | None = None,
) -> tuple[float, float]:
    """Percentile interval of a number, see `bootstrap_band`."""
    low, high = bootstrap_band(statistic, scores, rng, level, draws, strata)
    return float(low), float(high)


def bootstrap_band(
    statistic: Statistic,
    scores: Sequence[ArrayLike],
    rng: np.random.Generator,
    level: float = 0.95,
    draws: int = DRAWS,
    strata: ArrayLike | None = None,
) -> Array:
    """Percentile interval of a statistic of one or more arms under another choice of seeds and scenarios.

    Each draw takes seeds of every arm with replacement, each arm for itself, then scenarios, the same for all
    arms, which keeps the pairs, and each from its own stratum. With few seeds it is too narrow: the variance
    of the mean of n drawn seeds lacks the factor n / (n - 1), which at five is a fifth of it.

    Args:
        statistic: of arrays (seeds, scenarios), as many as `scores` has, in the order of the strata.
        scores: of the arms, over the same scenarios.
        rng: of the draws.
        level: of the interval.
        draws: how many.
        strata: number of the stratum of each scenario; one of all without.

    Returns:
        Low and high end (2, shape of the statistic).

    Raises:
        InvalidValueError: arms over different numbers of scenarios, or a level outside (0, 1).
    """
    if not 0.0 < level < 1.0:
        raise InvalidValueError(f"level must be in (0, 1), got {level}")
    arms = _alike(*scores)
    drawn = _drawing(np.zeros(arms[0].shape[1], dtype=np.int64) if strata is None else np.asarray(strata))
    found = []
    for _ in range(draws):
        seeds = [rng.integers(len(arm), size=len(arm)) for arm in arms]
        columns = drawn(rng)
        found.append(statistic(*(arm[np.ix_(rows, columns)] for arm, rows in zip(arms, seeds, strict=True))))
    return np.quantile(np.array(found), (0.5 * (1.0 - level), 0.5 * (1.0 + level)), axis=0)


def _drawing(strata: Ints) -> Callable[[np.random.Generator], Ints]:
    """A function that draws for each scenario one of its stratum."""
    order = np.argsort(strata, kind="stable")
    _, number, sizes = np.unique(strata, return_inverse=True, return_counts=True)
    first = (np.cumsum(sizes) - sizes)[number]
    return lambda rng: order[first + rng.integers(sizes[number])]


def _scores(scores: ArrayLike) -> Array:
    """Scores as an array (seeds, scenarios)."""
    found = np.asarray(scores, dtype=np.float64)
    if found.ndim != 2 or not found.size or not np.isfinite(found).all():
        raise InvalidValueError(f"scores must be finite and of shape (seeds, scenarios), got {found.shape}")
    return found


def _alike(*scores: ArrayLike) -> list[Array]:
    """Scores over the same scenarios."""
    found = [_scores(arm) for arm in scores]
    if len({arm.shape[1] for arm in found}) != 1:
        raise InvalidValueError(
            f"scores must be over the same scenarios, got {', '.join(str(arm.shape[1]) for arm in found)}"
        )
    return found
