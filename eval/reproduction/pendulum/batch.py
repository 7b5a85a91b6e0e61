"""The closed loop of many pendulums at once, without Gymnasium.

Physics, actions and end of the episode are those of `rollout` on `PushRecovery/Pendulum-v0`, bit for bit, but
one compiled pass plans for all robots that still stand, and one moves them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....controllers.model.gait_box import GaitLimits
from ....controllers.model.robot import RobotModel
from ....controllers.policies.interface import Policy
from ....envs.pendulum.env import PendulumEpisodes
from ....envs.scenario.scenario import Scenario
from ...rollout.loop import Ints, Watch, run_episodes
from ...rollout.outcome import Outcome
from ...rollout.slots import Slots
from .sensor import EXACT, Measurement, PendulumSensor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plant:
    """The pendulum that is walked with, and how often."""

    robot: RobotModel = field(default_factory=RobotModel)
    limits: GaitLimits | None = None  # of the action; the paper's for the robot by default
    preset: str = "default"  # its touchdown delay and double support are the gait's
    control_hz: float = 100.0  # [Hz]

    def episodes(self, n: int) -> PendulumEpisodes:
        """N such pendulums."""
        return PendulumEpisodes(n, self.robot, self.limits, self.preset, self.control_hz)


def run_batch(
    policy: Policy,
    scenarios: Sequence[Scenario],
    plant: Plant | None = None,
    measurement: Measurement = EXACT,
    watch: Watch | None = None,
) -> list[Outcome]:
    """Run scenarios side by side, each to its own end; what comes out does not depend on its neighbours.

    Args:
        policy: takes a batch of observations and remembers nothing.
        scenarios: what happens to each pendulum.
        plant: robot, limits and planning rate; the environment's defaults without it.
        measurement: errors of what the policy sees.
        watch: called with the slots at the start of an episode and after every period, to look, not to touch.

    Raises:
        InvalidValueError: actions of another shape or not finite, or an episode that never ends.
    """
    episodes = (Plant() if plant is None else plant).episodes(len(scenarios))
    slots = _MeasuredSlots(episodes, scenarios, measurement, watch)
    found = dict(run_episodes(slots, _PlansOnce(policy), scenarios, "pendulum"))
    return [found[number] for number in range(len(scenarios))]


class _MeasuredSlots(Slots):
    """Slots whose policy sees a measurement; slot k holds scenario k."""

    def __init__(
        self,
        episodes: PendulumEpisodes,
        scenarios: Sequence[Scenario],
        measurement: Measurement,
        watch: Watch | None,
    ):
        super().__init__(episodes, watch=watch)
        self._sensor = PendulumSensor(episodes.core, scenarios, measurement)

    def observe(self, rows: Ints) -> Array:
        """What the sensor shows of the pendulums `rows`."""
        return self._sensor.look()[rows]


class _PlansOnce:
    """A policy that plans once where all see the same, as before their pushes differ."""

    def __init__(self, policy: Policy):
        self._policy = policy

    def predict(
        self, observation: Array, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, None]:
        """Actions (n, 7) of observations (n, 36)."""
        n, bits = len(observation), observation.view(np.uint64)
        if n > 1 and (bits[0] == bits[-1]).all() and (bits == bits[0]).all():
            return np.repeat(self._policy.predict(observation[:1])[0], n, axis=0), None
        return self._policy.predict(observation)[0], None
