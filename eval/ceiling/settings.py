"""What a search for the ceiling is, and its budget."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.settings.arms import ARMS
from ...controllers.validation import require_integer, require_number


@dataclass(frozen=True)
class CeilingSettings:
    """A search over corrections of a planner that goes on planning: a row of seven for each of some steps.

    Raises:
        UnknownNameError: no analytic policy of that name.
        InvalidValueError: another field that is impossible.
    """

    policy: str = "two-stage"  # that is corrected, by name
    steps: int = 4  # from the one that is pushed in on, each with a correction of its own
    population: int = 64  # attempts of a generation
    generations: int = 20  # at most: with the population, the budget of a push
    elites: int = 8  # attempts that the next generation is drawn from
    spread: float = 0.8  # first standard deviation, as a share of the largest correction
    least_spread: float = 0.1  # that a generation keeps, in the same unit
    scale: float = 1.0  # the largest correction, as a multiple of that of BipedResidual-v0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.policy not in ARMS:
            raise UnknownNameError("policy", self.policy, ARMS)
        for name, low, high in (
            ("steps", 1, 100), ("population", 2, 10_000), ("generations", 1, 100_000), ("seed", 0, None),
            ("elites", 1, None),
        ):  # fmt: skip
            require_integer(f"CeilingSettings.{name}", getattr(self, name), low, high)
        if self.elites > self.population:
            raise InvalidValueError(
                f"CeilingSettings.elites must be at most the population {self.population}, got {self.elites}"
            )
        for name in ("spread", "least_spread", "scale"):
            require_number(f"CeilingSettings.{name}", getattr(self, name), 0.0, 100.0, open_low=True)

    @property
    def size(self) -> int:
        """Numbers that are searched for."""
        return self.steps * GAIT_SIZE

    @property
    def budget(self) -> int:
        """Attempts at most, for one push."""
        return self.population * self.generations

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return asdict(self)
