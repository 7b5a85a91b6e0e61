"""Survival over time where a robot is pushed more than once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...output.survival import SurvivalCurve, kaplan_meier
from ...score.evaluate import Evaluation
from ..figure import BLUE, GREY, INK, ORANGE, beside_axis, new_panel, page_style, to_svg

MARKS = 3  # moments that the table tells of
COLORS, LINES = (BLUE, ORANGE, INK, GREY), ("-", (0, (4, 2)), (0, (1, 1)), (0, (6, 2, 1, 2)))
LOOKS: tuple[dict[str, Any], ...] = tuple(  # neighbours differ in both
    {"color": COLORS[k % 4], "linestyle": LINES[(k + k // 4) % 4]} for k in range(16)
)


@dataclass(frozen=True)
class SurvivalPart:
    """What the page shows of repeated pushes."""

    episodes: int
    columns: list[str]
    rows: list[tuple[str, ...]]
    figure: str


def survival_part(evaluation: Evaluation, labels: Mapping[str, str]) -> SurvivalPart | None:
    """Curves and a table over the scenarios with several pushes; None where there is none."""
    chosen = [i for i, scenario in enumerate(evaluation.suite.scenarios) if len(scenario.pushes) > 1]
    if not chosen:
        return None
    curves, falls = {}, {}
    for name, rows in evaluation.rows.items():
        mine = [rows[i] for i in chosen]
        fell = [not row["survived"] for row in mine]
        curves[labels[name]] = kaplan_meier([row["end_time"] for row in mine], fell)
        falls[labels[name]] = sum(fell)
    longest = max(float(curve.times[-1]) for curve in curves.values())
    marks = [float(time) for time in np.linspace(0.0, longest, MARKS + 1)[1:]]
    rows = [
        (label, str(falls[label]), *(share_at(curve, time) for time in marks))
        for label, curve in curves.items()
    ]
    columns = ["policy", "falls", *(f"standing at {time:.1f} s" for time in marks)]
    return SurvivalPart(len(chosen), columns, rows, survival_figure(curves, longest))


def share_at(curve: SurvivalCurve, time: float) -> str:
    """The share that stands at a time and its interval, in words."""
    index = int(np.searchsorted(curve.times, time, side="right")) - 1
    if index < 0:
        return "100.0 %"
    low, high = 100.0 * curve.low[index], 100.0 * curve.high[index]
    return f"{100.0 * curve.survival[index]:.1f} % ({low:.1f} to {high:.1f})"


def survival_figure(curves: Mapping[str, SurvivalCurve], longest: float) -> str:
    """A staircase for each policy, down where one of its robots falls.

    Args:
        curves: by label.
        longest: of the episodes [s].
    """
    with page_style():
        figure, axes = new_panel(2.2 + 0.1 * len(curves))
        for (label, curve), look in zip(curves.items(), LOOKS, strict=False):
            times, shares = [0.0, *curve.times, longest], [1.0, *curve.survival, curve.survival[-1]]
            axes.plot(
                times, 100.0 * np.array(shares), drawstyle="steps-post", linewidth=1.4,
                label=beside_axis(label), **look,
            )  # fmt: skip
        axes.set(xlim=(0.0, longest), xlabel="time since the walk began [s]", ylabel="standing [%]")
        axes.grid(axis="y", color="#e4e4e4", linewidth=0.6)
        figure.legend(loc="outside lower left", frameon=False, fontsize=8.0, ncols=2)
        return to_svg(figure, "Share of robots still standing, over time, under repeated pushes")
