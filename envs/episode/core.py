"""What episodes need of the physics of n robots: the one seam between a kind of robot and its episodes."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.nominal_start import NominalStart
from ..scenario.push_arrays import Pushes
from ..scenario.scenario import Scenario

Array = NDArray[np.float64]


class Core(Protocol):
    """n robots, none of which depends on another; the arrays are those of the moment, written in place."""

    observation: Array  # (n, 36) what policies see
    truth: Array  # (n, 36) the same without noise, to judge by
    command: Array  # (n, 3) in force: velocity in the heading frame [m/s], turn [rad/s]
    previous_action: Array  # (n, 7)
    margin: Array  # (n,) capture margin [m]
    world: Array  # (n, 6) DCM, CoP and CMP in the world [m]
    pushes: Pushes  # replaced by a larger one where a scenario has more pushes than fit

    def assign(self, k: int, scenario: Scenario) -> None:
        """Give robot k what a scenario says: errors, pushes and changes to come; put it somewhere next."""
        ...

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """Put robot k at the start of a nominal step of a scenario; `gait` (7,), `action` (7,) are its."""
        ...

    def step(self, gaits: Array, actions: Array) -> None:
        """Hold gait variables (n, 7) for one planning period; the observation repeats `actions` (n, 7)."""
        ...
