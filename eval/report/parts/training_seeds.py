"""Policies that differ in their training seed alone: what the recipe is worth, not one lucky run of it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...output import seeds
from ...record.words import sector_of
from ...score.evaluate import Evaluation
from ..figure import BLUE, GREY, INK, ORANGE, beside_axis, new_panel, page_style, to_svg
from .headline import ranked

Array = NDArray[np.float64]
SEED = re.compile(r"-seed\d+")  # in a label; without it, it names the recipe
QUARTERS = 4  # of the pushes, by impulse
DRAWS = 1000  # of a bootstrap
THRESHOLDS = np.linspace(0.0, 1.0, 41)
OTHERS = 2  # policies beside the recipes in the figure
COLUMNS = ("recipe", "seeds", "recovered, lowest to highest seed", "interquartile mean")
AGAINST = ("recipe", "against", "chance that a seed does better")
LOOKS: tuple[dict[str, Any], ...] = (
    {"color": BLUE, "linestyle": "-"},
    {"color": ORANGE, "linestyle": (0, (4, 2))},
    {"color": INK, "linestyle": (0, (1, 1))},
    {"color": GREY, "linestyle": (0, (6, 2, 1, 2))},
)


@dataclass(frozen=True)
class SeedPart:
    """What the page shows of recipes with several seeds."""

    strata: int
    rows: list[tuple[str, ...]]
    against: list[tuple[str, ...]]
    figure: str


def recipes_of(labels: Mapping[str, str]) -> dict[str, list[str]]:
    """Recipe -> its policies: those whose labels are the same but for the seed."""
    groups: dict[str, list[str]] = {}
    for name, label in labels.items():
        groups.setdefault(SEED.sub("", label), []).append(name)
    return groups


def strata_of(rows: Sequence[Mapping[str, Any]]) -> NDArray[np.int64]:
    """Number of each push's stratum: one of eight directions and a quarter of the impulses."""
    rank = np.argsort(np.argsort([row["impulse"] for row in rows], kind="stable"), kind="stable")
    quarter = rank * QUARTERS // len(rows)
    sector = np.array([-1 if row["psi_deg"] is None else sector_of(row["psi_deg"]) for row in rows])
    return np.unique(QUARTERS * sector + quarter, return_inverse=True)[1]


def seed_part(evaluation: Evaluation, labels: Mapping[str, str]) -> SeedPart | None:
    """Tables and profiles; None where no recipe has several seeds."""
    groups = recipes_of(labels)
    recipes = [name for name, members in groups.items() if len(members) > 1]
    if not recipes:
        return None
    strata = strata_of(next(iter(evaluation.rows.values())))
    scores = {name: _scores(evaluation, members) for name, members in groups.items()}
    order = [SEED.sub("", labels[name]) for name in ranked(evaluation)]
    others = [name for name in dict.fromkeys(order) if name not in recipes]
    shown = {name: scores[name] for name in (*recipes, *others[:OTHERS])}
    against = [
        (a, b, _improvement(scores[a], scores[b], strata))
        for index, a in enumerate(recipes)
        for b in (*recipes[index + 1 :], *others)
    ]
    rows = [(name, *_cells(scores[name], strata)) for name in recipes]
    return SeedPart(int(strata.max()) + 1, rows, against, profile_figure(shown, strata))


def _scores(evaluation: Evaluation, members: Sequence[str]) -> Array:
    """1 for each push that a seed recovers from, 0 for the others (seeds, scenarios)."""
    return np.array([[row["recovered"] for row in evaluation.rows[name]] for name in members], dtype=float)


def _cells(scores: Array, strata: NDArray[np.int64]) -> tuple[str, ...]:
    """Of COLUMNS, after the first."""
    counts = scores.sum(axis=1)
    middle = seeds.interquartile_mean(seeds.stratum_rates(scores, strata))
    low, high = seeds.bootstrap_interval(
        lambda drawn: seeds.interquartile_mean(seeds.stratum_rates(drawn, strata)),
        [scores], np.random.default_rng(0), draws=DRAWS, strata=strata,
    )  # fmt: skip
    return (
        str(len(scores)),
        f"{counts.mean():.1f} ({counts.min():.0f} to {counts.max():.0f})",
        f"{100.0 * middle:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})",
    )


def _improvement(a: Array, b: Array, strata: NDArray[np.int64]) -> str:
    """The chance that a seed of a recovers more of a stratum than one of b, with its interval."""

    def chance(first: Array, second: Array) -> float:
        rates = (seeds.stratum_rates(one, strata) for one in (first, second))
        return seeds.probability_of_improvement(*rates)

    rng = np.random.default_rng(0)
    low, high = seeds.bootstrap_interval(chance, [a, b], rng, draws=DRAWS, strata=strata)
    return f"{100.0 * chance(a, b):.0f} % ({100.0 * low:.0f} to {100.0 * high:.0f})"


def profile_figure(scores: Mapping[str, Array], strata: NDArray[np.int64]) -> str:
    """Of each recipe the share of strata in which more than a share of the pushes is recovered from.

    Args:
        scores: by recipe (seeds, scenarios).
        strata: of the scenarios.
    """

    def profile(drawn: Array) -> Array:
        return seeds.performance_profile(seeds.stratum_rates(drawn, strata), THRESHOLDS)

    with page_style():
        figure, axes = new_panel(2.6)
        for (name, mine), look in zip(scores.items(), LOOKS, strict=False):
            band = seeds.bootstrap_band(profile, [mine], np.random.default_rng(0), draws=DRAWS, strata=strata)
            axes.fill_between(
                100.0 * THRESHOLDS, *(100.0 * band), color=look["color"], alpha=0.15, linewidth=0
            )
            axes.plot(
                100.0 * THRESHOLDS, 100.0 * profile(mine), label=beside_axis(name), linewidth=1.4, **look
            )
        axes.set(
            xlim=(0.0, 100.0), ylim=(-3.0, 103.0), xlabel="recovered from more than [%]",
            ylabel="of groups and seeds [%]",
        )  # fmt: skip
        figure.legend(loc="outside lower left", frameon=False, fontsize=8.0, ncols=2)
        return to_svg(figure, "Share of strata in which more than a share of the pushes is recovered from")
