"""Figs. 3, 4 and 7 of the paper: paths from above, histories, largest push by direction.

Fig. 3: the motion from above, with soles, CoP, CoM, DCM and the push.

Fig. 4: the lateral motion over time, and the trunk's lean and torque where it is used.

Fig. 7: the largest recoverable push by direction, every arm against the closed-form limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import style
from .recording import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PATHS_STEM = "fig3_paths"
ARROW = 0.22  # length of the push's arrow [m]


def draw_paths(records: Sequence[Record], directory: Path) -> list[Path]:
    """Draw one panel per record from above: x forward to the right, y to the left upwards, true to scale."""
    with style.print_style():
        x_limits, y_limits = _limits(records)
        height = (style.WIDTH - 0.8) * (y_limits[1] - y_limits[0]) / (x_limits[1] - x_limits[0])
        figure = style.new_figure(style.WIDTH, len(records) * (height + 0.35) + 0.95)
        panels = figure.subplots(len(records), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for index, (axes, record) in enumerate(zip(panels, records, strict=True)):
            axes.set(xlim=x_limits, ylim=y_limits, aspect="equal", ylabel="y, left [m]")
            style.head(axes, record, index)
            _soles(axes, record)
            _curves(axes, record)
            _push(axes, record)
            if not record.survived:
                _fall(axes, record, y_limits)
        panels[-1].set_xlabel("x, forward [m]")
        _paths_legend(figure)
        return style.save(figure, directory, PATHS_STEM)


def _limits(records: Sequence[Record]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of x and y that hold soles and pushes of all, and the curves of those that stay up [m]."""
    low_y, high_y = style.lateral_limits(records, margin=0.09)
    x: list[float] = []
    for record in records:
        feet = record.foothold[[i for i, _, _ in style.stances(record)], 0]
        x += [feet.min() - record.foot_size[0] / 2, feet.max() + record.foot_size[0] / 2]
        if record.survived:
            x += [record.dcm[style.shown(record), 0].max()]
        tail = _pushed_com(record) - _arrow(record)
        low_y, high_y = min(low_y, tail[1] - 0.08), max(high_y, tail[1] + 0.08)
    return (float(min(x)) - 0.05, float(max(x)) + 0.05), (float(low_y), float(high_y))


def _pushed_com(record: Record) -> np.ndarray:
    """CoM at the onset of the push [m]."""
    return record.com[min(int(np.searchsorted(record.time, record.push_start)), len(record.com) - 1)]


def _arrow(record: Record) -> np.ndarray:
    """The push's arrow from tail to tip, of a fixed length [m]."""
    return ARROW * record.push_force / max(float(np.linalg.norm(record.push_force)), 1e-9)


def _curves(axes: Axes, record: Record) -> None:
    """CoP: thick within a sole, thin where it jumps to the next one; CoM; DCM."""
    view = style.shown(record)
    axes.plot(*record.cop[view].T, color=style.COP_COLOUR, ls=(0, (2, 2)), lw=0.8, zorder=4)
    for index, _, _ in style.stances(record):
        cop = record.cop[view & (record.step == index)]
        axes.plot(*cop.T, color=style.COP_COLOUR, lw=3.2, solid_capstyle="round", zorder=5)
        axes.plot(*cop[-1:].T, "o", color=style.COP_COLOUR, ms=5, zorder=5)
    axes.plot(*record.com[view].T, **style.COM_LINE, zorder=6)
    axes.plot(*record.dcm[view].T, **style.DCM_LINE, zorder=7)


def _push(axes: Axes, record: Record) -> None:
    tip: Any = _pushed_com(record)
    tail: Any = tip - _arrow(record)
    arrow = {"arrowstyle": "-|>,head_width=0.35,head_length=0.7", "color": style.PUSH_COLOUR, "lw": 3}
    axes.annotate("", tip, tail, arrowprops={**arrow, "shrinkA": 0, "shrinkB": 0}, zorder=8)
    axes.annotate(
        style.push_text(record), tail, (5, 1), textcoords="offset points", color=style.PUSH_COLOUR,
        weight="bold", va="bottom", zorder=9,
    )  # fmt: skip


def _fall(axes: Axes, record: Record, y_limits: tuple[float, float]) -> None:
    """Say where the DCM is lost: beside the last of its samples in view."""
    inside = (record.dcm[:, 1] > y_limits[0]) & (record.dcm[:, 1] < y_limits[1])
    last: Any = record.dcm[np.flatnonzero(inside)[-1]]
    axes.annotate(
        f"DCM beyond recovery\nat t = {record.time[-1]:.2f} s", last, (30, 6), textcoords="offset points",
        color=style.DCM_COLOUR, va="bottom",
    )  # fmt: skip


def _soles(axes: Axes, record: Record) -> None:
    """Soles that were stood on, left filled and right hatched, numbered by touchdown."""
    from matplotlib.patches import Rectangle

    length, width = record.foot_size
    for index, _, _ in style.stances(record):
        centre, side = record.foothold[index], int(record.foothold_side[index])
        corner = (float(centre[0]) - length / 2, float(centre[1]) - width / 2)
        colour = style.FOOT_COLOURS[side]
        axes.add_patch(Rectangle(corner, length, width, ec="none", fc=colour, alpha=0.30, zorder=2))
        hatch = "////" if side == 1 else None
        axes.add_patch(
            Rectangle(corner, length, width, ec=colour, fc="none", lw=1.2, hatch=hatch, alpha=0.8, zorder=3)
        )
        axes.annotate(
            f"{index}", (corner[0], float(centre[1])), (4, 0), textcoords="offset points", va="center",
            bbox={"fc": "white", "ec": "none", "alpha": 0.75, "pad": 0.6}, zorder=8,
        )  # fmt: skip


def _paths_legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    left, right = style.FOOT_COLOURS
    cop = {"color": style.COP_COLOUR, "lw": 3.2, "marker": "o", "ms": 5, "solid_capstyle": "round"}
    entries = [
        Line2D([], [], label="DCM", **style.DCM_LINE),
        Line2D([], [], label="CoM", **style.COM_LINE),
        Line2D([], [], label="CoP in a sole, end marked", **cop),
        Line2D([], [], color=style.COP_COLOUR, ls=(0, (2, 2)), lw=0.8, label="CoP, jump to the next sole"),
        Patch(fc=left, ec=left, alpha=0.5, label="left sole (number: touchdown)"),
        Patch(fc="white", ec=right, hatch="////", label="right sole"),
    ]
    figure.legend(handles=entries, loc="outside lower center", ncols=3)


HISTORIES_STEM = "fig4_histories"
MOVES = 0.01  # a trunk that leans less is not drawn [rad]


def draw_histories(records: Sequence[Record], directory: Path) -> list[Path]:
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
        _histories_legend(figure)
        return style.save(figure, directory, HISTORIES_STEM)


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


def _histories_legend(figure: Figure) -> None:
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


Curve = Sequence[tuple[float, float]]  # psi [deg], force [N] or impulse [N s]

LIMITS_STEM = "fig7_limits"
RADIAL_LABELS = (
    75.0  # where the radial axis is labelled: pushes inward are the weakest, so there is room [deg]
)


def draw_limits(
    curves: Mapping[str, Curve],
    limits: Mapping[str, Curve],
    directory: Path,
    stem: str = LIMITS_STEM,
    title: str = "Largest recoverable push of 0.1 s at the start of a left stance, stepping in place",
    unit: str = "N",
) -> list[Path]:
    """Draw a polar map: forward is up, psi counter-clockwise, so that left is left.

    Args:
        curves: by arm, points (psi [deg], largest push) in the order of psi; closed here.
        limits: the same by closed-form limit; the names of `style.LIMIT_STYLES` have looks of their own.
        directory: where the pictures go.
        stem: of their names.
        title: over the picture.
        unit: of the radius.
    """
    with style.print_style():
        figure = style.new_figure(style.WIDTH, style.WIDTH + 0.9)
        axes: Any = figure.add_subplot(projection="polar")
        axes.set_theta_zero_location("N")
        for label, curve in limits.items():
            look = style.limit_style(label)
            axes.plot(*_closed(curve), color=look.colour, ls=look.line, lw=1.6, label=look.label, zorder=2)
        for arm, curve in curves.items():
            look = style.arm_style(arm)
            axes.plot(
                *_closed(curve), color=look.colour, ls=look.line, lw=1.5, marker=look.marker, ms=3.6,
                mew=0.9, label=look.label, zorder=3,
            )  # fmt: skip
        largest = max(radius for curve in (*curves.values(), *limits.values()) for _, radius in curve)
        _scales(axes, largest, unit)
        figure.suptitle(title, fontsize=10.5, weight="bold")
        figure.legend(loc="outside lower center", ncols=3, columnspacing=1.4, handlelength=3.4)
        return style.save(figure, directory, stem)


def _closed(curve: Curve) -> tuple[list[float], list[float]]:
    points = [*curve, curve[0]]
    return [math.radians(psi) for psi, _ in points], [radius for _, radius in points]


def _scales(axes: Any, largest: float, unit: str) -> None:
    """Label both coordinates and say which way the robot looks and stands."""
    angles = range(0, 360, 30)
    labels = [f"{a}°" if a <= 180 else f"\N{MINUS SIGN}{360 - a}°" for a in angles]
    axes.set_thetagrids(angles, labels)
    axes.set_rlim(0.0, 1.03 * largest)
    radii = [float(radius) for radius in axes.get_yticks() if 0.0 < radius < largest]
    axes.set_rgrids(radii, [])
    for radius in radii:
        axes.text(
            math.radians(RADIAL_LABELS), radius, f"{radius:g} {unit}", ha="center", va="center", zorder=6,
            bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.8},
        )  # fmt: skip
    place: dict[str, Any] = {"transform": axes.transAxes, "ha": "center", "va": "center", "weight": "bold"}
    axes.text(0.5, 1.075, "ψ = 0: forward", **place)
    axes.text(0.5, -0.075, "backward", **place)
    axes.text(-0.11, 0.5, "left: towards the stance foot", rotation=90, **place)
    axes.text(1.11, 0.5, "right: towards the swing foot", rotation=-90, **place)
