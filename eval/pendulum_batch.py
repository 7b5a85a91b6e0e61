"""The closed loop of many pendulums at once, without Gymnasium.

Physics, actions and end of the episode are those of `rollout` on `PushRecovery/Pendulum-v0`, bit for bit, but
one compiled pass plans for all robots that still stand, and one moves them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..controllers.config import PlannerConfig, preset_config
from ..controllers.errors import InvalidValueError
from ..controllers.limits import GAIT_SIZE, GaitLimits
from ..controllers.network_policy import Policy
from ..controllers.nominal_gait import nominal_gait
from ..controllers.robot import RobotModel
from ..envs.gait_monitor import GaitMonitor
from ..envs.nominal_start import nominal_start
from ..envs.pendulum_core import FAILURES, PendulumCore
from ..envs.scenario import Scenario
from .pendulum_sensor import EXACT, Measurement, PendulumSensor
from .rollout import MAX_STEPS

Array = NDArray[np.float64]
Watcher = Callable[[PendulumCore], None]


@dataclass(frozen=True)
class Plant:
    """The pendulum that is walked with, and how often."""

    robot: RobotModel = field(default_factory=RobotModel)
    limits: GaitLimits | None = None  # of the action; the paper's for the robot by default
    config: PlannerConfig | None = None  # its touchdown delay and double support are the gait's; `default`
    control_hz: float = 100.0  # [Hz]

    @property
    def box(self) -> GaitLimits:
        """Limits in use."""
        return GaitLimits.of(self.robot) if self.limits is None else self.limits

    @property
    def timing(self) -> tuple[float, float]:
        """The new foot carries load this long after T, and both feet stand for that long after [s]."""
        config = self.config or preset_config("default")
        return config.touchdown_delay, config.double_support


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
    plant = Plant() if plant is None else plant
    limits = plant.box
    core = _start(plant, limits, scenarios)
    monitor = GaitMonitor(len(scenarios), plant.robot, limits, *plant.timing)
    sensor = PendulumSensor(core, scenarios, measurement)
    clock = _Clock(core, scenarios)
    actions = np.zeros((len(scenarios), GAIT_SIZE), np.float32)
    endings: dict[int, Ending] = {}
    standing = np.arange(len(scenarios))
    if watch is not None:
        watch(core)
    for _ in range(MAX_STEPS):
        if not len(standing):
            return [endings[k] for k in range(len(scenarios))]
        actions[standing] = _act(policy, sensor.look()[standing])
        core.step(core.gaits(actions), actions.astype(np.float64))
        push_end, over = clock.read()
        state = core.state
        monitor.update(state.steps, core.observation, state.com, state.time, push_end, core.command)
        if watch is not None:
            watch(core)
        ended = (state.failure != 0) | over
        for k in standing[ended[standing]].tolist():
            endings[k] = _ending(scenarios[k], core, k, monitor.recovered_at(k))
        standing = standing[~ended[standing]]
    raise InvalidValueError(f"scenario {scenarios[standing[0]].id!r} did not end within {MAX_STEPS} steps")


def _start(plant: Plant, limits: GaitLimits, scenarios: Sequence[Scenario]) -> PendulumCore:
    """All pendulums at the start of a nominal step, as `GaitEnv.reset` puts one."""
    delay, double_support = plant.timing
    core = PendulumCore(len(scenarios), plant.robot, limits, plant.control_hz, double_support)
    for k, scenario in enumerate(scenarios):
        sign = -1.0 if scenario.stance_side == "left" else 1.0
        command = (scenario.command.vx, sign * scenario.command.vy)
        gait = nominal_gait(plant.robot, limits, command, delay, double_support)
        start = nominal_start(gait, plant.robot.pelvis_width, plant.robot.omega, delay, double_support)
        values = np.array([gait.length, gait.width, gait.duration, 0.0, 0.0, 0.0, 0.0])
        core.reset(k, scenario, start, values, limits.to_action(values).astype(np.float64))
    return core


class _Clock:
    """When the last push of every pendulum ends, and whether its episode is over."""

    def __init__(self, core: PendulumCore, scenarios: Sequence[Scenario]):
        self._core = core
        shape = core.pushes.start.shape
        self._real = np.arange(shape[1]) < np.array([[len(s.pushes)] for s in scenarios])
        fixed = [np.nan if s.duration is None else s.duration for s in scenarios]
        self._fixed, self._settle = np.array(fixed), np.array([s.settle_time for s in scenarios])

    def read(self) -> tuple[Array, NDArray[np.bool_]]:
        """End of the last push (n,) [s]: 0 without pushes, inf before its event; whether time is up (n,)."""
        pushes = self._core.pushes
        ends = np.where(self._real, pushes.start + pushes.duration, -np.inf).max(axis=1, initial=-np.inf)
        push_end = np.where(self._real.any(axis=1), ends, 0.0)
        end = np.where(np.isnan(self._fixed), push_end + self._settle, self._fixed)
        return push_end, self._core.state.time >= end - 1e-9


def _act(policy: Policy, observations: Array) -> NDArray[np.float32]:
    """Actions (n, 7); where all see the same, as before their pushes differ, one plan is enough."""
    n, bits = len(observations), observations.view(np.uint64)
    if n > 1 and (bits[0] == bits[-1]).all() and (bits == bits[0]).all():
        return np.repeat(_checked(policy.predict(observations[:1])[0], 1), n, axis=0)
    return _checked(policy.predict(observations)[0], n)


def _checked(actions: object, n: int) -> NDArray[np.float32]:
    """Actions (n, 7) as the environment takes them: float32, clipped."""
    values = np.asarray(actions, dtype=np.float32)
    if values.shape != (n, GAIT_SIZE):
        raise InvalidValueError(f"actions must have shape ({n}, {GAIT_SIZE}), got {values.shape}")
    if not np.isfinite(values).all():
        raise InvalidValueError("actions must be finite, within [-1, 1]")
    return np.clip(values, -1.0, 1.0)


def _ending(scenario: Scenario, core: PendulumCore, k: int, recovered_at: float | None) -> Ending:
    failure = FAILURES[core.state.failure[k]] or None
    return Ending(
        scenario_id=scenario.id,
        survived=failure is None,
        recovered=failure is None and recovered_at is not None,
        recovered_at=recovered_at,
        failure_reason=failure,
        end_time=float(core.state.time[k]),
    )
