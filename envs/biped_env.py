"""`PushRecovery/Biped-v0`: the 60 kg MuJoCo biped under a gait action."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..controllers.limits import GaitLimits
from ..controllers.robot import RobotModel
from .biped_core import BipedCore
from .biped_gait import FAILURES
from .gait_env import GaitEnv
from .scenario import PushDistribution

Array = NDArray[np.float64]

BIPED = RobotModel()  # Table II
BIPED_LIMITS = GaitLimits(
    length_min=-0.399,
    length_max=0.399,
    width_min=0.109,
    width_max=0.419,
    duration_min=0.18,
    duration_max=0.633,
)


class BipedEnv(GaitEnv):
    """Torque-controlled biped with waist and flat feet; whole-body control realises the gait action.

    The robot's own gait limits are narrower than the paper's where its legs are: see `BIPED_LIMITS`.
    """

    def __init__(
        self,
        render_mode: str | None = None,
        control_hz: float = 100.0,
        preset: str = "biped",
        push_distribution: dict[str, Any] | PushDistribution | None = None,
    ):
        """Build one biped.

        Args:
            render_mode: "human", "rgb_array" or None.
            control_hz: planning rate [Hz]; divides the physics rate of 500 Hz.
            preset: of the planner that belongs to this environment.
            push_distribution: of the scenarios that `reset` draws, as an object or its dict.
        """
        super().__init__(BIPED, BIPED_LIMITS, preset, control_hz, render_mode, push_distribution)
        self.core = BipedCore(1, self.robot, self.limits, control_hz)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """The robot with its push, planned foothold and DCM: an image (480, 640, 3), or a window."""
        if self.render_mode is None:
            return None
        if self._picture is None:
            from .render import BipedView

            self._picture = BipedView(window=self.render_mode == "human")
        image = self._picture.draw(self.core)
        return image if self.render_mode == "rgb_array" else None

    def _motion(self) -> tuple[NDArray[np.int64], Array, Array, int]:
        gait = self.core.gait
        return gait.steps, self.core.physics.com[:, 0, :2], gait.time, int(gait.stance[0])

    def _failure(self) -> str | None:
        return FAILURES[self.core.gait.failure[0]] or None

    def _world_info(self) -> dict[str, Any]:
        world, load = self.core.world[0].copy(), self.core.physics.load[0]
        return {
            "dcm": world[0:2],
            "cop": world[2:4],
            "cmp": world[4:6],
            "contacts": {"left": bool(load[0] > 1.0), "right": bool(load[1] > 1.0)},
        }
