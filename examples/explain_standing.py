"""Draw the picture of docs/standing.md and print its numbers: python examples/explain_standing.py [DIR].

It shows the biped at rest on both feet from above, and how far an impulse J may throw its DCM, J / (m omega)
from the middle between the feet, until the soles, then the trunk, then steps of either foot are not enough.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

from matplotlib.patches import FancyBboxPatch, Rectangle
from matplotlib.ticker import MultipleLocator
from push_recovery.controllers.model.capturability import recoverable_offset
from push_recovery.controllers.model.standing import max_standing_impulse
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.eval.record import style

Box = tuple[float, float, float, float]  # how far a region reaches backward, forward, right and left
IMPULSE = BIPED.mass * BIPED.omega  # that shifts the DCM by a metre [N s/m]
LOOKS = {"step": "#dbe8f3", "hip": "#8db7d9", "ankle": "#2c6aa3"}
INK, QUIET = "#1b2733", "#5b6875"


def regions() -> dict[str, Box]:
    """By strategy, the DCMs that it catches, from the middle between the feet [m].

    All are boxes, since the soles are parallel. A step leaves the DCM to either foot as its stance foot; both
    boxes reach as far forward and backward, and overlap sideways.
    """

    def in_place(flywheel: bool) -> Box:
        reach = [
            max_standing_impulse(BIPED, math.radians(psi), flywheel=flywheel, limits=BIPED_LIMITS) / IMPULSE
            for psi in (180, 0, -90, 90)
        ]
        return -reach[0], reach[1], -reach[2], reach[3]

    bounds, aside = recoverable_offset(BIPED, BIPED_LIMITS), BIPED.pelvis_width / 2
    left = max(bounds.high[1] - aside, aside - bounds.low[1])  # from the right foot, from the left foot
    step = float(bounds.low[0]), float(bounds.high[0]), -float(left), float(left)
    return {"step": step, "hip": in_place(True), "ankle": in_place(False)}


def draw() -> Any:
    """The three regions, in the plane of the DCM; forward is to the right."""
    figure = style.new_figure(style.WIDTH, 5.1)
    axes = figure.subplots()
    axes.grid(visible=False)
    boxes = regions()
    for name, (back, ahead, right, left) in boxes.items():
        axes.add_patch(
            Rectangle((back, right), ahead - back, left - right, fc=LOOKS[name], ec="white", lw=1.2, zorder=1)
        )
    for side in (-1, 1):
        _sole(axes, side * BIPED.pelvis_width / 2)
    _words(axes, boxes)
    back, ahead, right, left = boxes["step"]
    axes.set(xlim=(back - 0.02, ahead + 0.02), ylim=(right - 0.1, left + 0.02), aspect="equal")
    for axis, name in ((axes.xaxis, "forward"), (axes.yaxis, "to the left")):
        axis.set_label_text(f"push {name} [N s]", color=QUIET)
        axis.set_major_locator(MultipleLocator(50.0 / IMPULSE))
        axis.set_major_formatter(lambda place, _: f"{IMPULSE * place:.0f}".replace("-", "\N{MINUS SIGN}"))
    axes.tick_params(length=0, colors=QUIET)
    axes.spines[:].set_visible(False)
    return figure


def _sole(axes: Any, y: float) -> None:
    """A sole from above."""
    length, width = BIPED.foot_length, BIPED.foot_width
    box = f"round,pad=0,rounding_size={0.2 * width:g}"
    look = {"boxstyle": box, "fc": "white", "ec": INK, "lw": 1.0, "alpha": 0.9, "zorder": 4}
    axes.add_patch(FancyBboxPatch((-length / 2, y - width / 2), length, width, **look))


def _words(axes: Any, boxes: dict[str, Box]) -> None:
    """What answers a push, in its region; and beside it what that means, and how hard a push it takes."""
    places = {
        "ankle": (0.0, 0.0, "white", 10.5),
        "hip": (0.0, 0.19, INK, 10.5),
        "step": (0.3, 0.46, INK, 16.0),
    }
    for name, (x, y, colour, size) in places.items():
        align = "left" if name == "step" else "center"
        axes.text(x, y, name, color=colour, size=size, weight="bold", ha=align, va="center", zorder=7)
    means = {
        "step": ("one foot steps, then the other", 0.32), "ankle": ("the load shifts under the soles", 0.0),
        "hip": ("and the trunk swings", -0.34),
    }  # fmt: skip
    for name, (what, y) in means.items():
        _, ahead, _, left = boxes[name]
        most = f"{IMPULSE * ahead:.0f} N s forward, {IMPULSE * left:.0f} sideways"
        axes.text(0.3, y, f"{what}:\n{most}", color=INK, va="center", linespacing=1.5)
    for start, end in (((0.092, 0.0), (0.28, 0.0)), ((0.14, -0.19), (0.28, -0.34))):
        axes.plot(*zip(start, end, strict=True), color=INK, lw=0.8, zorder=5)
        axes.plot(*start, "o", color=INK, ms=3, zorder=5)
    outside = boxes["step"][0], boxes["step"][2] - 0.05
    axes.text(*outside, "beyond: no controller keeps it up", color=QUIET, style="italic", va="center")


def main() -> None:
    """Write the picture into the directory given, docs/pictures by default."""
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "pictures")
    for name, box in regions().items():
        back, ahead, right, left = (IMPULSE * abs(reach) for reach in box)
        print(f"{name}: {ahead:.1f} N s forward, {back:.1f} backward, {left:.1f} left, {right:.1f} right")
    with style.print_style():
        png, svg = style.save(draw(), directory, "standing")
    svg.unlink()
    print(f"{png} {png.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
