"""Top view of the pendulum: soles, swing foot, CoM, DCM, CMP and push, drawn by matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from ..controllers.robot import RobotModel
from .pendulum_core import Pendulums

ARROW = 1.0 / 1000.0  # length of the push's arrow [m/N]
SPAN = 1.2  # half the width of the view [m]


class PendulumView:
    """One figure that is redrawn; needs no display unless it is a window."""

    def __init__(self, window: bool = False):
        self._window = window
        if window:
            import matplotlib.pyplot as plt

            self._figure: Any = plt.figure(figsize=(6.4, 4.8), dpi=100)
        else:
            from matplotlib.backends.backend_agg import FigureCanvasAgg

            self._figure = Figure(figsize=(6.4, 4.8), dpi=100)
            FigureCanvasAgg(self._figure)

    def draw(
        self, state: Pendulums, robot: RobotModel, force: NDArray[np.float64]
    ) -> NDArray[np.uint8] | None:
        """Draw pendulum 0 under a push (2,) [N]; returns the image (480, 640, 3) unless it is a window."""
        self._figure.clear()
        axes = self._figure.add_subplot(111, aspect="equal")
        com, stance = state.com[0], state.stance[0]
        dcm = com + state.velocity[0] / robot.omega
        sign = -1.0 if state.side[0] == 0 else 1.0
        target = stance + np.array([state.plan[0, 0], sign * state.plan[0, 1]])
        for centre, fill, line in ((stance, "0.6", "-"), (target, "none", "--")):
            corner = centre - np.array([robot.foot_length, robot.foot_width]) / 2
            corner = (float(corner[0]), float(corner[1]))
            axes.add_patch(Rectangle(corner, robot.foot_length, robot.foot_width, ec="k", fc=fill, ls=line))
        axes.plot(*com, "o", color="tab:blue", label="CoM")
        axes.plot(*dcm, "x", color="tab:red", label="DCM")
        axes.plot(*state.cmp[0], "+", color="tab:green", label="CMP")
        lean = com + 0.5 * np.sin(state.angle[0])
        axes.plot([com[0], lean[0]], [com[1], lean[1]], color="tab:blue", lw=2)
        if np.any(force):
            tip = {"arrowstyle": "->", "color": "tab:orange", "lw": 3}
            axes.annotate("", com, com - ARROW * force, arrowprops=tip)
        axes.set(xlim=(stance[0] - SPAN, stance[0] + SPAN), ylim=(stance[1] - 0.9, stance[1] + 0.9))
        axes.set(xlabel="x [m]", ylabel="y [m]", title=f"t = {state.time[0]:.2f} s")
        axes.legend(loc="upper right")
        self._figure.canvas.draw()
        if self._window:
            self._figure.canvas.flush_events()
            return None
        return np.asarray(self._figure.canvas.buffer_rgba())[..., :3].copy()

    def close(self) -> None:
        """Close the window."""
        if self._window:
            import matplotlib.pyplot as plt

            plt.close(self._figure)
