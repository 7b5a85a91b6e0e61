"""The cross-entropy method: normal candidates, drawn anew about the best of each generation.

    x ~ clip(N(m, diag(s^2)), -1, 1),    m <- mean of the elites,    s <- max(their deviation, least)

(Rubinstein 1999; de Boer et al. 2005). The candidates are a function of the seed and of what was told.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Candidates = NDArray[np.float32]
DECIMALS = 4


def as_text(candidates: Candidates) -> list[Any]:
    """Candidates as lists of numbers that are short in JSON and become the same float32 again."""
    return np.round(candidates.astype(np.float64), DECIMALS).tolist()


class CrossEntropy:
    """Proposes candidates (population, size) in [-1, 1].

    Args:
        rng: of the draws.
        mean: (size,) that the first generation is drawn about.
        spread: (size,) its standard deviation.
        population: candidates of a generation.
        elites: that the next one is drawn from.
        least: standard deviation that is kept.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        mean: NDArray[np.float64],
        spread: NDArray[np.float64],
        population: int,
        elites: int,
        least: float,
    ):
        self._rng, self._population, self._elites, self._least = rng, population, elites, least
        self.mean, self.spread = mean, spread

    def ask(self) -> Candidates:
        """A generation, float32, as actions are, of numbers with four decimals, which files hold exactly."""
        drawn = self._rng.standard_normal((self._population, len(self.mean)))
        candidates = np.clip(self.mean + self.spread * drawn, -1.0, 1.0)
        return np.round(candidates, DECIMALS).astype(np.float32)

    def tell(self, candidates: Candidates, values: NDArray[np.float64]) -> None:
        """Say what they are worth (population,): more is better, of equal ones the first."""
        best = np.argsort(-values, kind="stable")[: self._elites]
        elites = candidates[best].astype(np.float64)
        self.mean, self.spread = elites.mean(axis=0), np.maximum(elites.std(axis=0), self._least)
