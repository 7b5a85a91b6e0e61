"""What a report begins with: who recovers more, how sure that is, and the rates of every policy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...output.statistics import PairedCounts, wilson_interval
from ...score.evaluate import Evaluation
from ..figure import BLUE, GREY, ORANGE, beside_axis, new_panel, page_style, to_svg

Evaluations = Mapping[str, Evaluation]  # by profile
COLUMNS = ("policy", "recovered", "95 % interval", "survived", "95 % interval")
LOOKS: tuple[dict[str, Any], ...] = ({"color": BLUE, "marker": "o"}, {"color": ORANGE, "marker": "s"})
SURE = 0.05  # p below which chance is taken for an unlikely cause
VERY_SURE, LEAST_P = 0.001, 0.0001
MINUS = "\N{MINUS SIGN}"


def ranked(evaluation: Evaluation) -> list[str]:
    """Policies, the one that recovers most first; equal ones in the order given."""
    return sorted(evaluation.rows, key=lambda name: -evaluation.score(name).recovered)


def verdict(evaluation: Evaluation, labels: Mapping[str, str]) -> str:
    """Who recovers from most pushes, by how many more than the next, and whether chance explains that."""
    first, *others = ranked(evaluation)
    score = evaluation.score(first)
    low, high = (100.0 * end for end in score.ci95)
    share = f"{score.recovered} of {score.episodes} pushes ({100.0 * score.rate:.1f} %)"
    if not others:
        return f"{labels[first]} recovers from {share}; 95 % interval {low:.1f} to {high:.1f} %."
    pairs = PairedCounts.of_rows(evaluation.rows[first], evaluation.rows[others[0]])
    second = labels[others[0]]
    if pairs.only_a == pairs.only_b:
        return f"{labels[first]} and {second} recover from equally many pushes, {share}."
    more = pairs.only_a - pairs.only_b
    return f"{labels[first]} recovers from {share}, {more} more than {second}: {sureness(pairs)}."


def sureness(pairs: PairedCounts) -> str:
    """Whether chance explains a difference, with Newcombe's interval and McNemar's p."""
    low, high = pairs.interval
    p = pairs.p_value
    said = (
        "a lead that chance hardly makes"
        if p < VERY_SURE
        else "a lead that chance is unlikely to make"
        if p < SURE
        else "too few to say that it is better"
    )
    found = f"{points(pairs.rate_difference)} points, 95 % interval {points(low)} to {points(high)}"
    return f"{said} ({found}; exact McNemar {p_words(p)})"


def points(share: float) -> str:
    """A difference of shares in points of per cent, with its sign."""
    return f"{100.0 * share:+.1f}".replace("-", MINUS)


def p_words(p: float) -> str:
    """A p value as people write it."""
    return f"p < {LEAST_P:g}" if p < LEAST_P else f"p = {p:.2g}"


def rate_cells(evaluation: Evaluation, labels: Mapping[str, str]) -> list[tuple[str, ...]]:
    """One row of cells for each policy, in COLUMNS."""
    cells = []
    for name in evaluation.rows:
        score = evaluation.score(name)
        parts = (_rate(count, score.episodes) for count in (score.recovered, score.survived))
        cells.append((labels[name], *(text for part in parts for text in part)))
    return cells


def _rate(count: int, episodes: int) -> tuple[str, str]:
    """A share and its Wilson interval."""
    low, high = wilson_interval(count, episodes)
    share = f"{100.0 * count / episodes:.1f} % ({count})"
    return share, f"{100.0 * low:.1f} to {100.0 * high:.1f} %"


def rate_figure(evaluations: Evaluations, labels: Mapping[str, str]) -> str:
    """A line for each policy: filled marks for recovered with their interval, hollow ones for survived."""
    names, count = list(labels), len(evaluations)
    with page_style():
        figure, axes = new_panel(0.85 + (0.22 + 0.14 * count) * len(names) + 0.17 * count)
        for index, (profile, evaluation) in enumerate(evaluations.items()):
            shift = 0.3 * (index - (count - 1) / 2.0)
            _draw(axes, evaluation, names, shift, LOOKS[index % len(LOOKS)], profile)
        axes.set_yticks(range(len(names)), [beside_axis(labels[name]) for name in names])
        axes.set(ylim=(len(names) - 0.5, -0.5), xlabel="share of the pushes [%]")
        axes.grid(axis="x", color="#e4e4e4", linewidth=0.6)
        axes.set_axisbelow(True)
        figure.legend(loc="outside lower left", frameon=False, fontsize=8.0, ncols=2)
        return to_svg(figure, "Share of pushes recovered from and survived; the numbers stand in the table")


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
        rates, places, xerr=reach, linestyle="none", markersize=4.5, elinewidth=1.0, ecolor=GREY,
        label=f"recovered, {profile}", **look,
    )  # fmt: skip
