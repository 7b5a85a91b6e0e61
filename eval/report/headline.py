"""The beginning of a page: who recovers more, how sure that is, pairs of policies, training seeds.

Evaluations here have the labels of policies as their names; rows keep the names that commands take.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..output import statistics as seeds
from ..output.statistics import Array, PairedCounts, wilson_interval
from ..output.tables import Table
from ..record.words import sector_of
from ..score.evaluate import Evaluation
from ..score.report import TURNED_NOTE, Evaluations, count_cells, origin_columns, p_words, points, ranked
from . import page
from .page import Command

RATE_LOOKS: tuple[dict[str, Any], ...] = (
    {"color": page.BLUE, "marker": "o"},
    {"color": page.ORANGE, "marker": "s"},
)
SURE = 0.05  # p below which chance is taken for an unlikely cause
VERY_SURE = 0.001


def verdict(evaluation: Evaluation) -> str:
    """Who recovers from most pushes, by how many more than its rival, and whether chance explains that."""
    first, score = ranked(evaluation)[0], evaluation.score(ranked(evaluation)[0])
    share = f"{score.recovered} of {score.episodes} pushes ({100.0 * score.rate:.1f} %)"
    other = rival(evaluation)
    if other is None:
        low, high = (100.0 * end for end in score.ci95)
        return f"{first} recovers from {share}; 95 % interval {low:.1f} to {high:.1f} %."
    pairs = PairedCounts.of_rows(evaluation.rows[first], evaluation.rows[other])
    more = pairs.only_a - pairs.only_b
    if not more:
        return f"{first} and {other} recover from equally many pushes, {share}."
    return f"{first} recovers from {share}, {more} more than {other}: {sureness(pairs)}."


SEED = re.compile(r"-seed\d+")  # in a label; without it, it names the recipe


def rival(evaluation: Evaluation) -> str | None:
    """The policy that the best one is held against; None where it is alone.

    Of a learned policy it is the best one without a file of weights, and the other way round; where there is
    no such policy, the next one, of another recipe if there is any.
    """
    first, *others = ranked(evaluation)
    others.sort(key=lambda name: SEED.sub("", name) == SEED.sub("", first))
    learned = {name: bool(rows[0].get("policy_sha256")) for name, rows in evaluation.rows.items()}
    return next((name for name in others if learned[name] != learned[first]), next(iter(others), None))


def sureness(pairs: PairedCounts) -> str:
    """Whether chance explains a difference, with Newcombe's interval and McNemar's p."""
    low, high = pairs.interval
    p = pairs.p_value
    words = "too few to say that it is better"
    if p < SURE:
        words = f"a lead that chance {'hardly makes' if p < VERY_SURE else 'is unlikely to make'}"
    found = f"{points(pairs.rate_difference)} points, 95 % interval {points(low)} to {points(high)}"
    return f"{words} ({found}; exact McNemar {p_words(p)})"


def rates_table(evaluation: Evaluation) -> Table:
    """Shares recovered from and survived in per cent, with Wilson's intervals; where policies come from."""
    lines, (origins, origin_note) = [], origin_columns(evaluation)
    for name in evaluation.rows:
        score, cells = evaluation.score(name), []
        for count in (score.recovered, score.survived):
            low, high = wilson_interval(count, score.episodes)
            cells += [f"{100.0 * count / score.episodes:.1f} % ({count})",
                      f"{100.0 * low:.1f}-{100.0 * high:.1f}"]  # fmt: skip
        own = (words[name] for words in origins.values())
        lines.append((name, *cells, *count_cells(score.turned, score.bent), *own))
    interval = "95 % interval [%]"
    columns = ("policy", "recovered", interval, "survived", interval, "turned", "bent", *origins)
    return Table("Recovered and survived", columns, lines, f"{TURNED_NOTE} {origin_note}".strip())


def rate_figure(evaluations: Evaluations) -> str:
    """A line for each policy: filled marks for recovered with their interval, hollow ones for survived."""
    names, count = list(next(iter(evaluations.values())).rows), len(evaluations)
    with page.panel(0.85 + (0.14 + 0.12 * count) * len(names)) as (figure, axes):
        for index, (profile, evaluation) in enumerate(evaluations.items()):
            shift = 0.3 * (index - (count - 1) / 2.0)
            _draw(axes, evaluation, names, shift, RATE_LOOKS[index % len(RATE_LOOKS)], profile)
        axes.set_yticks(range(len(names)), [page.beside_axis(name) for name in names])
        axes.set(ylim=(len(names) - 0.5, -0.5), xlabel="share of the pushes [%]")
        axes.grid(axis="x", color="#e4e4e4", linewidth=0.6)
        axes.set_axisbelow(True)
        page.legend_below(figure)
        words = "Share of pushes recovered from and survived; the numbers stand in the table"
        return page.to_svg(figure, words)


def _draw(
    axes: Any, evaluation: Evaluation, names: list[str], shift: float, look: Mapping[str, Any], profile: str
) -> None:
    """Recovered and survived of all policies under one profile."""
    places = [index + shift for index in range(len(names))]
    scores = [evaluation.score(name) for name in names]
    rates = [100.0 * score.rate for score in scores]
    ends = [[100.0 * end for end in score.ci95] for score in scores]
    reach = (
        [max(rate - low, 0.0) for rate, (low, _) in zip(rates, ends, strict=True)],
        [max(high - rate, 0.0) for rate, (_, high) in zip(rates, ends, strict=True)],
    )
    survived = [100.0 * score.survived / score.episodes for score in scores]
    axes.plot(
        survived, places, linestyle="none", markersize=5.5, markerfacecolor="white",
        label=f"survived, {profile}", **look,
    )  # fmt: skip
    axes.errorbar(
        rates, places, xerr=reach, linestyle="none", markersize=4.5, elinewidth=1.0, ecolor=page.GREY,
        label=f"recovered, {profile}", **look,
    )  # fmt: skip


SHOWN = 20  # pushes of one list


@dataclass(frozen=True)
class Differing:
    """One push that one of two policies recovers from."""

    scenario_id: str
    push: str
    impulse: float  # [N s]
    loser: str  # what became of the other
    commands: tuple[str, str]  # that replay it with the one and with the other


@dataclass(frozen=True)
class Pair:
    """Two policies, their 2 x 2 table, and the pushes that set them apart, weakest first."""

    a: str
    b: str
    counts: PairedCounts
    sureness: str
    only_a: tuple[Differing, ...]
    only_b: tuple[Differing, ...]


def pairs_with_best(evaluation: Evaluation, profile: str, command: Command) -> list[Pair]:
    """The policy that recovers most against each other one."""
    best, *others = ranked(evaluation)
    return [_pair(evaluation, best, other, profile, command) for other in others]


def _pair(evaluation: Evaluation, a: str, b: str, profile: str, command: Command) -> Pair:
    counts = PairedCounts.of_rows(evaluation.rows[a], evaluation.rows[b])
    lists: tuple[list[Differing], list[Differing]] = ([], [])
    rows = zip(evaluation.suite.scenarios, evaluation.rows[a], evaluation.rows[b], strict=True)
    for scenario, of_a, of_b in rows:
        if of_a["recovered"] != of_b["recovered"]:
            loser = of_b if of_a["recovered"] else of_a
            first, second = (command.replay(profile, scenario.id, row["policy"]) for row in (of_a, of_b))
            words = page.scenario_words(scenario), loser["impulse"], page.outcome_words(loser)
            lists[loser is of_a].append(Differing(scenario.id, *words, (first, second)))
    only_a, only_b = (tuple(sorted(found, key=lambda one: one.impulse)) for found in lists)
    return Pair(a, b, counts, sureness(counts), only_a, only_b)


QUARTERS = 4  # of the pushes, by impulse
DRAWS = 1000  # of a bootstrap
THRESHOLDS = np.linspace(0.0, 1.0, 41)
OTHERS = 2  # policies beside the recipes in the figure
SEED_LOOKS: tuple[dict[str, Any], ...] = (
    {"color": page.BLUE, "linestyle": "-"},
    {"color": page.ORANGE, "linestyle": (0, (4, 2))},
    {"color": page.INK, "linestyle": (0, (1, 1))},
    {"color": page.GREY, "linestyle": (0, (6, 2, 1, 2))},
)


@dataclass(frozen=True)
class SeedPart:
    """Scores of recipes with several seeds, as the page shows them."""

    strata: int
    recipes: Table
    against: Table
    figure: str


def recipes_of(labels: Iterable[str]) -> dict[str, list[str]]:
    """Recipe -> its policies: those whose labels are the same but for the seed."""
    groups: dict[str, list[str]] = {}
    for label in labels:
        groups.setdefault(SEED.sub("", label), []).append(label)
    return groups


def strata_of(rows: Sequence[Mapping[str, Any]]) -> np.ndarray:
    """Number of each push's stratum: one of eight directions and a quarter of the impulses."""
    rank = np.argsort(np.argsort([row["impulse"] for row in rows], kind="stable"), kind="stable")
    quarter = rank * QUARTERS // len(rows)
    sector = np.array([-1 if row["psi_deg"] is None else sector_of(row["psi_deg"]) for row in rows])
    return np.unique(QUARTERS * sector + quarter, return_inverse=True)[1]


def seed_part(evaluation: Evaluation) -> SeedPart | None:
    """Tables and profiles; None where no recipe has several seeds."""
    groups = recipes_of(evaluation.rows)
    recipes = [name for name, members in groups.items() if len(members) > 1]
    if not recipes:
        return None
    strata = strata_of(next(iter(evaluation.rows.values())))
    scores = {name: _scores(evaluation, members) for name, members in groups.items()}
    order = [SEED.sub("", name) for name in ranked(evaluation)]
    others = [name for name in dict.fromkeys(order) if name not in recipes]
    shown = {name: scores[name] for name in (*recipes, *others[:OTHERS])}
    against = [
        (a, b, _improvement(scores[a], scores[b], strata))
        for index, a in enumerate(recipes)
        for b in (*recipes[index + 1 :], *others)
    ]
    columns = ("recipe", "seeds", "recovered, lowest to highest seed", "interquartile mean")
    rows = [(name, *_cells(scores[name], strata)) for name in recipes]
    return SeedPart(
        int(strata.max()) + 1,
        Table("Recipes", columns, rows, words=2),
        Table("Against", ("recipe", "against", "chance that a seed does better"), against, words=2),
        profile_figure(shown, strata),
    )


def _scores(evaluation: Evaluation, members: Sequence[str]) -> Array:
    """1 for each push that a seed recovers from, 0 for the others (seeds, scenarios)."""
    return np.array([[row["recovered"] for row in evaluation.rows[name]] for name in members], dtype=float)


def _cells(scores: Array, strata: np.ndarray) -> tuple[str, ...]:
    """Number of seeds, counts of recoveries, and interquartile mean with its interval."""
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


def _improvement(a: Array, b: Array, strata: np.ndarray) -> str:
    """The chance that a seed of a recovers more of a stratum than one of b, with its interval."""

    def chance(first: Array, second: Array) -> float:
        rates = (seeds.stratum_rates(one, strata) for one in (first, second))
        return seeds.probability_of_improvement(*rates)

    rng = np.random.default_rng(0)
    low, high = seeds.bootstrap_interval(chance, [a, b], rng, draws=DRAWS, strata=strata)
    return f"{100.0 * chance(a, b):.0f} % ({100.0 * low:.0f} to {100.0 * high:.0f})"


def profile_figure(scores: Mapping[str, Array], strata: np.ndarray) -> str:
    """Share of strata in which a recipe recovers from more than a share of the pushes, over that share."""

    def profile(drawn: Array) -> Array:
        return seeds.performance_profile(seeds.stratum_rates(drawn, strata), THRESHOLDS)

    with page.panel(2.6) as (figure, axes):
        for (name, mine), look in zip(scores.items(), SEED_LOOKS, strict=False):
            band = seeds.bootstrap_interval(
                profile, [mine], np.random.default_rng(0), draws=DRAWS, strata=strata
            )
            axes.fill_between(
                100.0 * THRESHOLDS, *(100.0 * band), color=look["color"], alpha=0.15, linewidth=0
            )
            axes.plot(
                100.0 * THRESHOLDS, 100.0 * profile(mine), label=page.beside_axis(name), linewidth=1.4, **look
            )
        axes.set(
            xlim=(0.0, 100.0), ylim=(-3.0, 103.0), xlabel="recovered from more than [%]",
            ylabel="of groups and seeds [%]",
        )  # fmt: skip
        page.legend_below(figure)
        words = "Share of strata in which more than a share of the pushes is recovered from"
        return page.to_svg(figure, words)
