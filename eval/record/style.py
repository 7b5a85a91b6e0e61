"""Look of the figures: colours and lines by policy and by quantity, fonts, legends, and files."""

import io
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...controllers.files import write_atomically

WIDTH = 7.2  # of a figure in print, two columns [in]
PIXELS = 200  # of the PNG [1/in]
COLOURS = 128  # of the PNG's palette

COM_COLOUR, DCM_COLOUR, COP_COLOUR, PUSH_COLOUR = "#222222", "#c2178a", "#0b7a55", "#d7191c"
FOOT_COLOURS = ("#efa13a", "#1f5a96")  # left, right: light and dark, so that print without colour parts them
STEP_COLOUR = "#27a5b8"  # step boundaries, cyan as in the paper
COM_LINE: dict[str, Any] = {"color": COM_COLOUR, "ls": "-", "lw": 1.4}
DCM_LINE: dict[str, Any] = {"color": DCM_COLOUR, "ls": "-", "lw": 2.2}
COP_LINE: dict[str, Any] = {"color": COP_COLOUR, "ls": (0, (3, 1)), "lw": 1.6}


@dataclass(frozen=True)
class CurveStyle:
    """Look of one curve; colour, dashes and marker all differ, so that grey print and any eye part them."""

    colour: str
    line: str | tuple[int, tuple[float, ...]]
    marker: str
    label: str  # for people


POLICY_STYLES: dict[str, CurveStyle] = {
    "passive": CurveStyle("#8c8c8c", (0, (1, 1)), "x", "no reaction"),
    "raibert": CurveStyle("#7d7420", (0, (2, 2)), "h", "capture-point foothold, fixed time"),
    "herdt": CurveStyle("#3d6b35", (0, (4, 1, 1, 1)), "*", "linear MPC over footsteps, fixed time"),
    "fixed-time": CurveStyle("#b0305c", (0, (9, 2, 1, 2)), "d", "stage 1, fixed time"),
    "random": CurveStyle("#b0a17a", (0, (1, 3)), "+", "random"),
    "stage-1-paper": CurveStyle("#e69f00", "--", "v", "stage 1, paper's weights"),
    "stage-1": CurveStyle("#c44601", (0, (7, 2)), "^", "stage 1: step place and time"),
    "stage-1+cop": CurveStyle("#009e73", "-.", "s", "stage 1 + CoP"),
    "stage-1+momentum": CurveStyle("#cc79a7", (0, (5, 1, 1, 1, 1, 1)), "D", "stage 1 + trunk"),
    "two-stage-paper": CurveStyle("#56b4e9", (0, (3, 1)), "P", "two-stage, paper's weights"),
    "two-stage": CurveStyle("#0064a8", "-", "o", "two-stage"),
    "two-stage, no push estimate": CurveStyle("#7a5195", (0, (5, 2)), "<", "without the push estimate"),
    "two-stage, no trunk debt": CurveStyle("#a6522b", (0, (2, 1, 1, 1)), ">", "without the trunk's debt"),
    "two-stage, plain DCM": CurveStyle("#862255", (0, (6, 1, 1, 1)), "X", "without either: the plain DCM"),
    "residual": CurveStyle("#c2178a", (0, (12, 1)), "H", "residual"),
    "residual-hardware": CurveStyle("#7b1f5c", (0, (6, 3)), "8", "residual, hardware"),
    "scratch": CurveStyle("#a87500", (0, (3, 2)), "1", "from scratch"),
    "joint": CurveStyle("#0b7a55", (0, (4, 3)), "2", "joint targets"),
    "joint-residual": CurveStyle("#5b7083", (0, (5, 1, 2, 1)), "3", "joint residual"),
    "joint-residual-hardware": CurveStyle("#33475a", (0, (8, 2, 2, 2)), "4", "joint residual, hardware"),
    "two-stage+double-support": CurveStyle("#4b2a86", (0, (10, 2)), "p", "two-stage, double support"),
}
LIMIT_STYLES: dict[str, CurveStyle] = {
    "point foot": CurveStyle("#a6a6a6", (0, (1, 1.2)), "", "limit: point foot"),
    "+ foot": CurveStyle("#858585", (0, (4, 2)), "", "limit: + foot"),
    "+ flywheel": CurveStyle("#5f5f5f", (0, (6, 2, 1, 2)), "", "limit: + flywheel"),
    "F*": CurveStyle("#000000", "-", "", "limit F*: foot + flywheel"),
}
SPARE_COLOURS = ("#7a5195", "#6b8e23", "#a6522b", "#2f7f86", "#b8336a")
SPARE_MARKERS = ("<", ">", "h", "*", "d", "8", "H")


def curve_style(name: str) -> CurveStyle:
    """Look of a policy or of a closed-form limit; one of an unknown name depends on the name alone."""
    if found := POLICY_STYLES.get(name) or LIMIT_STYLES.get(name):
        return found
    key = zlib.crc32(name.encode())
    line = (0, (float(2 + key // 35 % 5), 1.0, 1.0, 1.0))
    marker = SPARE_MARKERS[key // 7 % len(SPARE_MARKERS)]
    return CurveStyle(SPARE_COLOURS[key % len(SPARE_COLOURS)], line, marker, name)


@contextmanager
def print_style() -> Iterator[None]:
    """Fonts of 9 pt and more at print size, quiet axes; draw and save inside it."""
    import matplotlib

    settings: Any = {
        "font.family": "DejaVu Sans", "font.size": 9.0, "axes.titlesize": 10.5, "axes.labelsize": 9.5,
        "xtick.labelsize": 9.0, "ytick.labelsize": 9.0, "legend.fontsize": 9.0, "legend.frameon": False,
        "axes.grid": True, "grid.color": "#e4e4e4", "grid.linewidth": 0.6, "axes.axisbelow": True,
        "axes.edgecolor": "#555555", "axes.linewidth": 0.8, "lines.linewidth": 1.5,
        "hatch.linewidth": 0.6, "svg.hashsalt": "push-recovery", "svg.fonttype": "path",
    }  # fmt: skip
    with matplotlib.rc_context(settings):
        yield


def new_figure(width: float, height: float, pixels: float = PIXELS) -> Any:
    """An empty figure [in] on a canvas that needs no display and leaves no state behind."""
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(width, height), dpi=pixels, layout="constrained", facecolor="white")
    figure.get_layout_engine().set(h_pad=0.07, w_pad=0.06)
    return figure


def legend(figure: Any, looks: Mapping[str, Mapping[str, Any]], columns: int, **options: Any) -> None:
    """Explain marks below the panels.

    Args:
        figure: that they are in.
        looks: by label, properties of a patch where they have a face colour `fc`, otherwise of a line.
        columns: of the legend.
        options: more of them.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Patch(label=label, **look) if "fc" in look else Line2D([], [], label=label, **look)
        for label, look in looks.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, **options)


def draw_arrow(
    axes: Any, tail: Sequence[float], tip: Sequence[float], head: float = 0.35, zorder: int = 8, **look: Any
) -> None:
    """A push from its tail to its tip; the head is `head` wide and twice as long."""
    form = f"-|>,head_width={head:g},head_length={2 * head:g}"
    arrow = {"arrowstyle": form, "color": PUSH_COLOUR, "shrinkA": 0, **look}
    axes.annotate("", (tip[0], tip[1]), (tail[0], tail[1]), arrowprops=arrow, zorder=zorder)


def shade_push(axes: Any, start: float, duration: float) -> None:
    """The time in which a push acts [s]."""
    axes.axvspan(start, start + duration, color=PUSH_COLOUR, alpha=0.22, lw=0, zorder=0)


def draw_bounds(axes: Any, bound: float) -> None:
    """Dashed lines at how far a quantity may go both ways."""
    for sign in (-1.0, 1.0):
        axes.axhline(sign * bound, color="#555555", ls="--", lw=1.0)


def save(figure: Any, directory: Path, stem: str) -> list[Path]:
    """Write stem.png and stem.svg; the same figure gives the same bytes.

    Call it inside `print_style`.
    """
    from PIL import Image  # matplotlib's own writer of pictures

    png, svg, small = io.BytesIO(), io.BytesIO(), io.BytesIO()
    figure.savefig(png, format="png", dpi=PIXELS)
    figure.savefig(svg, format="svg", metadata={"Date": None})
    with Image.open(png) as picture:  # a palette makes a third of the size of lines on white
        picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(
            small, "PNG", optimize=True, dpi=(PIXELS, PIXELS)
        )
    paths = [Path(directory) / f"{stem}.{suffix}" for suffix in ("png", "svg")]
    for path, buffer in zip(paths, (small, svg), strict=True):
        write_atomically(path, buffer.getvalue())
    return paths
