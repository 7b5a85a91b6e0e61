"""Fig. 5 as a short film: the cases side by side at half speed, a GIF that loops."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ....controllers.files import write_atomically
from ..pendulum.record import Record
from . import style
from .cartoon import GROUND, HEIGHT, draw_robot, legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STEM = "fig5_motion"
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
    path = Path(directory) / f"{STEM}.gif"
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
