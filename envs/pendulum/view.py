"""Top view of the pendulum: soles, swing foot, CoM, DCM, CMP and push, drawn by matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from ...controllers.model.gait_box import STEP
from ...controllers.model.observation import side_sign
from ...controllers.model.robot import RobotModel
from ..rendering import window_opens
from .dynamics import Pendulums

ARROW = 1.0 / 1000.0  # length of the push's arrow [m/N]
SPAN = 0.8  # half the width of the view [m]
FOOT_COLOURS = ("#f2851f", "#2973cc")  # left, right
FOOTHOLD_COLOUR = "#2fae8c"


class PendulumView:
    """One figure that is redrawn; needs no display unless it is a window."""

    def __init__(self, window: bool = False):
        self._window = window
        self._seen = not window or window_opens()
        if window and self._seen:
            import matplotlib.pyplot as plt

            self._figure: Any = plt.figure(figsize=(6.4, 4.8), dpi=100)
        else:
            from matplotlib.backends.backend_agg import FigureCanvasAgg

            self._figure = Figure(figsize=(6.4, 4.8), dpi=100)
            FigureCanvasAgg(self._figure)
        self._add_artists()

    def _add_artists(self) -> None:
        """What `draw` moves: soles, trunk, CoM, DCM, CMP and the arrow of a push."""
        axes = self._axes = self._figure.add_axes((0.125, 0.11, 0.85, 0.805))
        self._soles = [axes.add_patch(Rectangle((0.0, 0.0), 1.0, 1.0, ec="0.3", alpha=0.6)) for _ in range(3)]
        (self._trunk,) = axes.plot([], [], color="0.25", lw=3, solid_capstyle="round")
        self._marks = [
            *axes.plot([], [], "o", color="0.25", ms=9, label="CoM and trunk"),
            *axes.plot([], [], "o", color="#cc1a8c", ms=7, label="DCM"),
            *axes.plot([], [], "P", color="#1a59e6", ms=9, mec="w", label="CMP"),
        ]
        shape = {"arrowstyle": "-|>,head_width=0.35,head_length=0.7", "color": "#e01f1a", "lw": 4}
        self._arrow = axes.annotate("", (0.0, 0.0), (0.0, 0.0), arrowprops=shape)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.grid(color="0.9")
        axes.set_axisbelow(True)
        axes.legend(loc="upper center", ncols=3, fontsize=9, framealpha=1.0)

    def draw(
        self, state: Pendulums, robot: RobotModel, force: NDArray[np.float64], both_stand: bool = False
    ) -> NDArray[np.uint8] | None:
        """Draw pendulum 0 under a push (2,) [N]; returns the image (480, 640, 3) unless it is a window.

        In double support the foot that stood before is drawn too.
        """
        if not self._seen:
            return None
        com, stance = state.com[0], state.stance[0]
        dcm, lean = com + state.velocity[0] / robot.omega, com + 0.5 * np.sin(state.angle[0])
        self._place_soles(state, robot, both_stand)
        self._trunk.set_data([com[0], lean[0]], [com[1], lean[1]])
        for mark, place in zip(self._marks, (com, dcm, state.cmp[0]), strict=True):
            mark.set_data(place[:1], place[1:])
        self._arrow.xy, self._arrow.xyann = com, com - ARROW * force
        self._arrow.set_visible(bool(np.any(force)))
        middle = np.round((com + stance) / 2, 1)  # moves by leaps of 0.1 m: a still background
        self._axes.set(
            xlim=(middle[0] - SPAN, middle[0] + SPAN),
            ylim=(middle[1] - 0.71 * SPAN, middle[1] + 0.71 * SPAN),
            title=f"t = {state.time[0]:.2f} s",
        )
        self._figure.canvas.draw()
        if self._window:
            self._figure.canvas.flush_events()
            return None
        return np.asarray(self._figure.canvas.buffer_rgba())[..., :3].copy()

    def _place_soles(self, state: Pendulums, robot: RobotModel, both_stand: bool) -> None:
        """Soles of pendulum 0 on the floor, and the one that is planned."""
        side, stance, plan = int(state.side[0]), state.stance[0], state.plan[0]
        target = stance + np.array([plan[STEP], side_sign(side) * plan[STEP + 1]])
        drawn = [
            (stance, FOOT_COLOURS[side], "-"),
            (target, FOOTHOLD_COLOUR, "--"),
            (state.lift[0], FOOT_COLOURS[1 - side], "-"),
        ]
        for sole, (centre, fill, line) in zip(self._soles, drawn, strict=True):
            corner = centre - np.array([robot.foot_length, robot.foot_width]) / 2
            sole.set(xy=corner.tolist(), width=robot.foot_length, height=robot.foot_width, fc=fill, ls=line)
        self._soles[2].set_visible(both_stand)

    def close(self) -> None:
        """Close the window."""
        if self._window and self._seen:
            import matplotlib.pyplot as plt

            plt.close(self._figure)
