"""What a policy sees of a pendulum: the truth, or a noisy and late measurement of its motion.

The measured DCM of period k is xi_k + n_k with white noise n_k. The CoM is shifted alike, so that
xi = com + v / omega still holds, and the push estimate (xi_k - predicted xi_k) / (e - 1), e = exp(omega dt),
becomes that of an observer who knows no other DCM: it gains (n_k - e n_{k-1}) / (e - 1). A delay of d periods
shows DCM, CoM, velocity and push estimate of d periods ago; feet, trunk and clock are those of now.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....controllers.errors import InvalidValueError, is_finite_number
from ....controllers.model.frame import side_sign
from ....controllers.model.observation import COM, COM_VELOCITY, DCM, PUSH_ESTIMATE
from ....envs.pendulum.core import PendulumCore
from ....envs.scenario.scenario import Scenario

Array = NDArray[np.float64]

BLOCK = 256  # periods whose noise is drawn at once; changes no number


@dataclass(frozen=True)
class Measurement:
    """Errors of what the policy sees."""

    dcm_noise: float = 0.0  # standard deviation of every axis and period [m]
    delay: int = 0  # whole planning periods

    def __post_init__(self) -> None:
        if not (is_finite_number(self.dcm_noise) and self.dcm_noise >= 0):
            raise InvalidValueError(f"dcm_noise must be finite and >= 0 [m], got {self.dcm_noise!r}")
        if isinstance(self.delay, bool) or not isinstance(self.delay, int) or self.delay < 0:
            raise InvalidValueError(f"delay must be an integer >= 0 [periods], got {self.delay!r}")


EXACT = Measurement()


class PendulumSensor:
    """Observations of the pendulums of a core under measurement errors.

    The noise of a pendulum is a function of its scenario's seed and the period alone.
    """

    def __init__(self, core: PendulumCore, scenarios: Sequence[Scenario], measurement: Measurement = EXACT):
        """Set up.

        Raises:
            InvalidValueError: measurement errors on top of a scenario's own noise.
        """
        if measurement != EXACT and (noisy := [s.id for s in scenarios if s.errors.dcm_noise > 0]):
            raise InvalidValueError(f"scenario {noisy[0]!r} has dcm_noise of its own beside {measurement}")
        self._core, self._measurement = core, measurement
        self._generators = [np.random.default_rng(np.random.SeedSequence(s.noise_seed)) for s in scenarios]
        self._noise = np.zeros((len(scenarios), BLOCK, 2))
        self._last_noise = np.zeros((len(scenarios), 2))
        self._past: deque[tuple[Array, Array, Array]] = deque(maxlen=measurement.delay + 1)
        self._period = 0

    def look(self) -> Array:
        """Observations (n, OBSERVATION_SIZE); call once per period. Without errors the core's own array."""
        if self._measurement == EXACT:
            return self._core.observation
        self._past.append(self._measure())
        self._period += 1
        com, velocity, push = self._past[0]  # of reset, while no older one is known
        state = self._core.state
        sign = np.stack([np.ones(len(state.side)), side_sign(state.side)], axis=1)
        seen = self._core.observation.copy()
        seen[:, COM] = sign * (com - state.stance)
        seen[:, COM_VELOCITY] = sign * velocity
        seen[:, DCM] = seen[:, COM] + seen[:, COM_VELOCITY] / self._core.robot.omega
        seen[:, PUSH_ESTIMATE] = sign * push
        return seen

    def _measure(self) -> tuple[Array, Array, Array]:
        """CoM, velocity and push estimate of now, each (n, 2), world frame."""
        state = self._core.state
        noise = self._draw()
        growth = math.exp(self._core.robot.omega * self._core.dt)
        push = state.push.copy()
        if self._period > 0:  # the first period has no DCM before it
            push += (noise - growth * self._last_noise) / (growth - 1.0)
        self._last_noise = noise
        return state.com + noise, state.velocity.copy(), push

    def _draw(self) -> Array:
        """Noise of this period (n, 2) [m], world frame."""
        if self._measurement.dcm_noise == 0.0:
            return self._last_noise
        index = self._period % BLOCK
        if index == 0:
            for block, generator in zip(self._noise, self._generators, strict=True):
                block[:] = generator.standard_normal((BLOCK, 2))
        return self._measurement.dcm_noise * self._noise[:, index]
