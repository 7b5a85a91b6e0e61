"""The same push under two policies, a row of pictures each: small enough to stand in a page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...envs.scenario.scenario import Scenario
from ..rollout.one import GymRobot, rollout
from ..rollout.policy_source import acting_in
from .camera import Frame, middle
from .strip import PANEL, STRIP

WIDTH = 1.5  # of a picture [inch]
DPI, QUALITY = 100, 82  # dots an inch, of JPEG in per cent


class Moments:
    """Watches an episode, and draws it only at the moments of STRIP after its first push began.

    An episode that ends before all of them ends with a picture of its end.
    """

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.after: list[float] = []  # the push began [s], of each frame
        self._start: float | None = None

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
        start = (robot.info.get("push") or {}).get("start")
        if self._start is None and start is not None:
            self._start = float(start)
        if self._start is None or len(self.frames) == len(STRIP):
            return
        after = float(robot.info["time"]) - self._start
        if robot.ended or after >= STRIP[len(self.frames)] - 1e-9:
            self.frames.append(np.array(robot.env.render(), dtype=np.uint8))
            self.after.append(after)


@dataclass(frozen=True, eq=False)
class Row:
    """Pictures of one policy, and what stands above them."""

    title: str
    moments: Moments


def watch(env_id: str, policy: str, scenario: Scenario) -> Moments:
    """Run a scenario and draw it at its moments.

    Raises:
        PushRecoveryError: the policy can't act, or nothing can be drawn here.
    """
    with acting_in(env_id, policy, render_mode="rgb_array") as (env, acting, label):
        moments = Moments()
        rollout(env, acting, scenario, label, moments)
    return moments


def sheet(rows: Sequence[Row]) -> bytes:
    """Rows of pictures under their titles, as JPEG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns, height, head = len(STRIP), WIDTH * PANEL[1] / PANEL[0], 0.5  # [inch]
    figure = Figure(figsize=(columns * WIDTH, len(rows) * (height + head)), dpi=DPI)
    figure.set_facecolor("white")
    share = 1.0 / len(rows)
    for index, row in enumerate(rows):
        top = 1.0 - index * share
        figure.text(0.003, top - 0.1 * share, row.title, fontsize=10, fontweight="bold", va="center")
        for column, (frame, after) in enumerate(zip(row.moments.frames, row.moments.after, strict=True)):
            place = (column / columns, top - share, 0.99 / columns, share * height / (height + head))
            axes = figure.add_axes(place)
            axes.imshow(middle(frame, PANEL), aspect="auto")
            axes.set_title(f"{after:+.2f} s", fontsize=8, pad=2)
            axes.set_axis_off()
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_jpg(buffer, pil_kwargs={"quality": QUALITY, "optimize": True})
    return buffer.getvalue()
