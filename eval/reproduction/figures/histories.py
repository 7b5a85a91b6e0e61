"""Fig. 4: the lateral motion over time, and the trunk's lean and torque where it is used."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..pendulum.record import Record
from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STEM = "fig4_histories"
MOVES = 0.01  # a trunk that leans less is not drawn [rad]


def draw(records: Sequence[Record], directory: Path) -> list[Path]:
    """Draw one lateral panel per record; below, lean and torque of the trunk of those that use it."""
    swaying = [i for i, record in enumerate(records) if np.abs(_view(record, "trunk_angle")).max() > MOVES]
    with style.print_style():
        heights = [2.1] * len(records) + [1.2] * 2 * len(swaying)
        figure = style.new_figure(style.WIDTH, sum(heights) + 0.4 * len(heights) + 0.5)
        panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        limits = style.lateral_limits(records)
        for index, (axes, record) in enumerate(zip(panels, records, strict=False)):
            _lateral(axes, record)
            style.head(axes, record, index)
            axes.set(ylim=limits, ylabel="y, left [m]")
        for place, index in enumerate(swaying):
            above = len(records) + 2 * place
            _trunk(panels[above], panels[above + 1], records[index], index)
        start = max(record.push_start for record in records)
        panels[-1].set(xlim=(start - style.BEFORE, start + style.AFTER), xlabel="time [s]")
        for axes in panels:
            axes.label_outer()
        _legend(figure)
        return style.save(figure, directory, STEM)


def _view(record: Record, name: str) -> np.ndarray:
    return getattr(record, name)[style.shown(record)]


def _moments(axes: Axes, record: Record) -> None:
    """Step boundaries as vertical lines, the push as a shaded interval."""
    for _, start, _ in style.stances(record)[1:]:
        axes.axvline(start, color=style.STEP_COLOUR, lw=1.0, zorder=1)
    end = record.push_start + record.push_duration
    axes.axvspan(record.push_start, end, color=style.PUSH_COLOUR, alpha=0.22, lw=0, zorder=0)


def _lateral(axes: Axes, record: Record) -> None:
    _moments(axes, record)
    half = record.foot_size[1] / 2
    for index, start, end in style.stances(record):
        y, side = float(record.foothold[index, 1]), int(record.foothold_side[index])
        colour, hatch = style.FOOT_COLOURS[side], "////" if side == 1 else None
        axes.fill_between([start, end], y - half, y + half, fc=colour, ec="none", alpha=0.30, zorder=2)
        if hatch:
            axes.fill_between(
                [start, end], y - half, y + half, fc="none", ec=colour, hatch=hatch, lw=0, alpha=0.6, zorder=2
            )
        during = style.shown(record) & (record.step == index)
        axes.plot(
            record.time[during], record.swing[during, 1], color=style.FOOT_COLOURS[1 - side], ls=":", lw=1.5
        )
        axes.plot(
            record.time[during], record.cop[during, 1], drawstyle="steps-pre", **style.COP_LINE, zorder=4
        )
    time = _view(record, "time")
    axes.plot(time, _view(record, "com")[:, 1], **style.COM_LINE, zorder=5)
    axes.plot(time, _view(record, "dcm")[:, 1], **style.DCM_LINE, zorder=6)
    if not record.survived:
        axes.axvline(record.time[-1], color=style.COM_COLOUR, ls="--", lw=1.0)
        axes.annotate(
            f"beyond recovery\nat t = {record.time[-1]:.2f} s", (float(record.time[-1]), 0.95), (6, 0),
            xycoords=("data", "axes fraction"), textcoords="offset points", va="top",
        )  # fmt: skip


def _trunk(angle: Axes, torque: Axes, record: Record, index: int) -> None:
    """Lean and torque of the trunk within their limits; the pitch only where it moves."""
    look = style.arm_style(record.arm)
    time, letter = _view(record, "time"), chr(ord("a") + index)
    pitched = np.abs(_view(record, "trunk_angle")[:, 0]).max() > MOVES
    for axes, name, bound in (
        (angle, "trunk_angle", record.trunk_angle_max),
        (torque, "trunk_torque", record.trunk_torque_max),
    ):
        _moments(axes, record)
        for sign in (-1.0, 1.0):
            axes.axhline(sign * bound, color="#555555", ls="--", lw=1.0)
        kind = "steps-pre" if axes is torque else "default"
        values = _view(record, name)
        axes.plot(time, values[:, 1], color=look.colour, lw=1.8, drawstyle=kind, label="roll")
        if pitched:
            axes.plot(
                time,
                values[:, 0],
                color=style.COM_COLOUR,
                ls="--",
                drawstyle=kind,
                label="pitch, positive forward",
            )
        axes.set_ylim(-1.25 * bound, 1.25 * bound)
    angle.set(ylabel="angle [rad]")
    angle.set_title(f"({letter})  trunk: roll, positive to the left; limits dashed", loc="left")
    torque.set(ylabel="torque [N m]")
    torque.set_title(f"({letter})  trunk: torque; limits dashed", loc="left")
    if pitched:
        angle.legend(loc="lower right", ncols=2, frameon=True, framealpha=0.9)


def _legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    left, right = style.FOOT_COLOURS
    entries = [
        Line2D([], [], label="DCM", **style.DCM_LINE),
        Line2D([], [], label="CoM", **style.COM_LINE),
        Line2D([], [], label="CoP", **style.COP_LINE),
        Patch(fc=style.PUSH_COLOUR, alpha=0.3, label="push"),
        Patch(fc=left, alpha=0.4, label="left sole on the ground"),
        Patch(fc="white", ec=right, hatch="////", label="right sole on the ground"),
        Line2D([], [], color="#555555", ls=":", label="swing foot"),
        Line2D([], [], color=style.STEP_COLOUR, lw=1.0, label="step boundary"),
    ]
    figure.legend(handles=entries, loc="outside lower center", ncols=4)
