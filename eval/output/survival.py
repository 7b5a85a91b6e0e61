"""Survival over time or over repeated pushes, where some episodes end before the robot has fallen."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SurvivalCurve:
    """S, a step function: its value from each time on, 1 before the first."""

    times: Array  # ends of episodes, each once, rising [s], or numbers of pushes
    survival: Array  # share that stands after each
    low: Array  # of its 95 % interval
    high: Array

    def at(self, time: float) -> float:
        """Share that has not fallen by a time."""
        index = int(np.searchsorted(self.times, time, side="right")) - 1
        return float(self.survival[index]) if index >= 0 else 1.0


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
