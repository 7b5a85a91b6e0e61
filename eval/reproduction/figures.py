"""Figs. 3, 4, 5 and 7 of the paper: paths, histories, cartoon and film, largest push by direction."""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.files import write_atomically
from ..record import style
from .pendulum import Walk

Axes = Any  # of matplotlib, which is loaded where something is drawn
Figure = Any

BEFORE, AFTER = 0.7, 3.4  # part of the walk that Figs. 3 and 4 show about the onset of the push [s]
SIDES = ("left", "right")


def draw_scenario_1(walks: Sequence[Walk], directory: Path) -> list[Path]:
    """Figs. 3, 4 and 5 and the film of Fig. 5; returns their paths."""
    paths = [path for draw in (draw_paths, draw_histories, draw_cartoon) for path in draw(walks, directory)]
    return [*paths, save_film(walks, directory)]


def in_view(walk: Walk) -> NDArray[np.bool_]:
    """The samples that the figures show, (n,): from BEFORE the push to AFTER its onset."""
    return (walk["time"] >= walk.push_start - BEFORE) & (walk["time"] <= walk.push_start + AFTER)


def stances(walk: Walk) -> list[tuple[int, float, float]]:
    """Steps in view: index, and the part of [touchdown, next touchdown] that is shown [s]."""
    time = walk["time"][in_view(walk)]
    ends = [*walk.touchdown[1:], walk["time"][-1]]
    spans = [(max(a, time[0]), min(b, time[-1])) for a, b in zip(walk.touchdown, ends, strict=True)]
    return [(i, float(a), float(b)) for i, (a, b) in enumerate(spans) if b > a]


def push_text(walk: Walk) -> str:
    """Size and duration of the push."""
    return f"{float(np.linalg.norm(walk.push_force)):.0f} N for {walk.push_duration:g} s"


def lateral_limits(walks: Sequence[Walk], margin: float = 0.06) -> tuple[float, float]:
    """Range of y that holds all soles in view, and CoM and DCM where the robot stays up [m].

    The DCM of a fall grows exponentially and would flatten all else; it leaves the view.
    """
    values: list[float] = []
    for walk in walks:
        half = walk.sole[1] / 2
        feet = walk.foothold[[i for i, _, _ in stances(walk)], 1]
        values += [feet.min() - half, feet.max() + half]
        if walk.outcome.survived:
            view = in_view(walk)
            values += [*walk["dcm_y"][view], *walk["com_y"][view]]
    return float(min(values)) - margin, float(max(values)) + margin


def title(axes: Axes, walk: Walk, index: int, outcome: bool = True) -> None:
    """Title a panel: letter, variant and whether it recovers, behind a sample of the variant's line."""
    from matplotlib.lines import Line2D
    from matplotlib.transforms import ScaledTranslation

    look = style.curve_style(walk.label)
    end = (": recovers" if walk.outcome.survived else ": falls") if outcome else ""
    axes.set_title(f"        ({chr(ord('a') + index)})  {look.label}{end}", loc="left", weight="bold")
    inches: Any = axes.figure.dpi_scale_trans
    panel: Any = axes.transAxes
    sample = Line2D(
        [0.02, 0.18, 0.34], [0.13] * 3, color=look.colour, ls=look.line, marker=look.marker, markevery=[1],
        lw=2.0, ms=6.0, transform=inches + ScaledTranslation(0.0, 1.0, panel), clip_on=False,
    )  # fmt: skip
    sample.set_in_layout(False)
    axes.add_artist(sample)


ARROW = 0.22  # length of the push's arrow [m]


def draw_paths(walks: Sequence[Walk], directory: Path) -> list[Path]:
    """Draw Fig. 3, a panel a walk from above: x forward to the right, y to the left upwards, to scale."""
    with style.print_style():
        x_limits, y_limits = _path_limits(walks)
        height = (style.WIDTH - 0.8) * (y_limits[1] - y_limits[0]) / (x_limits[1] - x_limits[0])
        figure = style.new_figure(style.WIDTH, len(walks) * (height + 0.35) + 0.95)
        panels = figure.subplots(len(walks), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for index, (axes, walk) in enumerate(zip(panels, walks, strict=True)):
            axes.set(xlim=x_limits, ylim=y_limits, aspect="equal", ylabel="y, left [m]")
            title(axes, walk, index)
            _soles(axes, walk)
            _curves(axes, walk)
            tail, tip = _push_arrow(walk)
            style.draw_arrow(axes, tail, tip, lw=3, shrinkB=0, zorder=8)
            axes.annotate(
                push_text(walk), tail, (5, 1), textcoords="offset points", color=style.PUSH_COLOUR,
                weight="bold", va="bottom", zorder=9,
            )  # fmt: skip
            if not walk.outcome.survived:  # beside the last sample of the DCM in view
                inside = (walk["dcm_y"] > y_limits[0]) & (walk["dcm_y"] < y_limits[1])
                last: Any = walk.points("dcm")[np.flatnonzero(inside)[-1]]
                axes.annotate(
                    f"DCM beyond recovery\nat t = {walk['time'][-1]:.2f} s", last, (30, 6),
                    textcoords="offset points", color=style.DCM_COLOUR, va="bottom",
                )  # fmt: skip
        panels[-1].set_xlabel("x, forward [m]")
        left, right = style.FOOT_COLOURS
        cop = {"color": style.COP_COLOUR, "lw": 3.2, "marker": "o", "ms": 5, "solid_capstyle": "round"}
        looks = {
            "DCM": style.DCM_LINE, "CoM": style.COM_LINE, "CoP in a sole, end marked": cop,
            "CoP, jump to the next sole": {"color": style.COP_COLOUR, "ls": (0, (2, 2)), "lw": 0.8},
            "left sole (number: touchdown)": {"fc": left, "ec": left, "alpha": 0.5},
            "right sole": {"fc": "white", "ec": right, "hatch": "////"},
        }  # fmt: skip
        style.legend(figure, looks, 3)
        return style.save(figure, directory, "fig3_paths")


def _path_limits(walks: Sequence[Walk]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of x and y that hold soles and pushes of all, and the curves of those that stay up [m]."""
    low_y, high_y = lateral_limits(walks, margin=0.09)
    x: list[float] = []
    for walk in walks:
        feet = walk.foothold[[i for i, _, _ in stances(walk)], 0]
        x += [feet.min() - walk.sole[0] / 2, feet.max() + walk.sole[0] / 2]
        if walk.outcome.survived:
            x += [walk["dcm_x"][in_view(walk)].max()]
        (_, tail_y), _ = _push_arrow(walk)
        low_y, high_y = min(low_y, tail_y - 0.08), max(high_y, tail_y + 0.08)
    return (float(min(x)) - 0.05, float(max(x)) + 0.05), (float(low_y), float(high_y))


def _push_arrow(walk: Walk) -> Any:
    """Tail and tip of the push's arrow, each (2,) [m]: it ends at the CoM at the onset, ARROW long."""
    tip = walk.points("com")[min(int(np.searchsorted(walk["time"], walk.push_start)), len(walk) - 1)]
    return tip - ARROW * walk.push_force / max(float(np.linalg.norm(walk.push_force)), 1e-9), tip


def _curves(axes: Axes, walk: Walk) -> None:
    """CoP: thick within a sole, thin where it jumps to the next one; CoM; DCM."""
    view, cop = in_view(walk), walk.points("cop")
    axes.plot(*cop[view].T, color=style.COP_COLOUR, ls=(0, (2, 2)), lw=0.8, zorder=4)
    for index, _, _ in stances(walk):
        inside = cop[view & (walk["step"] == index)]
        axes.plot(*inside.T, color=style.COP_COLOUR, lw=3.2, solid_capstyle="round", zorder=5)
        axes.plot(*inside[-1:].T, "o", color=style.COP_COLOUR, ms=5, zorder=5)
    axes.plot(*walk.points("com")[view].T, **style.COM_LINE, zorder=6)
    axes.plot(*walk.points("dcm")[view].T, **style.DCM_LINE, zorder=7)


def _soles(axes: Axes, walk: Walk) -> None:
    """Soles that were stood on, left filled and right hatched, numbered by touchdown."""
    from matplotlib.patches import Rectangle

    length, width = walk.sole
    for index, _, _ in stances(walk):
        centre, side = walk.foothold[index], int(walk.foothold_side[index])
        corner = (float(centre[0]) - length / 2, float(centre[1]) - width / 2)
        colour, hatch = style.FOOT_COLOURS[side], "////" if side == 1 else None
        axes.add_patch(Rectangle(corner, length, width, ec="none", fc=colour, alpha=0.30, zorder=2))
        axes.add_patch(
            Rectangle(corner, length, width, ec=colour, fc="none", lw=1.2, hatch=hatch, alpha=0.8, zorder=3)
        )
        axes.annotate(
            f"{index}", (corner[0], float(centre[1])), (4, 0), textcoords="offset points", va="center",
            bbox={"fc": "white", "ec": "none", "alpha": 0.75, "pad": 0.6}, zorder=8,
        )  # fmt: skip


MOVES = 0.01  # a trunk that leans less is not drawn [rad]


def draw_histories(walks: Sequence[Walk], directory: Path) -> list[Path]:
    """Draw Fig. 4, one lateral panel a walk; below, lean and torque of the trunk of those that use it."""
    swaying = [i for i, walk in enumerate(walks) if any(_moves(walk, axis) for axis in ("pitch", "roll"))]
    with style.print_style():
        heights = [2.1] * len(walks) + [1.2] * 2 * len(swaying)
        figure = style.new_figure(style.WIDTH, sum(heights) + 0.4 * len(heights) + 0.5)
        panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        limits = lateral_limits(walks)
        for index, (axes, walk) in enumerate(zip(panels, walks, strict=False)):
            _lateral(axes, walk)
            title(axes, walk, index)
            axes.set(ylim=limits, ylabel="y, left [m]")
        for place, index in enumerate(swaying):
            above = len(walks) + 2 * place
            _trunk(panels[above], panels[above + 1], walks[index], chr(ord("a") + index))
        start = max(walk.push_start for walk in walks)
        panels[-1].set(xlim=(start - BEFORE, start + AFTER), xlabel="time [s]")
        for axes in panels:
            axes.label_outer()
        left, right = style.FOOT_COLOURS
        looks = {
            "DCM": style.DCM_LINE, "CoM": style.COM_LINE, "CoP": style.COP_LINE,
            "push": {"fc": style.PUSH_COLOUR, "alpha": 0.3},
            "left sole on the ground": {"fc": left, "alpha": 0.4},
            "right sole on the ground": {"fc": "white", "ec": right, "hatch": "////"},
            "swing foot": {"color": "#555555", "ls": ":"},
            "step boundary": {"color": style.STEP_COLOUR, "lw": 1.0},
        }  # fmt: skip
        style.legend(figure, looks, 4)
        return style.save(figure, directory, "fig4_histories")


def _moves(walk: Walk, axis: str) -> bool:
    return bool(np.abs(walk[f"trunk_{axis}"][in_view(walk)]).max() > MOVES)


def _mark_events(axes: Axes, walk: Walk) -> None:
    """Step boundaries as vertical lines, the push as a shaded interval."""
    for _, start, _ in stances(walk)[1:]:
        axes.axvline(start, color=style.STEP_COLOUR, lw=1.0, zorder=1)
    style.shade_push(axes, walk.push_start, walk.push_duration)


def _lateral(axes: Axes, walk: Walk) -> None:
    _mark_events(axes, walk)
    time, view, half = walk["time"], in_view(walk), walk.sole[1] / 2
    for index, start, end in stances(walk):
        y, side = float(walk.foothold[index, 1]), int(walk.foothold_side[index])
        colour = style.FOOT_COLOURS[side]
        band: Any = ([start, end], y - half, y + half)
        axes.fill_between(*band, fc=colour, ec="none", alpha=0.30, zorder=2)
        if side == 1:
            axes.fill_between(*band, fc="none", ec=colour, hatch="////", lw=0, alpha=0.6, zorder=2)
        during = view & (walk["step"] == index)
        swing = walk[f"{SIDES[1 - side]}_sole_y"][during]
        axes.plot(time[during], swing, color=style.FOOT_COLOURS[1 - side], ls=":", lw=1.5)
        axes.plot(time[during], walk["cop_y"][during], drawstyle="steps-pre", **style.COP_LINE, zorder=4)
    axes.plot(time[view], walk["com_y"][view], **style.COM_LINE, zorder=5)
    axes.plot(time[view], walk["dcm_y"][view], **style.DCM_LINE, zorder=6)
    if not walk.outcome.survived:
        axes.axvline(time[-1], color=style.COM_COLOUR, ls="--", lw=1.0)
        axes.annotate(
            f"beyond recovery\nat t = {time[-1]:.2f} s", (float(time[-1]), 0.95), (6, 0),
            xycoords=("data", "axes fraction"), textcoords="offset points", va="top",
        )  # fmt: skip


def _trunk(angle: Axes, torque: Axes, walk: Walk, letter: str) -> None:
    """Lean and torque of the trunk within their limits; the pitch only where it moves."""
    look, view = style.curve_style(walk.label), in_view(walk)
    pitch: dict[str, Any] = {"color": style.COM_COLOUR, "ls": "--", "label": "pitch, positive forward"}
    for axes, name, kind in ((angle, "trunk", "default"), (torque, "torque_trunk", "steps-pre")):
        _mark_events(axes, walk)
        bound = walk.bounds[f"{name}_roll"]
        style.draw_bounds(axes, bound)
        time, roll = walk["time"][view], walk[f"{name}_roll"][view]
        axes.plot(time, roll, color=look.colour, lw=1.8, drawstyle=kind, label="roll")
        if _moves(walk, "pitch"):
            axes.plot(time, walk[f"{name}_pitch"][view], drawstyle=kind, **pitch)
        axes.set_ylim(-1.25 * bound, 1.25 * bound)
    angle.set(ylabel="angle [rad]")
    angle.set_title(f"({letter})  trunk: roll, positive to the left; limits dashed", loc="left")
    torque.set(ylabel="torque [N m]")
    torque.set_title(f"({letter})  trunk: torque; limits dashed", loc="left")
    if _moves(walk, "pitch"):
        angle.legend(loc="lower right", ncols=2, frameon=True, framealpha=0.9)


INSTANTS = (-0.40, 0.05, 0.25, 0.45, 0.65, 0.85, 1.05, 1.55, 2.05)  # from the onset of the push [s]
SPACING = 0.95  # between the robots [m]
TRUNK, HEAD = 0.50, 0.10  # length of the trunk, radius of the head [m]
LATERAL_ARROW = 0.33  # length of the push's arrow [m]
HEIGHT = 1.78  # of the view [m]
GROUND, MARKS = -0.17, -0.08  # lower edge of the view; where CoP and DCM are marked, below the soles [m]
SOLE = 0.045  # its thickness [m]


def draw_cartoon(walks: Sequence[Walk], directory: Path) -> list[Path]:
    """Draw Fig. 5, seen from behind, one row a walk: the robot at the same instants, time to the right."""
    with style.print_style():
        left, right = _reach(walks)
        span = SPACING * (len(INSTANTS) - 1) + left + right
        scale = (style.WIDTH - 0.65) / span
        figure = style.new_figure(style.WIDTH, len(walks) * (scale * (HEIGHT - GROUND) + 0.45) + 0.75)
        rows = figure.subplots(len(walks), 1, squeeze=False)[:, 0]
        for index, (axes, walk) in enumerate(zip(rows, walks, strict=True)):
            title(axes, walk, index)
            axes.set(xlim=(-left, span - left), ylim=(GROUND, HEIGHT), aspect="equal")
            axes.set(yticks=(0.0, 0.5, 1.0, 1.5), ylabel="height [m]")
            axes.spines[["top", "right"]].set_visible(False)
            _row(axes, walk)
        rows[0].set_title("seen from behind", loc="right", fontsize=9.5)
        about = "time since the onset of the push [s]; dotted: where the CoM was at the first instant"
        rows[-1].set_xlabel(about)
        _cartoon_legend(figure)
        return style.save(figure, directory, "fig5_cartoon")


def _cartoon_legend(figure: Figure) -> None:
    left, right = style.FOOT_COLOURS
    point: dict[str, Any] = {"ms": 7, "ls": "none"}
    looks: dict[str, dict[str, Any]] = {
        "left leg": {"color": left, "lw": 3}, "right leg": {"color": right, "lw": 3},
        "CoM": {"marker": "o", "color": style.COM_COLOUR, "mec": "white", **point},
        "DCM": {"marker": "D", "color": style.DCM_COLOUR, "mec": "white", **point},
        "CoP": {"marker": "^", "color": style.COP_COLOUR, **point},
    }  # fmt: skip
    style.legend(figure, looks, 5, columnspacing=1.4)


def draw_robot(axes: Axes, walk: Walk, sample: int, shift: float, width: float = 1.0) -> None:
    """Draw one sample: x to the right, the world's y = 0 at `shift`, y up [m]; `width` scales its lines."""
    from matplotlib.patches import Circle, Rectangle

    pelvis = (shift - float(walk["com_y"][sample]), walk.com_height)
    stance, half = int(walk["stance_side"][sample]), walk.sole[1] / 2
    for side in (1 - stance, stance):
        colour = style.FOOT_COLOURS[side]
        y, z = (float(walk[f"{SIDES[side]}_sole_{axis}"][sample]) for axis in "yz")
        leg = {"color": colour, "lw": 3 * width, "solid_capstyle": "butt", "zorder": 3}
        axes.plot((pelvis[0], shift - y), (pelvis[1], z + SOLE), **leg)
        axes.add_patch(Rectangle((shift - y - half, z), 2 * half, SOLE, fc=colour, ec="none", zorder=4))
    lean = float(walk["trunk_roll"][sample])
    up: Any = np.array([-math.sin(lean), math.cos(lean)])
    trunk = {"color": "#444444", "lw": 5 * width, "solid_capstyle": "round", "zorder": 5}
    axes.plot(*zip(pelvis, pelvis + TRUNK * up, strict=True), **trunk)
    skull = pelvis + (TRUNK + HEAD) * up
    axes.add_patch(Circle(skull, HEAD, fc="#dddddd", ec="#444444", lw=1.4, zorder=5))
    axes.plot(*pelvis, "o", color=style.COM_COLOUR, mec="white", ms=6.5 * width, zorder=6)
    marks = (("cop_y", "^", style.COP_COLOUR, 8.0), ("dcm_y", "D", style.DCM_COLOUR, 4.5))
    for name, marker, colour, size in marks:  # the smaller one last: both show where they coincide
        place = shift - float(walk[name][sample])
        axes.plot(place, MARKS, marker, color=colour, mec="white", mew=0.6, ms=size * width, zorder=7)
    if -1e-6 <= walk["time"][sample] - walk.push_start < walk.push_duration - 1e-6:
        lateral = float(walk.push_force[1]) / max(float(np.linalg.norm(walk.push_force)), 1e-9)
        tail = (pelvis[0] + LATERAL_ARROW * lateral, pelvis[1])
        style.draw_arrow(axes, tail, pelvis, 0.3, lw=2.6 * width, shrinkB=3, zorder=9)


def _instants(walk: Walk) -> list[tuple[int, int]]:
    """Places in the row, and the samples that are drawn there; none after the end of the walk."""
    found, time = [], walk["time"]
    for place, offset in enumerate(INSTANTS):
        instant = walk.push_start + offset
        if time[0] <= instant <= time[-1]:
            found.append((place, int(np.argmin(np.abs(time - instant)))))
    return found


def _reach(walks: Sequence[Walk]) -> tuple[float, float]:
    """Space left of the first tick and right of the last that holds all robots with their marks [m]."""
    left = right = 0.35
    for walk in walks:
        places = _instants(walk)
        for place, sample in places:
            names = ("com_y", "dcm_y", "left_sole_y", "right_sole_y")
            across = walk["com_y"][places[0][1]] - np.array([walk[name][sample] for name in names])
            head = across[0] - (TRUNK + 2 * HEAD) * math.sin(walk["trunk_roll"][sample])
            left = max(left, 0.12 - min(*across, head) - SPACING * place)
            right = max(right, 0.12 + max(*across, head) - SPACING * (len(INSTANTS) - 1 - place))
    return float(left), float(right)


def _row(axes: Axes, walk: Walk) -> None:
    axes.grid(visible=False)
    axes.axhline(0.0, color="#999999", lw=0.8, zorder=0)
    places = _instants(walk)
    for place, sample in places:
        tick = SPACING * place
        axes.plot([tick, tick], [GROUND, 1.5], color="#999999", lw=0.9, ls=":", zorder=0)
        draw_robot(axes, walk, sample, tick + float(walk["com_y"][places[0][1]]))
        if 0.0 <= INSTANTS[place] <= walk.push_duration:
            look: dict[str, Any] = {"ha": "center", "va": "top", "color": style.PUSH_COLOUR, "weight": "bold"}
            axes.annotate(push_text(walk), (tick, HEIGHT), **look)
    labels = [f"{INSTANTS[place]:+.2f}".replace("-", "\N{MINUS SIGN}") for place, _ in places]
    axes.set_xticks([SPACING * place for place, _ in places], labels)
    if not walk.outcome.survived:
        text = f"beyond recovery\nat +{walk['time'][-1] - walk.push_start:.2f} s"
        axes.annotate(text, (1.0, 0.5), xycoords="axes fraction", ha="right", va="center")


FILM_BEFORE, FILM_AFTER = 0.5, 2.5  # part of the walk that the film shows about the onset of the push [s]
SPEED = 0.5  # of the film against time
PIXELS = 90  # [1/in]
COLOURS = 32  # of the palette that all pictures share, which keeps the file small
LABELLED = 0.4  # how long the push is named [s]


def save_film(walks: Sequence[Walk], directory: Path, fps: int = 10) -> Path:
    """Write fig5_motion.gif, the lateral plane seen from behind; a walk that ends early stands still."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image  # matplotlib's own reader and writer of pictures

    with style.print_style():
        figure, panels = _stage(walks)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        figure.set_layout_engine("none")  # laid out again in every picture it would shake
        background = canvas.copy_from_bbox(figure.bbox)
        pictures = []
        for offset in np.arange(-FILM_BEFORE, FILM_AFTER, SPEED / fps):
            canvas.restore_region(background)
            for axes, walk in zip(panels, walks, strict=True):
                _draw_instant(axes, walk, float(offset))
            pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()))
    # The push is in the picture just after the onset: all colours are in use there
    palette = pictures[int((FILM_BEFORE + 0.05) / SPEED * fps)].quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    first, *rest = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    buffer = io.BytesIO()
    first.save(
        buffer, "GIF", save_all=True, append_images=rest, duration=round(1000 / fps), loop=0, optimize=False
    )
    path = Path(directory) / "fig5_motion.gif"
    write_atomically(path, buffer.getvalue())
    return path


def _stage(walks: Sequence[Walk]) -> tuple[Figure, Sequence[Axes]]:
    """All that stands still: axes, titles, ground, legend."""
    from matplotlib.ticker import MultipleLocator

    across: list[float] = []  # to the right of the world's y = 0: CoM and soles [m]
    for walk in walks:
        offset = walk["time"] - walk.push_start
        view = (offset >= -FILM_BEFORE) & (offset <= FILM_AFTER)
        for name in ("com_y", "left_sole_y", "right_sole_y"):
            across += [*-walk[name][view]]
    middle = (min(across) + max(across)) / 2
    half = max((max(across) - min(across)) / 2 + 0.40, (HEIGHT - GROUND) / 2)  # at least as wide as high
    figure = style.new_figure(style.WIDTH, 4.4, PIXELS)
    panels = figure.subplots(1, len(walks), sharex=True, sharey=True, squeeze=False)[0]
    for index, (axes, walk) in enumerate(zip(panels, walks, strict=True)):
        title(axes, walk, index, outcome=False)
        axes.set(xlim=(middle - half, middle + half), ylim=(GROUND, HEIGHT), aspect="equal")
        axes.set(xlabel="to the right [m]")
        axes.axhline(0.0, color="#999999", lw=0.8)
    panels[0].set_ylabel("height [m]")
    panels[0].xaxis.set_major_locator(MultipleLocator(0.5))
    _cartoon_legend(figure)
    figure.suptitle(f"seen from behind, at {SPEED:g} of real speed", fontsize=9.5)
    return figure, list(panels)


def _draw_instant(axes: Axes, walk: Walk, offset: float) -> None:
    """Paint the robot `offset` after the onset of the push [s] over the still picture."""
    still, time = set(axes.get_children()), walk["time"]
    sample = int(np.argmin(np.abs(time - walk.push_start - offset)))
    draw_robot(axes, walk, sample, 0.0, width=1.5)
    corner: dict[str, Any] = {"transform": axes.transAxes, "va": "top"}
    axes.text(0.03, 0.97, f"t = {time[sample]:.2f} s", **corner)
    corner |= {"ha": "right", "weight": "bold"}
    if not walk.outcome.survived and walk.push_start + offset >= time[-1]:
        axes.text(0.97, 0.97, "beyond recovery", **corner)
    elif 0.0 <= offset <= LABELLED:
        axes.text(0.97, 0.97, push_text(walk), color=style.PUSH_COLOUR, **corner)
    moving = [artist for artist in axes.get_children() if artist not in still]
    for artist in sorted(moving, key=lambda artist: artist.get_zorder()):
        axes.draw_artist(artist)
        artist.remove()


Curve = Sequence[tuple[float, float]]  # psi [deg], force [N] or impulse [N s]
RADIAL_LABELS = 75.0  # labels of the radial axis: pushes inward are the weakest, so there is space [deg]


FINE = 3.0  # between two points of a curve around the robot [deg]


def draw_limits(
    curves: Mapping[str, Curve],
    limits: Mapping[str, Curve],
    directory: Path,
    stem: str = "fig7_limits",
    title: str = "Largest recoverable push of 0.1 s at the start of a left stance, stepping in place",
    unit: str = "N",
) -> list[Path]:
    """Draw Fig. 7, a polar map: forward is up, psi [deg] counter-clockwise; each curve is closed here."""
    with style.print_style():
        figure = style.new_figure(style.WIDTH, style.WIDTH + 0.9)
        axes: Any = figure.add_subplot(projection="polar")
        axes.set_theta_zero_location("N")
        for group, options in (
            (limits, {"lw": 1.6, "zorder": 2}),
            (curves, {"lw": 1.5, "ms": 3.6, "mew": 0.9, "zorder": 3}),
        ):
            for label, curve in group.items():
                psi, radius, every = around(curve)
                look = style.curve_style(label)
                line = {"color": look.colour, "ls": look.line, "marker": look.marker, "label": look.label}
                axes.plot(np.radians(psi), radius, markevery=every, **line, **options)
        largest = max(radius for curve in (*curves.values(), *limits.values()) for _, radius in curve)
        _scales(axes, largest, unit)
        figure.suptitle(title, fontsize=10.5, weight="bold")
        figure.legend(loc="outside lower center", ncols=3, columnspacing=1.4, handlelength=3.4)
        return style.save(figure, directory, stem)


def around(curve: Curve) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """A closed curve of ascending angles with the radius linear in the angle: straight lines cut corners.

    Returns:
        Angles [deg] at most FINE apart, radii, and the distance in them of the points given.
    """
    psi, radius = np.array([*curve, (curve[0][0] + 360.0, curve[0][1])]).T
    every = math.ceil(np.diff(psi).max() / FINE)
    place = np.arange(len(curve) * every + 1) / every
    given = np.arange(len(curve) + 1)
    return np.interp(place, given, psi), np.interp(place, given, radius), every


def _scales(axes: Any, largest: float, unit: str) -> None:
    """Label both coordinates and say which way the robot looks and stands."""
    angles = range(0, 360, 30)
    labels = [f"{a}°" if a <= 180 else f"\N{MINUS SIGN}{360 - a}°" for a in angles]
    axes.set_thetagrids(angles, labels)
    axes.set_rlim(0.0, 1.03 * largest)
    radii = [float(radius) for radius in axes.get_yticks() if 0.0 < radius < largest]
    axes.set_rgrids(radii, [])
    for radius in radii:
        axes.text(
            math.radians(RADIAL_LABELS), radius, f"{radius:g} {unit}", ha="center", va="center", zorder=6,
            bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.8},
        )  # fmt: skip
    place: dict[str, Any] = {"transform": axes.transAxes, "ha": "center", "va": "center", "weight": "bold"}
    axes.text(0.5, 1.075, "ψ = 0: forward", **place)
    axes.text(0.5, -0.075, "backward", **place)
    axes.text(-0.11, 0.5, "left: towards the stance foot", rotation=90, **place)
    axes.text(1.11, 0.5, "right: towards the swing foot", rotation=-90, **place)
