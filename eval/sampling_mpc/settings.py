"""What sampling MPC tries, how far ahead it looks, and how often."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ...controllers.validation import require_number
from .search_settings import SearchSettings

NAME = "sampling-mpc"  # of the policy
TIMES_THE_PLANNER = 25.0  # that an episode takes, about


@dataclass(frozen=True)
class SamplingMpcSettings(SearchSettings):
    """Of a `SamplingMpcPolicy`; `generations` are those of one planning period.

    Raises:
        InvalidValueError: a field that is impossible.
    """

    most_generations: ClassVar[int] = 1000

    horizon: float = 1.5  # how far ahead an attempt is simulated [s]
    check_period: float = 0.1  # a robot that was pushed is simulated anew this often [s] ...
    watch_time: float = 2.0  # ... for this long [s]
    outlast: float = 1.0  # a push that acts is taken to last longer by this share of its time so far

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_positive("horizon", "check_period", "watch_time")
        require_number("SamplingMpcSettings.outlast", self.outlast, 0.0, 10.0)
