"""The corrections by direction as a figure: one panel a decision, and one of what became of the pushes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..reproduction.figures.style import ARM_STYLES, new_figure, print_style, save
from .summary import SECTORS, SHOWN, STEP_NAMES, Summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ANGLES = np.arange(-180.0, 181.0, 45.0)  # psi of the points [deg]
ORDER = (ANGLES / 45.0).astype(np.int64) % len(SECTORS)
LOOKS = [ARM_STYLES[name] for name in ("two-stage", "stage-1", "stage-1+cop")]  # of the steps
OUTCOMES = (("repaired", "#0b7a55", ""), ("lost", "#d7191c", "//"), ("left", "#bdbdbd", ".."))


def save_corrections(summary: Summary, directory: Path, stem: str = "corrections") -> list[Path]:
    """Write STEM.png and STEM.svg."""
    with print_style():
        figure = new_figure(10.0, 5.4)
        panels = figure.subplots(2, 4, sharex=True).ravel()
        for decision, (axes, name) in enumerate(zip(panels, SHOWN, strict=False)):
            _decision(axes, summary, decision, name)
        _outcomes(panels[-1], summary)
        for axes in panels:
            axes.set_xticks(ANGLES[::2], ["back", "in", "front", "out", "back"])
            axes.tick_params(axis="x", labelsize=8.0)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower left", ncols=len(labels))
        return save(figure, directory, stem)


def _decision(axes: Axes, summary: Summary, decision: int, name: str) -> None:
    """Mean correction against direction, one line a step, with a band of one standard deviation."""
    axes.axhline(0.0, color="#555555", lw=0.8)
    for step, (look, label) in enumerate(zip(LOOKS, STEP_NAMES, strict=True)):
        mean, spread = summary.mean[step, ORDER, decision], summary.spread[step, ORDER, decision]
        axes.plot(ANGLES, mean, color=look.colour, ls=look.line, marker=look.marker, ms=3.5, label=label)
        if step == 0:
            axes.fill_between(ANGLES, mean - spread, mean + spread, color=look.colour, alpha=0.15, lw=0.0)
    axes.set_title(name.replace("acceleration", "acc."), loc="left")


def _outcomes(axes: Axes, summary: Summary) -> None:
    """What became of the pushes that one of both loses, by direction."""
    bottom = np.zeros(len(ANGLES))
    for name, colour, hatch in OUTCOMES:
        values = getattr(summary, name)[ORDER]
        axes.bar(ANGLES, values, 34.0, bottom, color=colour, hatch=hatch, ec="white", lw=0.5, label=name)
        bottom += values
    axes.set_title("pushes lost by either", loc="left")
    axes.set_ylim(0.0, 1.5 * max(bottom.max(), 1.0))  # the legend stands above the bars
    axes.legend(fontsize=8.0, loc="upper left")
