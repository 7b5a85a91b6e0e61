"""The look of every figure: colours and lines by arm, colours by quantity, the part of time shown."""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.files import write_atomically
from .recording import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 7.2  # of a figure in print, two columns [in]
PIXELS = 200  # of the PNG [1/in]
COLOURS = 128  # of the PNG's palette
BEFORE, AFTER = 0.7, 3.4  # what the figures show about the onset of the push [s]

COM_COLOUR, DCM_COLOUR, COP_COLOUR, PUSH_COLOUR = "#222222", "#c2178a", "#0b7a55", "#d7191c"
FOOT_COLOURS = ("#efa13a", "#1f5a96")  # left, right: light and dark, so that print without colour parts them
STEP_COLOUR = "#27a5b8"  # step boundaries, cyan as in the paper
COM_LINE: dict[str, Any] = {"color": COM_COLOUR, "ls": "-", "lw": 1.4}
DCM_LINE: dict[str, Any] = {"color": DCM_COLOUR, "ls": "-", "lw": 2.2}
COP_LINE: dict[str, Any] = {"color": COP_COLOUR, "ls": (0, (3, 1)), "lw": 1.6}


@dataclass(frozen=True)
class ArmStyle:
    """One curve's look; colour, dashes and marker all differ, so that grey print and any eye part them."""

    colour: str
    line: str | tuple[int, tuple[float, ...]]
    marker: str
    label: str  # for people


ARM_STYLES: dict[str, ArmStyle] = {
    "passive": ArmStyle("#8c8c8c", (0, (1, 1)), "x", "no reaction"),
    "raibert": ArmStyle("#7d7420", (0, (2, 2)), "h", "capture-point foothold, fixed time"),
    "herdt": ArmStyle("#3d6b35", (0, (4, 1, 1, 1)), "*", "linear MPC over footsteps, fixed time"),
    "fixed-time": ArmStyle("#b0305c", (0, (9, 2, 1, 2)), "d", "stage 1, fixed time"),
    "random": ArmStyle("#b0a17a", (0, (1, 3)), "+", "random"),
    "stage-1-paper": ArmStyle("#e69f00", "--", "v", "stage 1, paper's weights"),
    "stage-1": ArmStyle("#c44601", (0, (7, 2)), "^", "stage 1: step place and time"),
    "stage-1+cop": ArmStyle("#009e73", "-.", "s", "stage 1 + CoP"),
    "stage-1+momentum": ArmStyle("#cc79a7", (0, (5, 1, 1, 1, 1, 1)), "D", "stage 1 + trunk"),
    "two-stage-paper": ArmStyle("#56b4e9", (0, (3, 1)), "P", "two-stage, paper's weights"),
    "two-stage": ArmStyle("#0064a8", "-", "o", "two-stage"),
    "two-stage, no push estimate": ArmStyle("#7a5195", (0, (5, 2)), "<", "without the push estimate"),
    "two-stage, no trunk debt": ArmStyle("#a6522b", (0, (2, 1, 1, 1)), ">", "without the trunk's debt"),
    "two-stage, plain DCM": ArmStyle("#862255", (0, (6, 1, 1, 1)), "X", "without either: the plain DCM"),
    "residual": ArmStyle("#c2178a", (0, (12, 1)), "H", "residual"),
    "residual-hardware": ArmStyle("#7b1f5c", (0, (6, 3)), "8", "residual, hardware"),
    "scratch": ArmStyle("#a87500", (0, (3, 2)), "1", "from scratch"),
    "joint": ArmStyle("#0b7a55", (0, (4, 3)), "2", "joint targets"),
    "joint-residual": ArmStyle("#5b7083", (0, (5, 1, 2, 1)), "3", "joint residual"),
    "joint-residual-hardware": ArmStyle("#33475a", (0, (8, 2, 2, 2)), "4", "joint residual, hardware"),
    "two-stage+double-support": ArmStyle("#4b2a86", (0, (10, 2)), "p", "two-stage, double support"),
}
LIMIT_STYLES: dict[str, ArmStyle] = {
    "point foot": ArmStyle("#a6a6a6", (0, (1, 1.2)), "", "limit: point foot"),
    "+ foot": ArmStyle("#858585", (0, (4, 2)), "", "limit: + foot"),
    "+ flywheel": ArmStyle("#5f5f5f", (0, (6, 2, 1, 2)), "", "limit: + flywheel"),
    "F*": ArmStyle("#000000", "-", "", "limit F*: foot + flywheel"),
}
SPARE_COLOURS = ("#7a5195", "#6b8e23", "#a6522b", "#2f7f86", "#b8336a")
SPARE_MARKERS = ("<", ">", "h", "*", "d", "8", "H")
SPARE_GREYS = ("#2f2f2f", "#707070", "#959595")


def arm_style(arm: str) -> ArmStyle:
    """The look of an arm; a name without one gets a look that depends on the name alone."""
    if arm in ARM_STYLES:
        return ARM_STYLES[arm]
    key = zlib.crc32(arm.encode())
    dashes = (float(2 + key // 35 % 5), 1.0, 1.0, 1.0)
    return ArmStyle(
        SPARE_COLOURS[key % len(SPARE_COLOURS)],
        (0, dashes),
        SPARE_MARKERS[key // 7 % len(SPARE_MARKERS)],
        arm,
    )


def limit_style(label: str) -> ArmStyle:
    """The look of a closed-form limit: grey to black; a label without one gets a look of its own."""
    if label in LIMIT_STYLES:
        return LIMIT_STYLES[label]
    key = zlib.crc32(label.encode())
    return ArmStyle(SPARE_GREYS[key % len(SPARE_GREYS)], (0, (2.0, 1.0 + key // 3 % 3)), "", label)


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


def new_figure(width: float, height: float, pixels: float = PIXELS) -> Figure:
    """An empty figure [in] on a canvas that needs no display and leaves no state behind."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=pixels, layout="constrained", facecolor="white")
    figure.get_layout_engine().set(h_pad=0.07, w_pad=0.06)  # type: ignore[union-attr, call-arg]
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, directory: Path, stem: str) -> list[Path]:
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


def shown(record: Record) -> NDArray[np.bool_]:
    """The samples that the figures show, (n,): BEFORE the push to AFTER its onset."""
    return (record.time >= record.push_start - BEFORE) & (record.time <= record.push_start + AFTER)


def stances(record: Record) -> list[tuple[int, float, float]]:
    """Steps in view: index, and the part of [touchdown, next touchdown] that is shown [s]."""
    time = record.time[shown(record)]
    ends = [*record.touchdown[1:], record.time[-1]]
    spans = [(max(a, time[0]), min(b, time[-1])) for a, b in zip(record.touchdown, ends, strict=True)]
    return [(i, float(a), float(b)) for i, (a, b) in enumerate(spans) if b > a]


def push_text(record: Record) -> str:
    """Size and duration of the push."""
    return f"{float(np.linalg.norm(record.push_force)):.0f} N for {record.push_duration:g} s"


def lateral_limits(records: Sequence[Record], margin: float = 0.06) -> tuple[float, float]:
    """Range of y that holds all soles in view, and CoM and DCM where the robot stays up [m].

    The DCM of a fall grows exponentially and would flatten all else; it leaves the view.
    """
    values: list[float] = []
    for record in records:
        half = record.foot_size[1] / 2
        feet = record.foothold[[i for i, _, _ in stances(record)], 1]
        values += [feet.min() - half, feet.max() + half]
        if record.survived:
            view = shown(record)
            values += [*record.dcm[view, 1], *record.com[view, 1]]
    return float(min(values)) - margin, float(max(values)) + margin


def head(axes: Axes, record: Record, index: int, outcome: bool = True) -> None:
    """Title a panel: letter, arm and what became of it, behind a sample of the arm's line.

    Args:
        axes: the panel.
        record: what it shows.
        index: of the panel, for its letter.
        outcome: say whether the robot falls or recovers.
    """
    style = arm_style(record.arm)
    end = (": recovers" if record.survived else ": falls") if outcome else ""
    axes.set_title(f"        ({chr(ord('a') + index)})  {style.label}{end}", loc="left", weight="bold")
    _sample(axes, style)


def _sample(axes: Axes, style: ArmStyle) -> None:
    """A short piece of the arm's line with its marker above the panel's left corner."""
    from matplotlib.lines import Line2D
    from matplotlib.transforms import ScaledTranslation

    inches: Any = axes.figure.dpi_scale_trans
    panel: Any = axes.transAxes
    corner = inches + ScaledTranslation(0.0, 1.0, panel)
    sample = Line2D(
        [0.02, 0.18, 0.34], [0.13] * 3, color=style.colour, ls=style.line, marker=style.marker, markevery=[1],
        lw=2.0, ms=6.0, transform=corner, clip_on=False,
    )  # fmt: skip
    sample.set_in_layout(False)
    axes.add_artist(sample)
