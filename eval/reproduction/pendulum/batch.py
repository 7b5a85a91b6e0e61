"""The closed loop of many pendulums at once, without Gymnasium.

Physics, actions and end of the episode are those of `rollout` on `PushRecovery/Pendulum-v0`, bit for bit, but
one compiled pass plans for all robots that still stand, and one moves them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ....controllers.errors import InvalidValueError
from ....controllers.model.gait_box import GAIT_SIZE, GaitLimits
from ....controllers.model.robot import RobotModel
from ....controllers.policies.interface import Policy
from ....envs.episode.env import check_action
from ....envs.pendulum.core import PendulumCore
from ....envs.pendulum.env import PendulumEpisodes
from ....envs.scenario.scenario import Scenario
from ...rollout.one import MAX_STEPS
from .sensor import EXACT, Measurement, PendulumSensor

Array = NDArray[np.float64]
Watcher = Callable[[PendulumCore], None]


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


@dataclass(frozen=True)
class Ending:
    """What became of one scenario; the fields mean what they mean in `Outcome`."""

    scenario_id: str
    survived: bool
    recovered: bool
    recovered_at: float | None  # [s]
    failure_reason: str | None
    end_time: float  # [s]


def run_batch(
    policy: Policy,
    scenarios: Sequence[Scenario],
    plant: Plant | None = None,
    measurement: Measurement = EXACT,
    watch: Watcher | None = None,
) -> list[Ending]:
    """Run scenarios side by side, each to its own end; what comes out does not depend on its neighbours.

    Args:
        policy: takes a batch of observations and remembers nothing.
        scenarios: what happens to each pendulum.
        plant: robot, limits and planning rate; the environment's defaults without it.
        measurement: errors of what the policy sees.
        watch: called with the core after reset and after every period, to look, not to touch.

    Raises:
        InvalidValueError: actions of another shape or not finite, or an episode that never ends.
    """
    episodes = (Plant() if plant is None else plant).episodes(len(scenarios))
    for k, scenario in enumerate(scenarios):
        episodes.begin(k, scenario)
    core: PendulumCore = episodes.core
    sensor = PendulumSensor(core, scenarios, measurement)
    actions = np.zeros((len(scenarios), GAIT_SIZE), np.float32)
    endings: dict[int, Ending] = {}
    standing = np.arange(len(scenarios))
    if watch is not None:
        watch(core)
    for _ in range(MAX_STEPS):
        if not len(standing):
            return [endings[k] for k in range(len(scenarios))]
        actions[standing] = _act(policy, sensor.look()[standing])
        period = episodes.step(actions)
        if watch is not None:
            watch(core)
        ended = period.failed | period.truncated
        for k in standing[ended[standing]].tolist():
            endings[k] = _ending(scenarios[k], episodes, k)
        standing = standing[~ended[standing]]
    raise InvalidValueError(f"scenario {scenarios[standing[0]].id!r} did not end within {MAX_STEPS} steps")


def _act(policy: Policy, observations: Array) -> NDArray[np.float32]:
    """Actions (n, 7); where all see the same, as before their pushes differ, one plan is enough."""
    n, bits = len(observations), observations.view(np.uint64)
    if n > 1 and (bits[0] == bits[-1]).all() and (bits == bits[0]).all():
        one = check_action(policy.predict(observations[:1])[0], "actions", (1, GAIT_SIZE))
        return np.repeat(one, n, axis=0)
    return check_action(policy.predict(observations)[0], "actions", (n, GAIT_SIZE))


def _ending(scenario: Scenario, episodes: PendulumEpisodes, k: int) -> Ending:
    failure = episodes.failures[episodes.failure()[k]] or None
    recovered_at = episodes.monitor.recovered_at(k)
    return Ending(
        scenario_id=scenario.id,
        survived=failure is None,
        recovered=failure is None and recovered_at is not None,
        recovered_at=recovered_at,
        failure_reason=failure,
        end_time=float(episodes.core.state.time[k]),
    )
