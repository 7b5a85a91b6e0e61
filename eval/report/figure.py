"""Figures as SVG inside a page: small enough for a phone, apart in grey print and for every eye."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, ORANGE, INK, GREY, PALE = "#0b5394", "#c4610a", "#1c1c1c", "#6f6f6f", "#d9d9d9"
PANEL = 3.55  # width of a figure [in]; 340 pixels, less than a phone has
LONGEST_LABEL = 22  # characters beside an axis
POINTS = 72.0  # an inch


@contextmanager
def page_style() -> Iterator[None]:
    """Fonts and axes of the page's figures; draw and turn into SVG inside it."""
    import matplotlib

    settings: Any = {
        "font.family": "sans-serif", "font.size": 8.5, "axes.titlesize": 9.0, "axes.labelsize": 8.5,
        "xtick.labelsize": 8.0, "ytick.labelsize": 8.0, "axes.spines.top": False, "axes.spines.right": False,
        "axes.edgecolor": GREY, "axes.linewidth": 0.7, "axes.titlelocation": "left",
        "hatch.linewidth": 0.6, "svg.fonttype": "none",
    }  # fmt: skip
    with matplotlib.rc_context(settings):
        yield


def new_panel(height: float, polar: bool = False) -> tuple[Figure, Any]:
    """A figure [in] with one pair of axes, on a canvas that needs no display."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PANEL, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure, figure.add_subplot(projection="polar" if polar else None)


def to_svg(figure: Figure, text: str) -> str:
    """The figure as an element of HTML, with words for those who cannot see it.

    Names are taken out but for those that are referred to, which are made from `text`, so that many figures
    stand in one page.
    """
    import matplotlib

    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": text}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    drawn = buffer.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.DOTALL)
    drawn = re.sub(r'(<g) id="[^"]*"', r"\1", drawn)
    drawn = re.sub(r"<!--.*?-->", "", drawn, flags=re.DOTALL)
    drawn = re.sub(r"\n\s*", "\n", re.sub(r"(\d\.\d\d)\d+", r"\1", drawn))  # a hundredth of a point will do
    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', drawn)
    width, height = (float(side) for side in box.groups()) if box else (PANEL * POINTS, PANEL * POINTS)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{_attribute(text)}">'
    )
    return re.sub(r"<svg[^>]*>", lambda _: head, drawn, count=1).strip()


def beside_axis(label: str) -> str:
    """A label cut in its middle where it is too long to stand beside an axis."""
    if len(label) <= LONGEST_LABEL:
        return label
    half = LONGEST_LABEL // 2 - 1
    return f"{label[:half]}...{label[-half:]}"


def _attribute(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
