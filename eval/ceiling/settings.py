"""What a search for the ceiling is, and its budget."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from ...controllers.errors import UnknownNameError
from ...controllers.settings.arms import ARMS
from ..sampling_mpc.search_settings import SearchSettings


@dataclass(frozen=True)
class CeilingSettings(SearchSettings):
    """Of the search for one push, whose first step is the one that is pushed in.

    Raises:
        UnknownNameError: no analytic policy of that name.
        InvalidValueError: another field that is impossible.
    """

    most_generations: ClassVar[int] = 100_000

    generations: int = 20  # at most: with the population, the budget of a push
    policy: str = "two-stage"  # that is corrected, by name

    def __post_init__(self) -> None:
        if self.policy not in ARMS:
            raise UnknownNameError("policy", self.policy, ARMS)
        super().__post_init__()

    @property
    def budget(self) -> int:
        """Attempts at most, for one push."""
        return self.population * self.generations

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return asdict(self)
