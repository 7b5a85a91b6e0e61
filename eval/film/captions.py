"""Frames of one or several policies beside each other, with words that say what is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...envs.biped.scene import COP_COLOUR, DCM_COLOUR, FOOTHOLD_COLOUR, PUSH_COLOUR
from ..record.words import ending_words, told_push
from .camera import Camera, Frame, middle

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont

PANEL = (330, 330)  # width, height of a policy's picture [pixels]
HEAD, FOOT, LINE = 78, 34, 24  # heights above and below the pictures, and of a line of text [pixels]
GAP = 4  # between two pictures [pixels]
PAPER, INK, GOOD, BAD = (255, 255, 255), (25, 25, 25), (0, 120, 70), (200, 30, 25)
LEGEND = {
    name: (round(255 * red), round(255 * green), round(255 * blue))
    for name, (red, green, blue) in {
        "push": PUSH_COLOUR, "foothold": FOOTHOLD_COLOUR[:3], "DCM": DCM_COLOUR[:3], "CoP": COP_COLOUR[:3],
    }.items()
}  # fmt: skip
COLOURS = (PAPER, INK, GOOD, BAD, *LEGEND.values())  # that must be told apart in a small palette


@dataclass(frozen=True, eq=False)
class Shot:
    """What a camera saw of an episode, and whose it was."""

    policy: str
    camera: Camera

    @property
    def push(self) -> str:
        """The push in words."""
        push = self.camera.info.get("push")
        return "no push" if push is None else told_push(push)

    @property
    def ending(self) -> str:
        """What became of it, in words."""
        return ending_words(self.camera.info)

    @property
    def fell(self) -> bool:
        """Whether it ended in a fall."""
        return bool(self.camera.info.get("failure_reason"))

    @property
    def decided(self) -> float:
        """When it is decided what becomes of it, after the push began [s]."""
        settled = self.camera.info.get("recovered_at")
        end = self.camera.times[-1] if self.fell or settled is None else float(settled)
        return end - self.camera.push_start


def compose(shots: Sequence[Shot], after: float, speed: float) -> Frame:
    """One picture of the film: every policy at a time after its push began [s].

    The push is written over all of them, each policy's name over its own picture, and below the name what
    became of it once that is decided; a robot that has fallen stays as it fell.
    """
    from PIL import Image, ImageDraw

    width, height = PANEL
    sheet = Image.new("RGB", (len(shots) * (width + GAP) - GAP, HEAD + height + FOOT), PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((sheet.width / 2, 2), shots[0].push, INK, font(19, True), anchor="ma")
    for column, shot in enumerate(shots):
        left = column * (width + GAP)
        frame = Image.fromarray(middle(shot.camera.frames[shot.camera.frame_at(after)], PANEL))
        sheet.paste(frame.resize(PANEL, Image.Resampling.LANCZOS), (left, HEAD))
        _title(draw, left + width / 2, shot, after)
    draw_legend(draw, sheet.size, f"{after:+.2f} s{'' if speed == 1.0 else f', {speed:g} of real speed'}")
    return np.asarray(sheet)


def _title(draw: ImageDraw, centre: float, shot: Shot, after: float) -> None:
    draw.text((centre, 2 + LINE), _fitting(draw, shot.policy), INK, font(18, False), anchor="ma")
    if after >= shot.decided:
        words = shot.ending.partition(" (")[0]
        colour = BAD if shot.fell else GOOD
        draw.text((centre, 2 + 2 * LINE), _fitting(draw, words), colour, font(18, True), anchor="ma")


def draw_legend(draw: ImageDraw, size: tuple[int, int], words: str) -> None:
    """The colours of the markers in the last line of a picture, and words at its right end."""
    letters, middle_line = font(13, False), size[1] - FOOT / 2
    left: float = 8
    for name, colour in LEGEND.items():
        draw.rectangle((left, middle_line - 5, left + 10, middle_line + 5), colour)
        draw.text((left + 14, middle_line), name, INK, letters, anchor="lm")
        left += 24 + letters.getlength(name)
    draw.text((size[0] - 8, middle_line), words, INK, letters, anchor="rm")


def _fitting(draw: ImageDraw, text: str) -> str:
    """A text that is not wider than a picture: of the path of a file the end is what tells it apart."""
    while draw.textlength(text, font(18, True)) > PANEL[0] - 8:
        text = "\N{HORIZONTAL ELLIPSIS}" + text.lstrip("\N{HORIZONTAL ELLIPSIS}")[1:]
    return text


@cache
def font(size: int, bold: bool) -> FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib."""
    import matplotlib
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    data: Any = matplotlib.get_data_path()
    return ImageFont.truetype(str(Path(data) / "fonts" / "ttf" / name), size)
