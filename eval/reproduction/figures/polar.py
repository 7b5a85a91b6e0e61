"""Fig. 7: the largest recoverable push by direction, every arm against the closed-form limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from . import style

Curve = Sequence[tuple[float, float]]  # psi [deg], force [N] or impulse [N s]

STEM = "fig7_limits"
RADIAL_LABELS = (
    75.0  # where the radial axis is labelled: pushes inward are the weakest, so there is room [deg]
)


def draw(
    curves: Mapping[str, Curve],
    limits: Mapping[str, Curve],
    directory: Path,
    stem: str = STEM,
    title: str = "Largest recoverable push of 0.1 s at the start of a left stance, stepping in place",
    unit: str = "N",
) -> list[Path]:
    """Draw a polar map: forward is up, psi counter-clockwise, so that left is left.

    Args:
        curves: by arm, points (psi [deg], largest push) in the order of psi; closed here.
        limits: the same by closed-form limit; the names of `style.LIMIT_STYLES` have looks of their own.
        directory: where the pictures go.
        stem: of their names.
        title: over the picture.
        unit: of the radius.
    """
    with style.print_style():
        figure = style.new_figure(style.WIDTH, style.WIDTH + 0.9)
        axes: Any = figure.add_subplot(projection="polar")
        axes.set_theta_zero_location("N")
        for label, curve in limits.items():
            look = style.limit_style(label)
            axes.plot(*_closed(curve), color=look.colour, ls=look.line, lw=1.6, label=look.label, zorder=2)
        for arm, curve in curves.items():
            look = style.arm_style(arm)
            axes.plot(
                *_closed(curve), color=look.colour, ls=look.line, lw=1.5, marker=look.marker, ms=3.6,
                mew=0.9, label=look.label, zorder=3,
            )  # fmt: skip
        largest = max(radius for curve in (*curves.values(), *limits.values()) for _, radius in curve)
        _scales(axes, largest, unit)
        figure.suptitle(title, fontsize=10.5, weight="bold")
        figure.legend(loc="outside lower center", ncols=3, columnspacing=1.4, handlelength=3.4)
        return style.save(figure, directory, stem)


def _closed(curve: Curve) -> tuple[list[float], list[float]]:
    points = [*curve, curve[0]]
    return [math.radians(psi) for psi, _ in points], [radius for _, radius in points]


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
