"""`PushRecovery/Pendulum-v0`: the paper's linear inverted pendulum with flywheel as an environment."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.double_support import both_stand
from ...controllers.model.gait_box import GaitLimits
from ...controllers.model.robot import RobotModel
from ...controllers.validation import require_kind
from ..episode.env import GaitEnv
from ..episode.episodes import Array, GaitEpisodes, Ints, Motion
from ..episode.vector_env import GaitVectorEnv
from ..scenario.push_distribution import PushDistribution
from .core import PendulumCore
from .dynamics import FAILURES


class PendulumEpisodes(GaitEpisodes[PendulumCore]):
    """Episodes of n pendulums."""

    failures = FAILURES
    has_double_support = True
    force_grid = 10.0
    turns, name = False, "PushRecovery/Pendulum-v0"

    def __init__(
        self,
        n: int,
        robot: RobotModel | None = None,
        limits: GaitLimits | None = None,
        preset: str = "default",
        control_hz: float = 100.0,
    ):
        robot = RobotModel() if robot is None else require_kind("robot", robot, RobotModel)
        limits = GaitLimits.of(robot) if limits is None else limits
        super().__init__(n, robot, limits, preset, control_hz)
        self.core = PendulumCore(self.n, robot, limits, control_hz, self.double_support)

    def alike(self, n: int, threads: int = 1) -> PendulumEpisodes:
        """Episodes of n such pendulums; they cost too little to share threads."""
        return PendulumEpisodes(n, self.robot, self.limits, self.preset, self.control_hz)

    def motion(self) -> Motion:
        """Steps, CoM, time and stance sides."""
        state = self.core.state
        return Motion(state.steps, state.com, state.time, state.side, state.heading)

    def failure(self) -> Ints:
        """Index into FAILURES, (n,)."""
        return self.core.state.failure

    def gaits(self, actions: NDArray[np.float32]) -> Array:
        """Gait variables (n, 7); in double support the CoP may be anywhere in the hull of both soles."""
        return self.core.gaits(actions)


class PendulumEnv(GaitEnv):
    """LIPM with flywheel (eqs. 4-9) under a gait action, integrated exactly.

    The swing foot is massless and lands where the action of the moment of touchdown wants it. With a preset
    that has double support it stays on the floor for the first part of the step. A push acts on the CoM: its
    body, its point of attack and its vertical part do not matter here.
    """

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
        episodes = PendulumEpisodes(1, robot, limits, preset, control_hz)
        super().__init__(episodes, render_mode, push_distribution)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Top view of feet, CoM, DCM and push: an image (480, 640, 3), or a window."""
        if self.render_mode is None:
            return None
        if self._picture is None:
            from .view import PendulumView

            self._picture = PendulumView(window=self.render_mode == "human")
        force = np.zeros(2)
        state, pushes = self.core.state, self.core.pushes
        for i in range(pushes.start.shape[1]):
            if pushes.start[0, i] <= state.time[0] < pushes.start[0, i] + pushes.duration[0, i]:
                force += pushes.force[0, i, :2]
        elapsed = float(state.time[0] - state.step_start[0])
        image = self._picture.draw(state, self.robot, force, both_stand(elapsed, self.double_support))
        return image if self.render_mode == "rgb_array" else None


def make_pendulum_vector(
    num_envs: int = 1,
    autoreset_mode: str = "NextStep",
    render_mode: str | None = None,
    control_hz: float = 100.0,
    preset: str = "default",
    push_distribution: dict[str, Any] | PushDistribution | None = None,
    robot: RobotModel | None = None,
    limits: GaitLimits | None = None,
) -> GaitVectorEnv:
    """Vector entry point of PushRecovery/Pendulum-v0: `num_envs` pendulums on one core.

    `autoreset_mode` and `render_mode` are those of `GaitVectorEnv`, the others those of `PendulumEnv`.
    """
    episodes = PendulumEpisodes(num_envs, robot, limits, preset, control_hz)
    return GaitVectorEnv(episodes, push_distribution, autoreset_mode, render_mode)
