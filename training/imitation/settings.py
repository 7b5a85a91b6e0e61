"""What a run of imitation is: all of it, frozen."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...controllers.errors import InvalidValueError
from ...controllers.validation import require_integer, require_kind
from ...envs.scenario.push_distribution import PushDistribution

SHOWN_PUSHES = PushDistribution(impulse_max=180.0, first_step=1, settle_time=2.0)


@dataclass(frozen=True)
class ImitationSettings:
    """One run of DAgger; the defaults give a policy that walks, in a quarter of an hour of one core."""

    teacher: str = "two-stage"  # name of the planner that shows
    seed: int = 0  # of weights, pushes and batches
    robots: int = 128  # side by side
    rounds: int = 200  # of collecting and fitting
    periods: int = 50  # planning periods of all robots in a round
    batches: int = 100  # gradient steps in a round
    batch_size: int = 1024  # samples of a gradient step, from all rounds so far
    shown_rounds: int = 3  # at first, in which the teacher leads all along
    free_share: float = 0.9  # of later episodes in the end, in which it never leads; grows to that
    growth: float = 0.02  # of that share in a round, from 0.1
    longest_lead: float = 1.5  # in the other episodes the teacher leads for up to this long at first [s]
    unpushed: float = 0.3  # share of episodes without a push
    settle_rounds: int = 12  # at first, over which the observations' mean and variance are taken
    learning_rate: float = 1e-3  # of Adam; falls linearly to a tenth over the rounds
    last_batches: int = 8000  # gradient steps after the rounds, whose rate falls from the first one's to 0
    averaging: float = 0.003  # share of each of these steps in the mean of the weights, which is the result
    beta: float = 0.1  # error of a target from which the loss is no longer quadratic, in action units
    largest: float = 1.5  # samples whose target is beyond this in any joint are left out, in action units
    layers: tuple[int, ...] = (256, 256)  # widths of the hidden layers
    pushes: PushDistribution = SHOWN_PUSHES

    def __post_init__(self) -> None:
        counts = ("robots", "periods", "batches", "batch_size", "settle_rounds")
        for name in counts:
            require_integer(f"imitation setting {name}", getattr(self, name), 1)
        for name in ("rounds", "shown_rounds", "last_batches", "seed"):
            require_integer(f"imitation setting {name}", getattr(self, name), 0)
        for name in ("free_share", "unpushed", "averaging"):
            self._check(name, 0.0 <= getattr(self, name) <= 1.0, "in [0, 1]")
        for name in ("longest_lead", "learning_rate", "beta", "largest", "growth"):
            value = getattr(self, name)
            self._check(name, math.isfinite(value) and value > 0.0, "positive and finite")
        self._check("layers", all(isinstance(n, int) and n >= 1 for n in self.layers), "widths >= 1")
        require_kind("imitation setting pushes", self.pushes, PushDistribution)

    def _check(self, name: str, good: bool, wanted: str) -> None:
        if not good:
            raise InvalidValueError(f"imitation setting {name} must be {wanted}, got {getattr(self, name)!r}")

    def free(self, number: int) -> float:
        """Share of the episodes of a round that the learner walks alone from the start."""
        return 0.0 if number < self.shown_rounds else min(self.free_share, 0.1 + self.growth * number)

    def rate(self, number: int) -> float:
        """Learning rate of a round."""
        return self.learning_rate * max(0.1, 1.0 - number / max(self.rounds, 1))

    def last_rate(self, batch: int) -> float:
        """Learning rate of a gradient step after the rounds."""
        return self.learning_rate * (1.0 - batch / self.last_batches)
