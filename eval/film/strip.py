"""Six moments of a push side by side: a contact sheet."""

from __future__ import annotations

import io

import numpy as np

from .camera import Camera, middle

STRIP = (0.05, 0.25, 0.5, 0.8, 1.3, 2.0)  # moments, after the push began [s]
PANEL = (11, 12)  # width to height of one picture


def strip(camera: Camera) -> bytes:
    """The push and what follows: six frames side by side with their times after its begin, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = 2.3, 2.3 * PANEL[1] / PANEL[0]  # of a panel [inch]
    figure = Figure(figsize=(width * len(STRIP), height + 0.25), dpi=100)
    for column, index in enumerate(moments(camera)):
        axes = figure.add_axes((column / len(STRIP), 0.0, 0.995 / len(STRIP), height / (height + 0.25)))
        axes.imshow(middle(camera.frames[index], PANEL), aspect="auto")
        axes.set_title(f"{camera.times[index] - camera.push_start:+.2f} s", fontsize=10, pad=3)
        axes.set_axis_off()
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)
    return buffer.getvalue()


def moments(camera: Camera) -> list[int]:
    """Frames nearest to the moments of STRIP, all of them earlier where the episode ends before the last."""
    squeeze = min(1.0, (np.array(camera.times)[-1] - camera.push_start) / STRIP[-1])
    return [camera.frame_at(squeeze * after) for after in STRIP]
