"""Fig. 5 of the paper: the motion as a cartoon, and as a short film.

Fig. 5: the motion as a cartoon, the lateral plane seen from behind.

Fig. 5 as a short film: the cases side by side at half speed, a GIF that loops.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...controllers.files import write_atomically
from . import style
from .recording import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STEM = "fig5_cartoon"
INSTANTS = (-0.40, 0.05, 0.25, 0.45, 0.65, 0.85, 1.05, 1.55, 2.05)  # from the onset of the push [s]
SPACING = 0.95  # between the robots [m]
TRUNK, HEAD = 0.50, 0.10  # length of the trunk, radius of the head [m]
ARROW = 0.33  # length of the push's arrow [m]
HEIGHT = 1.78  # of the view [m]
GROUND, MARKS = -0.17, -0.08  # lower edge of the view; where CoP and DCM are marked, below the soles [m]
SOLE = 0.045  # its thickness [m]


def draw(records: Sequence[Record], directory: Path) -> list[Path]:
    """Draw one row per record: the robot at the same instants around the push, time to the right."""
    with style.print_style():
        left, right = _reach(records)
        span = SPACING * (len(INSTANTS) - 1) + left + right
        scale = (style.WIDTH - 0.65) / span
        figure = style.new_figure(style.WIDTH, len(records) * (scale * (HEIGHT - GROUND) + 0.45) + 0.75)
        rows = figure.subplots(len(records), 1, squeeze=False)[:, 0]
        for index, (axes, record) in enumerate(zip(rows, records, strict=True)):
            style.head(axes, record, index)
            axes.set(xlim=(-left, span - left), ylim=(GROUND, HEIGHT), aspect="equal")
            axes.set(yticks=(0.0, 0.5, 1.0, 1.5), ylabel="height [m]")
            axes.spines[["top", "right"]].set_visible(False)
            _row(axes, record)
        rows[0].set_title("seen from behind", loc="right", fontsize=9.5)
        rows[-1].set_xlabel(
            "time since the onset of the push [s]; dotted: where the CoM was at the first instant"
        )
        legend(figure)
        return style.save(figure, directory, STEM)


def draw_robot(axes: Axes, record: Record, sample: int, shift: float, width: float = 1.0) -> None:
    """Draw one instant: legs, soles, trunk, head, CoM, DCM, CoP and push.

    Args:
        axes: their x is to the robot's right [m], their y the height [m].
        record: the episode.
        sample: index of the instant.
        shift: x of the world's y = 0 [m].
        width: factor on the widths of the lines.
    """
    from matplotlib.patches import Circle

    across = shift - float(record.com[sample, 1])
    pelvis = (across, record.com_height)
    stance_side = int(record.foothold_side[int(record.step[sample])])
    swing = record.swing[sample]
    _leg(axes, pelvis, (shift - float(swing[1]), float(swing[2])), 1 - stance_side, record, width)
    _leg(axes, pelvis, (shift - float(record.stance[sample, 1]), 0.0), stance_side, record, width)
    lean = float(record.trunk_angle[sample, 1])
    up = np.array([-math.sin(lean), math.cos(lean)])
    neck, skull = pelvis + TRUNK * up, pelvis + (TRUNK + HEAD) * up
    axes.plot(
        *zip(pelvis, neck, strict=True), color="#444444", lw=5 * width, solid_capstyle="round", zorder=5
    )
    axes.add_patch(
        Circle((float(skull[0]), float(skull[1])), HEAD, fc="#dddddd", ec="#444444", lw=1.4, zorder=5)
    )
    axes.plot(*pelvis, "o", color=style.COM_COLOUR, mec="white", ms=6.5 * width, zorder=6)
    marks = ((record.cop, "^", style.COP_COLOUR, 8.0), (record.dcm, "D", style.DCM_COLOUR, 4.5))
    for points, marker, colour, size in marks:  # the smaller one last: both show where they coincide
        place = shift - float(points[sample, 1])
        axes.plot(place, MARKS, marker, color=colour, mec="white", mew=0.6, ms=size * width, zorder=7)
    if -1e-6 <= record.time[sample] - record.push_start < record.push_duration - 1e-6:
        _push(axes, record, pelvis, width)


def _leg(
    axes: Axes,
    pelvis: tuple[float, float],
    sole: tuple[float, float],
    side: int,
    record: Record,
    width: float,
) -> None:
    from matplotlib.patches import Rectangle

    colour, half = style.FOOT_COLOURS[side], record.foot_size[1] / 2
    ankle = (sole[0], sole[1] + SOLE)
    axes.plot(*zip(pelvis, ankle, strict=True), color=colour, lw=3 * width, solid_capstyle="butt", zorder=3)
    box = Rectangle((sole[0] - half, sole[1]), 2 * half, SOLE, fc=colour, ec="none", zorder=4)
    axes.add_patch(box)


def _push(axes: Axes, record: Record, pelvis: tuple[float, float], width: float) -> None:
    """The lateral part of the push, an arrow that ends at the CoM."""
    share = float(record.push_force[1]) / max(float(np.linalg.norm(record.push_force)), 1e-9)
    arrow = {
        "arrowstyle": "-|>,head_width=0.3,head_length=0.6",
        "color": style.PUSH_COLOUR,
        "lw": 2.6 * width,
    }
    tail = (pelvis[0] + ARROW * share, pelvis[1])
    axes.annotate("", pelvis, tail, arrowprops={**arrow, "shrinkA": 0, "shrinkB": 3}, zorder=9)


def _instants(record: Record) -> list[tuple[int, int]]:
    """Places in the row, and the samples that are drawn there; none after the end of the record."""
    found = []
    for place, offset in enumerate(INSTANTS):
        moment = record.push_start + offset
        if record.time[0] <= moment <= record.time[-1]:
            found.append((place, int(np.argmin(np.abs(record.time - moment)))))
    return found


def _reach(records: Sequence[Record]) -> tuple[float, float]:
    """Room left of the first tick and right of the last that holds all robots with their marks [m]."""
    left = right = 0.35
    for record in records:
        places = _instants(record)
        for place, sample in places:
            lateral = (record.com, record.dcm, record.stance, record.swing)
            across = record.com[places[0][1], 1] - np.array([points[sample, 1] for points in lateral])
            head = across[0] - (TRUNK + 2 * HEAD) * math.sin(record.trunk_angle[sample, 1])
            left = max(left, 0.12 - min(*across, head) - SPACING * place)
            right = max(right, 0.12 + max(*across, head) - SPACING * (len(INSTANTS) - 1 - place))
    return float(left), float(right)


def _row(axes: Axes, record: Record) -> None:
    axes.grid(visible=False)
    axes.axhline(0.0, color="#999999", lw=0.8, zorder=0)
    places = _instants(record)
    for place, sample in places:
        tick = SPACING * place
        axes.plot([tick, tick], [GROUND, 1.5], color="#999999", lw=0.9, ls=":", zorder=0)
        draw_robot(axes, record, sample, tick + float(record.com[places[0][1], 1]))
        if 0.0 <= INSTANTS[place] <= record.push_duration:
            axes.annotate(
                style.push_text(record), (tick, HEIGHT), ha="center", va="top", color=style.PUSH_COLOUR,
                weight="bold",
            )  # fmt: skip
    labels = [f"{INSTANTS[place]:+.2f}".replace("-", "\N{MINUS SIGN}") for place, _ in places]
    axes.set_xticks([SPACING * place for place, _ in places], labels)
    if not record.survived:
        text = f"beyond recovery\nat +{record.time[-1] - record.push_start:.2f} s"
        axes.annotate(text, (1.0, 0.5), xycoords="axes fraction", ha="right", va="center")


def legend(figure: Figure) -> None:
    """What the marks of the cartoon mean."""
    from matplotlib.lines import Line2D

    left, right = style.FOOT_COLOURS
    none: dict[str, Any] = {"ls": "none", "mec": "white"}
    entries = [
        Line2D([], [], color=left, lw=3, label="left leg"),
        Line2D([], [], color=right, lw=3, label="right leg"),
        Line2D([], [], marker="o", color=style.COM_COLOUR, ms=7, label="CoM", **none),
        Line2D([], [], marker="D", color=style.DCM_COLOUR, ms=7, label="DCM", **none),
        Line2D([], [], marker="^", color=style.COP_COLOUR, ms=7, label="CoP", ls="none"),
    ]
    figure.legend(handles=entries, loc="outside lower center", ncols=5, columnspacing=1.4)


MOTION_STEM = "fig5_motion"
BEFORE, AFTER = 0.5, 2.5  # what the film shows about the onset of the push [s]
SPEED = 0.5  # of the film against time
PIXELS = 90  # [1/in]
COLOURS = 32  # of the palette that all pictures share, which keeps the file small
LABELLED = 0.4  # how long the push is named [s]


def save(records: Sequence[Record], directory: Path, fps: int = 10) -> Path:
    """Write fig5_motion.gif, the lateral plane seen from behind; a record that ends early stands still."""
    from PIL import Image  # matplotlib's own reader and writer of pictures

    with style.print_style():
        figure, panels = _stage(records)
        canvas: Any = figure.canvas
        canvas.draw()
        figure.set_layout_engine("none")  # laid out again in every picture it would shake
        background = canvas.copy_from_bbox(figure.bbox)
        pictures = []
        for offset in np.arange(-BEFORE, AFTER, SPEED / fps):
            canvas.restore_region(background)
            for axes, record in zip(panels, records, strict=True):
                _draw_moment(axes, record, float(offset))
            pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()))
    # The push is in the picture just after the onset: all colours are in use there
    palette = pictures[int((BEFORE + 0.05) / SPEED * fps)].quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    first, *rest = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    buffer = io.BytesIO()
    first.save(
        buffer, "GIF", save_all=True, append_images=rest, duration=round(1000 / fps), loop=0, optimize=False
    )
    path = Path(directory) / f"{MOTION_STEM}.gif"
    write_atomically(path, buffer.getvalue())
    return path


def _stage(records: Sequence[Record]) -> tuple[Figure, Sequence[Axes]]:
    """All that stands still: axes, titles, ground, legend."""
    from matplotlib.ticker import MultipleLocator

    low, high = _range(records)
    figure = style.new_figure(style.WIDTH, 4.4, PIXELS)
    panels = figure.subplots(1, len(records), sharex=True, sharey=True, squeeze=False)[0]
    for index, (axes, record) in enumerate(zip(panels, records, strict=True)):
        style.head(axes, record, index, outcome=False)
        axes.set(xlim=(low, high), ylim=(GROUND, HEIGHT), aspect="equal", xlabel="to the right [m]")
        axes.axhline(0.0, color="#999999", lw=0.8)
    panels[0].set_ylabel("height [m]")
    panels[0].xaxis.set_major_locator(MultipleLocator(0.5))
    legend(figure)
    figure.suptitle(f"seen from behind, at {SPEED:g} of real speed", fontsize=9.5)
    return figure, list(panels)


def _range(records: Sequence[Record]) -> tuple[float, float]:
    """Range to the right of the world's y = 0 that holds CoM and soles, at least as wide as high [m]."""
    across: list[float] = []
    for record in records:
        offset = record.time - record.push_start
        view = (offset >= -BEFORE) & (offset <= AFTER)
        for points in (record.com, record.stance, record.swing):
            across += [*-points[view, 1]]
    middle = (min(across) + max(across)) / 2
    half = max((max(across) - min(across)) / 2 + 0.40, (HEIGHT - GROUND) / 2)
    return float(middle - half), float(middle + half)


def _draw_moment(axes: Axes, record: Record, offset: float) -> None:
    """Paint the robot `offset` after the onset of the push [s] over the still picture."""
    still = set(axes.get_children())
    sample = int(np.argmin(np.abs(record.time - record.push_start - offset)))
    draw_robot(axes, record, sample, 0.0, width=1.5)
    corner: dict[str, Any] = {"transform": axes.transAxes, "va": "top"}
    axes.text(0.03, 0.97, f"t = {record.time[sample]:.2f} s", **corner)
    if not record.survived and record.push_start + offset >= record.time[-1]:
        axes.text(0.97, 0.97, "beyond recovery", ha="right", weight="bold", **corner)
    elif 0.0 <= offset <= LABELLED:
        axes.text(
            0.97, 0.97, style.push_text(record), ha="right", weight="bold", color=style.PUSH_COLOUR, **corner
        )
    moving = [artist for artist in axes.get_children() if artist not in still]
    for artist in sorted(moving, key=lambda artist: artist.get_zorder()):
        axes.draw_artist(artist)
        artist.remove()
