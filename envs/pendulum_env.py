"""`PushRecovery/Pendulum-v0`: the paper's linear inverted pendulum with flywheel as an environment."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..controllers.double_support import both_stand
from ..controllers.limits import GaitLimits
from ..controllers.robot import RobotModel
from .gait_env import GaitEnv
from .pendulum_core import FAILURES, PendulumCore
from .scenario import PushDistribution

Array = NDArray[np.float64]


class PendulumEnv(GaitEnv):
    """LIPM with flywheel (eqs. 4-9) under a gait action, integrated exactly.

    The swing foot is massless and lands where the action of the moment of touchdown wants it. With a preset
    that has double support it stays on the floor for the first part of the step. A push acts on the CoM: its
    body, its point of attack and its vertical part do not matter here.
    """

    has_double_support = True

    def __init__(
        self,
        render_mode: str | None = None,
        control_hz: float = 100.0,
        preset: str = "default",
        push_distribution: dict[str, Any] | PushDistribution | None = None,
        robot: RobotModel | None = None,
        limits: GaitLimits | None = None,
    ):
        """Build one pendulum.

        Args:
            render_mode: "human", "rgb_array" or None.
            control_hz: planning rate [Hz].
            preset: of the planner that belongs to this environment; its double support is the gait's.
            push_distribution: of the scenarios that `reset` draws, as an object or its dict.
            robot: physical constants; the paper's by default.
            limits: of the action; the paper's for the robot by default.
        """
        robot = RobotModel() if robot is None else robot
        limits = GaitLimits.of(robot) if limits is None else limits
        super().__init__(robot, limits, preset, control_hz, render_mode, push_distribution)
        self.core = PendulumCore(1, robot, limits, control_hz, self.double_support)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Top view of feet, CoM, DCM and push: an image (480, 640, 3), or a window."""
        if self.render_mode is None:
            return None
        if self._picture is None:
            from .pendulum_view import PendulumView

            self._picture = PendulumView(window=self.render_mode == "human")
        force = np.zeros(2)
        state, pushes = self.core.state, self.core.pushes
        for i in range(pushes.start.shape[1]):
            if pushes.start[0, i] <= state.time[0] < pushes.start[0, i] + pushes.duration[0, i]:
                force += pushes.force[0, i, :2]
        image = self._picture.draw(state, self.robot, force, self._both_stand())
        return image if self.render_mode == "rgb_array" else None

    def _motion(self) -> tuple[NDArray[np.int64], Array, Array, int]:
        state = self.core.state
        return state.steps, state.com, state.time, int(state.side[0])

    def _failure(self) -> str | None:
        return FAILURES[self.core.state.failure[0]] or None

    def _gait(self, action: NDArray[np.float32]) -> Array:
        return self.core.gaits(action[None])[0]

    def _world_info(self) -> dict[str, Any]:
        state = self.core.state
        dcm = state.com[0] + state.velocity[0] / self.robot.omega
        left, both = int(state.side[0]) == 0, self._both_stand()
        return {
            "dcm": dcm,
            "cop": state.cop[0].copy(),
            "cmp": state.cmp[0].copy(),
            "contacts": {"left": left or both, "right": not left or both},
        }

    def _both_stand(self) -> bool:
        state = self.core.state
        return both_stand(float(state.time[0] - state.step_start[0]), self.double_support)
