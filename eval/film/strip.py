"""Six moments of a push side by side: a contact sheet."""

from __future__ import annotations

import io

import numpy as np

from .camera import Camera, middle
from .captions import FOOT, GAP, INK, LINE, PAPER, Shot, draw_legend, font

STRIP = (0.05, 0.25, 0.5, 0.8, 1.3, 2.0)  # moments, after the push began [s]
PANEL = (228, 250)  # width, height of one picture [pixels]


def strip(shot: Shot) -> bytes:
    """The push and what follows: six frames side by side with their times after its begin, as PNG.

    Below them stand what the markers mean, the push, and what became of it.
    """
    from PIL import Image, ImageDraw

    width, height = PANEL
    sheet = Image.new("RGB", (len(STRIP) * (width + GAP) - GAP, LINE + height + FOOT), PAPER)
    draw = ImageDraw.Draw(sheet)
    for column, index in enumerate(moments(shot.camera)):
        left = column * (width + GAP)
        frame = Image.fromarray(middle(shot.camera.frames[index], PANEL))
        sheet.paste(frame.resize(PANEL, Image.Resampling.LANCZOS), (left, LINE))
        time = f"{shot.camera.times[index] - shot.camera.push_start:+.2f} s"
        draw.text((left + width / 2, LINE / 2), time, INK, font(13, False), anchor="mm")
    draw_legend(draw, sheet.size, f"{shot.policy}: {shot.push}, {shot.ending}")
    buffer = io.BytesIO()
    sheet.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def moments(camera: Camera) -> list[int]:
    """Frames nearest to the moments of STRIP, all of them earlier where the episode ends before the last."""
    squeeze = min(1.0, (np.array(camera.times)[-1] - camera.push_start) / STRIP[-1])
    return [camera.frame_at(squeeze * after) for after in STRIP]
