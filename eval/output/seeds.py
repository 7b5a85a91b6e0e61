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
Statistic = Callable[..., float]  # of one or more arrays (seeds, scenarios)
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


def bootstrap_interval(
    statistic: Statistic,
    scores: Sequence[ArrayLike],
    rng: np.random.Generator,
    level: float = 0.95,
    draws: int = DRAWS,
) -> tuple[float, float]:
    """Percentile interval of a statistic of one or more arms under another choice of seeds and scenarios.

    Each draw takes seeds of every arm with replacement, each arm for itself, then scenarios, the same for all
    arms, which keeps the pairs. With few seeds it is too narrow: the variance of the mean of n drawn seeds
    lacks the factor n / (n - 1), which at five is a fifth of it.

    Args:
        statistic: of arrays (seeds, scenarios), as many as `scores` has.
        scores: of the arms, over the same scenarios.
        rng: of the draws.
        level: of the interval.
        draws: how many.

    Raises:
        InvalidValueError: arms over different numbers of scenarios, or a level outside (0, 1).
    """
    if not 0.0 < level < 1.0:
        raise InvalidValueError(f"level must be in (0, 1), got {level}")
    arms = _alike(*scores)
    scenarios = arms[0].shape[1]
    found = np.empty(draws)
    for draw in range(draws):
        seeds = [rng.integers(len(arm), size=len(arm)) for arm in arms]
        columns = rng.integers(scenarios, size=scenarios)
        found[draw] = statistic(*(arm[np.ix_(rows, columns)] for arm, rows in zip(arms, seeds, strict=True)))
    low, high = np.quantile(found, (0.5 * (1.0 - level), 0.5 * (1.0 + level)))
    return float(low), float(high)


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
