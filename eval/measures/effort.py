"""What an episode took: torque, energy, lean, and how near it came to a fall, by planning period."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.observation import TRUNK_ANGLE
from ...controllers.whole_body.kinematics import NU, NV
from ...envs.biped.env import BipedEpisodes
from ...envs.biped.robots.indices import MISSING
from ...envs.episode.episodes import GaitEpisodes, Period

Array = NDArray[np.float64]
Measures = dict[str, float | int | None]
DIGITS = 6  # of a number in a row, after the point
UNITS = {  # of what `EffortMeter.of` tells
    "steps": "1", "smallest_margin": "m", "dcm_error": "m", "velocity_error": "m/s", "trunk_excursion": "rad",
    "peak_torque": "N m", "mean_torque": "N m", "energy": "J",
}  # fmt: skip
JUDGED = {"dcm_error": 1, "velocity_error": 3}  # touchdowns after which it is known


class EffortMeter:
    """Measures n robots that share a core, at the end of every planning period; it only looks.

    Torques and rates are those of the period's last physics step, true ones where sensors tell others. Over
    the periods i of an episode, each dt long, with motors j:

        peak torque = max |tau_ij|,  mean torque = mean |tau_ij|,  energy = sum |tau_ij w_ij| dt.

    Args:
        episodes: of the robots. Pendulums have no motors.
    """

    def __init__(self, episodes: GaitEpisodes):
        self._episodes, n = episodes, episodes.n
        self._core: Any = episodes.core
        self._dt = 1.0 / episodes.control_hz
        self._motors = _motors(episodes)
        self._periods = np.zeros(n, np.int64)
        self._margin, self._lean = np.zeros(n), np.zeros(n)
        self._peak, self._torque, self._power = np.zeros(n), np.zeros(n), np.zeros(n)

    def begin(self, k: int) -> None:
        """Forget robot k, which begins an episode."""
        self._periods[k], self._margin[k] = 0, np.inf
        for sums in (self._lean, self._peak, self._torque, self._power):
            sums[k] = 0.0

    def look(self) -> None:
        """Take in the period that has ended, for all robots."""
        core, largest, added = self._core, np.maximum.reduce, np.add.reduce
        self._periods += 1
        np.fmin(self._margin, core.margin, out=self._margin)
        np.fmax(self._lean, largest(np.abs(core.truth[:, TRUNK_ANGLE]), axis=1), out=self._lean)
        if self._motors:
            torque = np.abs(self._of_motors(core.physics.ctrl))
            np.fmax(self._peak, largest(torque, axis=1), out=self._peak)
            self._torque += added(torque, axis=1)
            torque *= self._of_motors(self._rates())
            self._power += added(np.abs(torque, out=torque), axis=1)

    def _of_motors(self, values: Array) -> Array:
        """Columns (n, motors) of values (n, 14)."""
        return values if len(self._motors) == NU else values.take(self._motors, axis=1)

    def _rates(self) -> Array:
        """True rates of the joints that control moves, (n, 14) [rad/s]; held ones come after them."""
        exact, senses = self._core.physics.qvel, self._core.senses
        if senses.last.judged is not self._core.physics:
            exact = np.where(senses.onboard[:, None], senses.last.judged.qvel, exact)
        return exact[:, NV - NU : NV]

    def of(self, k: int) -> Measures:
        """What robot k has done in its episode, in UNITS; None where it is not known."""
        judged = self._episodes.monitor.state
        found: dict[str, float] = {
            "smallest_margin": self._margin.item(k),
            "dcm_error": judged.error.item(k, 0),
            "velocity_error": judged.speed_error.item(k),
            "trunk_excursion": self._lean.item(k),
        }
        if self._motors:
            samples = max(self._periods.item(k), 1) * len(self._motors)
            found["peak_torque"] = self._peak.item(k)
            found["mean_torque"] = self._torque.item(k) / samples
            found["energy"] = self._power.item(k) * self._dt
        touchdowns = judged.touchdowns.item(k)
        told = {
            name: round(value, DIGITS) if math.isfinite(value) and touchdowns >= JUDGED.get(name, 0) else None
            for name, value in found.items()
        }
        return {"steps": self._episodes.motion().steps.item(k), **told}


class StepMeter(EffortMeter):
    """Of the one robot of an environment; it looks by itself, at each period that an action is held for."""

    def begin(self, k: int) -> None:
        """Forget the robot, and look at every planning period from here on."""
        super().begin(k)
        self._episodes.step = self  # type: ignore[method-assign]

    def __call__(self, actions: NDArray[np.float32]) -> Period:
        """One planning period of the episodes, looked at."""
        period = type(self._episodes).step(self._episodes, actions)
        self.look()
        return period

    def of(self, k: int) -> Measures:
        """What the robot has done in its episode, which is over."""
        vars(self._episodes).pop("step", None)
        return super().of(k)


def _motors(episodes: GaitEpisodes) -> list[int]:
    """Which of control's 14 motors the robot has; none for a pendulum."""
    if not isinstance(episodes, BipedEpisodes):
        return []
    return [i for i, motor in enumerate(episodes.core.body.indices.motors) if motor != MISSING]
