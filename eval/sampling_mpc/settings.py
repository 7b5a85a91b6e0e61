"""What sampling MPC tries, how far ahead it looks, and how often."""

from __future__ import annotations

from dataclasses import dataclass

from ...controllers.errors import InvalidValueError
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.validation import require_integer, require_number

NAME = "sampling-mpc"  # of the policy
TIMES_THE_PLANNER = 25.0  # that an episode takes, about


@dataclass(frozen=True)
class SamplingMpcSettings:
    """Of a `SamplingMpcPolicy`.

    Raises:
        InvalidValueError: a field that is impossible.
    """

    steps: int = 4  # from the present one on, each with a correction of its own
    population: int = 64  # attempts of a generation
    generations: int = 1  # at most, in one planning period
    elites: int = 8  # attempts that the next generation is drawn from
    spread: float = 0.8  # first standard deviation, as a share of the largest correction
    least_spread: float = 0.1  # that a generation keeps, in the same unit
    scale: float = 1.0  # the largest correction, as a multiple of that of BipedResidual-v0
    horizon: float = 1.5  # how far ahead an attempt is simulated [s]
    check_period: float = 0.1  # a robot that was pushed is simulated anew this often [s] ...
    watch_time: float = 2.0  # ... for this long [s]
    outlast: float = 1.0  # a push that acts is taken to last longer by this share of its time so far
    seed: int = 0

    def __post_init__(self) -> None:
        for name, low, high in (
            ("steps", 1, 100), ("population", 2, 10_000), ("generations", 1, 1000), ("elites", 1, None),
            ("seed", 0, None),
        ):  # fmt: skip
            require_integer(f"SamplingMpcSettings.{name}", getattr(self, name), low, high)
        if self.elites > self.population:
            raise InvalidValueError(
                f"SamplingMpcSettings.elites must be at most the population {self.population}, got "
                f"{self.elites}"
            )
        for name in ("spread", "least_spread", "scale", "horizon", "check_period", "watch_time"):
            require_number(f"SamplingMpcSettings.{name}", getattr(self, name), 0.0, 100.0, open_low=True)
        require_number("SamplingMpcSettings.outlast", self.outlast, 0.0, 10.0)

    @property
    def size(self) -> int:
        """Numbers of an attempt."""
        return self.steps * GAIT_SIZE
