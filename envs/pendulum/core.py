"""n pendulums behind the arrays and calls that episodes need of a core."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.capturability import capture_constants
from ...controllers.model.double_support import check_double_support, gaits_of_actions
from ...controllers.model.frame import side_sign
from ...controllers.model.gait_box import DURATION, GAIT_SIZE, GaitLimits
from ...controllers.model.nominal_start import NominalStart
from ...controllers.model.observation import OBSERVATION_SIZE, WORLD_SIZE
from ...controllers.model.robot import RobotModel
from ..scenario.command_schedule import assign_changes, empty_schedule, follow_all
from ..scenario.push import SIDES
from ..scenario.push_arrays import assign_pushes, empty_pushes
from ..scenario.scenario import Scenario
from .dynamics import Pendulums, Physics, advance
from .model_errors import assign_errors, no_errors, show
from .observation import check_failures, observe

Array = NDArray[np.float64]


class PendulumCore:
    """n pendulums; arrays are indexed by pendulum, and none depends on another."""

    def __init__(
        self,
        n: int,
        robot: RobotModel,
        limits: GaitLimits,
        control_hz: float = 100.0,
        double_support: float = 0.0,
    ):
        check_double_support(double_support, limits)
        self.n, self.robot, self.limits, self.dt = n, robot, limits, 1.0 / control_hz
        self.physics = Physics(
            robot.omega, robot.mass, robot.cmp_per_trunk_acceleration, robot.foot_length / 2,
            robot.foot_width / 2, robot.trunk_torque_max / robot.trunk_inertia, robot.trunk_angle_max,
            double_support,
        )  # fmt: skip
        self.capture = capture_constants(robot, limits)
        self.state = Pendulums(
            com=np.zeros((n, 2)), velocity=np.zeros((n, 2)), angle=np.zeros((n, 2)), rate=np.zeros((n, 2)),
            stance=np.zeros((n, 2)), lift=np.zeros((n, 2)), plan=np.zeros((n, GAIT_SIZE)),
            cop=np.zeros((n, 2)), cmp=np.zeros((n, 2)), push=np.zeros((n, 2)),
            time=np.zeros(n), step_start=np.zeros(n), side=np.zeros(n, np.int64),
            steps=np.zeros(n, np.int64), failure=np.zeros(n, np.int64), heading=np.zeros(n),
        )  # fmt: skip
        self.state.plan[:, DURATION] = limits.duration_max  # of pendulums that have not been reset
        self.pushes = empty_pushes(n, 1)
        self.schedule, self.command = empty_schedule(n), np.zeros((n, 3))  # to come, in force
        self.previous_action = np.zeros((n, GAIT_SIZE))
        self.observation = np.zeros((n, OBSERVATION_SIZE))
        self.truth = np.zeros((n, OBSERVATION_SIZE))  # observation without its noise, to judge by
        self.errors = no_errors(n, self.dt)
        self.margin = np.zeros(n)
        self.world = np.zeros((n, WORLD_SIZE))  # DCM, CoP and CMP in the world [m]

    def assign(self, k: int, scenario: Scenario) -> None:
        """Give pendulum k the errors, the pushes and the changes of command of a scenario."""
        assign_errors(self.errors, k, scenario, self.dt)
        self.pushes = assign_pushes(self.pushes, k, scenario)
        self.schedule = assign_changes(self.schedule, k, scenario)

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """Put pendulum k at the start of a step; `gait` (7,) and `action` (7,) are the nominal ones."""
        self.assign(k, scenario)
        s = self.state
        for field in s:
            field[k] = 0
        s.side[k] = SIDES.index(scenario.stance_side)
        sign = side_sign(s.side[k])
        s.com[k] = start.com[0], sign * start.com[1]
        s.velocity[k] = start.com_velocity[0], sign * start.com_velocity[1]
        s.lift[k] = start.swing[0], sign * start.swing[1]
        s.plan[k] = gait
        self.command[k, :2], self.previous_action[k] = (scenario.command.vx, scenario.command.vy), action
        self._look(k, k + 1)

    def gaits(self, actions: NDArray[Any]) -> Array:
        """Gait variables (n, 7) that actions (n, 7) in [-1, 1] mean now, see `gaits_of_actions`."""
        return gaits_of_actions(self.limits, self.observation, actions, self.physics.double_support)

    def step(self, gaits: Array, actions: Array) -> None:
        """Hold gait variables (n, 7) for one control cycle; `actions` (n, 7) go into the observation."""
        self.state.plan[:] = gaits
        self.previous_action[:] = actions
        advance(self.state, self.pushes, self.errors, self.dt, self.physics)
        self.errors.period[self.state.failure == 0] += 1
        self._look(0, self.n)

    def _look(self, first: int, end: int) -> None:
        """Observe pendulums first..end-1."""
        state, p = self.state, self.physics
        follow_all(self.schedule, state.time, self.command, first, end)
        observe(state, self.command, self.previous_action, p, self.truth, self.world, first, end)
        check_failures(state, self.truth, p.double_support, self.capture, self.margin, first, end)
        show(state, self.errors, p, self.dt, self.truth, self.observation, first, end)
