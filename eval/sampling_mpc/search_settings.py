"""What all searches for corrections by the cross-entropy method are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ...controllers.errors import InvalidValueError
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.validation import require_integer, require_number


@dataclass(frozen=True)
class SearchSettings:
    """A search over corrections of a planner that goes on planning: a row of seven for each of some steps.

    Raises:
        InvalidValueError: a field that is impossible.
    """

    most_generations: ClassVar[int]

    steps: int = 4  # from the present one on, each with a correction of its own
    population: int = 64  # attempts of a generation
    generations: int = 1  # at most
    elites: int = 8  # attempts that the next generation is drawn from
    spread: float = 0.8  # first standard deviation, as a share of the largest correction
    least_spread: float = 0.1  # that a generation keeps, in the same unit
    scale: float = 1.0  # the largest correction, as a multiple of that of BipedResidual-v0
    seed: int = 0

    def __post_init__(self) -> None:
        own = type(self).__name__
        for name, low, high in (
            ("steps", 1, 100), ("population", 2, 10_000), ("generations", 1, self.most_generations),
            ("seed", 0, None), ("elites", 1, None),
        ):  # fmt: skip
            require_integer(f"{own}.{name}", getattr(self, name), low, high)
        if self.elites > self.population:
            raise InvalidValueError(
                f"{own}.elites must be at most the population {self.population}, got {self.elites}"
            )
        self._require_positive("spread", "least_spread", "scale")

    def _require_positive(self, *names: str) -> None:
        for name in names:
            require_number(f"{type(self).__name__}.{name}", getattr(self, name), 0.0, 100.0, open_low=True)

    @property
    def size(self) -> int:
        """Numbers that are searched for."""
        return self.steps * GAIT_SIZE
