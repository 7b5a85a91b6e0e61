"""Which pushes are worth training on: those that are neither always nor never recovered from."""

from __future__ import annotations

import math

import numpy as np

DIRECTIONS = 8  # bins of the angle
WIDTH = 20.0  # of a bin of impulses, of the biped [N s]
RATE = 0.05  # of the running mean of a bin
UNKNOWN = 0.5  # share that a bin begins with


class SuccessTable:
    """Running share p of recoveries by direction and impulse, and what follows for the pushes to come.

    A push is accepted with probability  floor + (1 - floor) 4 p (1 - p):  1 where half of its kind are
    recovered from, `floor` where all or none are.

    Args:
        largest: impulse [N s].
        floor: least probability, in (0, 1].
        width: of a bin of impulses [N s].
    """

    def __init__(self, largest: float, floor: float, width: float = WIDTH):
        self.floor, self.width = floor, width
        self.shares = np.full((DIRECTIONS, max(1, math.ceil(largest / width))), UNKNOWN)

    def bin_of(self, psi: float, impulse: float) -> tuple[int, int]:
        """Bin of a direction [rad], counter-clockwise from forward, and an impulse [N s]."""
        turned = psi / math.tau % 1.0
        return min(int(turned * DIRECTIONS), DIRECTIONS - 1), min(
            int(impulse / self.width), self.shares.shape[1] - 1
        )

    def probability(self, place: tuple[int, int]) -> float:
        """Of accepting a push of a bin."""
        share = float(self.shares[place])
        return self.floor + (1.0 - self.floor) * 4.0 * share * (1.0 - share)

    def tell(self, place: tuple[int, int], recovered: bool) -> None:
        """What came of a push of a bin."""
        self.shares[place] += RATE * (float(recovered) - self.shares[place])
