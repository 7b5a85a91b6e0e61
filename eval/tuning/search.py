"""CMA-ES by asking and telling: its proposals are a function of the seed and of what it was told.

A search that starts again with the same seed and is told the same scores makes the same proposals, so that
a study resumes by telling it what the finished trials found (Hansen and Ostermeier 2001; package `cmaes`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, MissingExtraError
from .space import Space

SIGMA = 1.0  # first standard deviation, in the units of the dimensions
LEAST = 2  # the package's least number of dimensions


class Search:
    """Proposes points of a space, generation by generation; the first generation is drawn about the start.

    Raises:
        InvalidValueError: fewer than two dimensions.
        MissingExtraError: the package is not installed.
    """

    def __init__(self, space: Space, seed: int):
        try:
            from cmaes import CMA
        except ImportError as error:
            raise MissingExtraError("cmaes", "tune") from error
        self.size = n = len(space.dimensions)
        if n < LEAST:
            raise InvalidValueError(f"a search needs at least {LEAST} fields, got {n}")
        word = int(np.random.SeedSequence(seed).generate_state(1)[0])
        self._cma = CMA(mean=np.zeros(n), sigma=SIGMA, bounds=space.bounds, seed=word)
        self._told: list[tuple[NDArray[np.float64], float]] = []

    @property
    def population(self) -> int:
        """Proposals in a generation, 4 + floor(3 ln n)."""
        return int(self._cma.population_size)

    def ask(self) -> NDArray[np.float64]:
        """The next point, (n,)."""
        return np.asarray(self._cma.ask(), dtype=np.float64)

    def tell(self, point: NDArray[np.float64], score: float) -> None:
        """Say what the last point is worth; a generation moves the search once all of it is told."""
        self._told.append((point, -score))  # the package minimises
        if len(self._told) == self.population:
            self._cma.tell(self._told)
            self._told = []
