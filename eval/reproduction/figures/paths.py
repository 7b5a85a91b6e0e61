"""Fig. 3: the motion from above, with soles, CoP, CoM, DCM and the push."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..pendulum.record import Record
from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STEM = "fig3_paths"
ARROW = 0.22  # length of the push's arrow [m]


def draw(records: Sequence[Record], directory: Path) -> list[Path]:
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
        _legend(figure)
        return style.save(figure, directory, STEM)


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


def _legend(figure: Figure) -> None:
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
