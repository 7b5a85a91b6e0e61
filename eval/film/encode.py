"""Frames as mp4, or as a GIF that stays below a size."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...controllers.errors import MissingExtraError
from .camera import Frame

GIF_LIMIT = 1_000_000  # [bytes]
COLOURS = 24  # of a GIF besides those that are kept; few make small files
SAMPLES = 6  # pictures, about, that the palette is made from
SHRINK = 0.85  # of width and height, until the file is below its limit
SMALLEST = 64  # width at which nothing is shrunk any more [pixels]
Colour = tuple[int, int, int]  # red, green, blue in 0-255


def require_imageio() -> Any:
    """Imageio with ffmpeg.

    Raises:
        MissingExtraError: one of the two is not installed.
    """
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("imageio", "view") from error
    return imageio


def mp4_bytes(frames: Sequence[Frame], rate: float) -> bytes:
    """Frames of one even width and height as H.264, at so many a second."""
    buffer = io.BytesIO()
    options: dict[str, Any] = {"format": "mp4", "mode": "I", "fps": rate, "macro_block_size": 1}
    with require_imageio().get_writer(buffer, **options) as writer:
        for frame in frames:
            writer.append_data(frame)
    return buffer.getvalue()


def gif_bytes(
    frames: Sequence[Frame], rate: float, keep: Sequence[Colour] = (), limit: int = GIF_LIMIT
) -> bytes:
    """Frames as a GIF that loops, at so many a second; smaller pictures where it would pass the limit.

    All pictures share one palette without dithering, so that what stands still costs nothing.

    Args:
        frames: of one shape.
        rate: a second.
        keep: colours that must stay what they are, however small the things that have them.
        limit: of the size [bytes].
    """
    from PIL import Image

    pictures = [Image.fromarray(frame) for frame in frames]
    palette = _palette(frames, keep)
    width, height = map(float, pictures[0].size)
    while True:
        size = round(width), round(height)
        small = [picture.resize(size, Image.Resampling.LANCZOS) for picture in pictures]
        first, *rest = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in small]
        buffer = io.BytesIO()
        first.save(buffer, "GIF", save_all=True, append_images=rest, duration=round(1000 / rate), loop=0)
        if buffer.tell() < limit or width * SHRINK < SMALLEST:
            return buffer.getvalue()
        width, height = width * SHRINK, height * SHRINK


def _palette(frames: Sequence[Frame], keep: Sequence[Colour]) -> Any:
    """A picture that holds the palette of pictures from all over the film."""
    from PIL import Image

    samples = Image.fromarray(np.concatenate(frames[:: max(1, len(frames) // SAMPLES)]))
    found = samples.quantize(COLOURS, Image.Quantize.FASTOCTREE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*found[: 3 * COLOURS], *(value for colour in keep for value in colour)])
    return palette
