"""Corrections by the direction of the push, as numbers and as tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.gait_box import GAIT_NAMES
from ..output.tables import markdown_table
from ..record.words import sector_of
from .corrections import STEPS, PushCorrections

Array = NDArray[np.float64]

SECTORS = ("forward", "forward outward", "outward", "backward outward",
           "backward", "backward inward", "inward", "forward inward")  # fmt: skip
UNITS = (("mm", 1e3),) * 2 + (("ms", 1e3),) + (("mm", 1e3),) * 2 + (("rad/s^2", 1.0),) * 2
SHOWN = tuple(f"{name.replace('_', ' ')} [{unit}]" for name, (unit, _) in zip(GAIT_NAMES, UNITS, strict=True))
STEP_NAMES = ("the step that is pushed in", "the next step", "the one after")


@dataclass(frozen=True, eq=False)
class Summary:
    """What many pushes have in common, by sector of 45 degrees about the directions of SECTORS."""

    pushes: Array  # (8,)
    repaired: Array  # (8,) recovered only with the residual
    lost: Array  # (8,) recovered only without it
    left: Array  # (8,) recovered by neither
    mean: Array  # (STEPS, 8, 7) of the corrections [UNITS]; NaN where there is none
    spread: Array  # (STEPS, 8, 7) standard deviation over pushes


def summarise(found: Sequence[PushCorrections]) -> Summary:
    """Count, and take means over pushes."""
    sectors = np.array([sector_of(one.psi) for one in found], dtype=np.int64)
    below, with_it = (
        np.array([getattr(one, name) for one in found], dtype=np.bool_)
        for name in ("below_recovered", "recovered")
    )
    scaled = np.array([one.corrections for one in found]) * [factor for _, factor in UNITS]
    shape = (STEPS, len(SECTORS), len(GAIT_NAMES))
    mean, spread = np.full(shape, np.nan), np.full(shape, np.nan)
    for sector in range(len(SECTORS)):
        for step in range(STEPS):
            values = scaled[sectors == sector, step]
            values = values[np.isfinite(values[:, 0])]
            if len(values):
                mean[step, sector], spread[step, sector] = values.mean(axis=0), values.std(axis=0)

    def count(which: NDArray[np.bool_]) -> Array:
        return np.bincount(sectors[which], minlength=len(SECTORS)).astype(np.float64)

    return Summary(
        count(np.ones(len(found), np.bool_)),
        count(with_it & ~below),
        count(below & ~with_it),
        count(~below & ~with_it),
        mean,
        spread,
    )


def outcome_table(summary: Summary) -> str:
    """Pushes by direction, and what became of them."""
    rows = [
        (name, *(f"{int(values[i])}" for values in counts))
        for i, name in enumerate(SECTORS)
        for counts in [(summary.pushes, summary.repaired, summary.lost, summary.left)]
    ]
    return markdown_table(("push", "pushes", "repaired", "lost by it", "left"), rows)


def correction_table(summary: Summary, step: int) -> str:
    """Mean and standard deviation of the corrections during a step, by direction."""
    rows = [
        (name, *(_cell(m, s) for m, s in zip(summary.mean[step, i], summary.spread[step, i], strict=True)))
        for i, name in enumerate(SECTORS)
    ]
    return markdown_table(("push", *SHOWN), rows)


def _cell(mean: float, spread: float) -> str:
    return "-" if np.isnan(mean) else f"{mean:+.1f} ({spread:.1f})"
