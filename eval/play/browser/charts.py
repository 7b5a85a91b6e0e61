"""Strip charts: the latest seconds of the first robot, and of the second one where there is one."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...record.sampler import TORQUE
from ..lane import Lane

SPAN = 5.0  # of time shown [s]
POINTS = 200  # of a chart
COLOURS = ("#c2178a", "#222222", "#0b7a55", "#7a5195")
CHARTS = {  # title -> columns of a sample
    "to the left: DCM, CoM, CoP, CMP [m]": ("dcm_y", "com_y", "cop_y", "cmp_y"),
    "forward: DCM, CoM, CoP, CMP [m]": ("dcm_x", "com_x", "cop_x", "cmp_x"),
    "trunk: roll, pitch [rad]": ("trunk_roll", "trunk_pitch"),
    "capture margin [m]": ("capture_margin",),
}
TORQUES = "largest torque, share of the motor's"


class StripCharts:
    """Charts of one robot in the panel.

    Args:
        server: of viser.
    """

    def __init__(self, server: Any):
        from viser import uplot

        self._handles = {}
        for title, columns in {**CHARTS, TORQUES: ("torque",)}.items():
            series = [uplot.Series(label="t")]
            series += [
                uplot.Series(label=column, stroke=colour, width=1.5)
                for column, colour in zip(columns, COLOURS, strict=False)
            ]
            nothing = tuple(np.zeros(2) for _ in series)
            scales = {"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)}
            self._handles[title] = server.gui.add_uplot(
                nothing, tuple(series), title=title, scales=scales, height=130,
                legend=uplot.Legend(show=False),
            )  # fmt: skip

    def draw(self, lane: Lane) -> None:
        """Show what a robot has been through."""
        rows = list(lane.rows)[-round(SPAN / lane.period) :]
        rows = rows[:: max(1, len(rows) // POINTS)]
        if len(rows) < 2:
            return
        time = np.array([row["time"] for row in rows])
        for title, columns in CHARTS.items():
            values = [np.array([row[column] for row in rows]) for column in columns]
            self._handles[title].data = (time, *values)
        self._handles[TORQUES].data = (time, largest_torque(lane, rows))


def largest_torque(lane: Lane, rows: list[dict[str, float]]) -> np.ndarray:
    """The largest torque of all motors against its bound, by sample."""
    bounds = {name: bound for name, bound in lane.bounds.items() if name.startswith(TORQUE)}
    return np.array([max(abs(row[name]) / bound for name, bound in bounds.items()) for row in rows])
