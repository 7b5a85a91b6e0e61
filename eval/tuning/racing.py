"""Successive halving on paired scenarios: a trial that is clearly worse than the best one is stopped early.

Trials meet the same scenarios in the same order, so that the difference of two trials on the first n of them
says more than either score: with d_i = value_i - best_i over those n,

    score ~ best + mean(d),        clearly worse: mean(d) + z s / sqrt(n) < 0,   s^2 = sample variance of d.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

Z = 1.645  # one-sided 95 %: of trials as good as the best, one in twenty is stopped at each rung
RUNGS = (0.25, 0.5, 1.0)  # shares of the scenarios


def rungs(scenarios: int) -> list[int]:
    """Numbers of scenarios after which a trial is looked at; the last one is all of them."""
    return sorted({max(1, round(share * scenarios)) for share in RUNGS})


def estimate(values: Sequence[float], best: Sequence[float]) -> float:
    """Score of a trial from its first values; their mean where it has all, or where there is no best."""
    n = len(values)
    if n >= len(best):
        return float(np.mean(values))
    return float(np.mean(best) + np.mean(np.subtract(values, best[:n])))


def clearly_worse(values: Sequence[float], best: Sequence[float]) -> bool:
    """Whether the first values leave little hope of reaching the best trial."""
    n = len(values)
    if n >= len(best) or n < 2:
        return False
    difference = np.subtract(values, best[:n])
    return bool(difference.mean() + Z * difference.std(ddof=1) / math.sqrt(n) < 0.0)


def race(run: Callable[[int, int], list[float]], scenarios: int, best: Sequence[float]) -> list[float]:
    """Values of a trial, rung by rung, until it is clearly worse than the best one.

    Args:
        run: values of the scenarios from the first number to before the second.
        scenarios: how many there are.
        best: values of the best trial so far on all of them; empty: this one is run in full.
    """
    values: list[float] = []
    for end in rungs(scenarios) if len(best) else [scenarios]:
        values += run(len(values), end)
        if clearly_worse(values, best):
            break
    return values
