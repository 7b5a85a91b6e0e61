"""What became of single pushes: endings, limits met, pictures, and a table of all.

What became of the pushes of each policy, and which limits its falls and its recoveries met.

Every push of a suite with what became of it, for a table with a filter.

Pictures of the pushes that tell most: the weakest ones that one of two policies recovers from alone.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ...controllers.errors import PushRecoveryError
from ...controllers.whole_body.limits import BOUNDS
from ...envs.biped.env import BipedEpisodes
from ...envs.scenario.scenario import Scenario
from ..record.film import sheet, watch
from ..rollout.environments import make_env
from ..score.evaluate import Evaluation, bound_summary
from .headline import SEED, ranked
from .page import (
    BLUE,
    GREY,
    INK,
    LIMITS,
    PALE,
    REASONS,
    beside_axis,
    effort_words,
    new_panel,
    outcome_words,
    page_style,
    scenario_words,
    to_svg,
)

RECOVERED = "recovered"
LOOKS: tuple[dict[str, Any], ...] = (  # recovered, then reasons in turn
    {"facecolor": BLUE},
    {"facecolor": "white", "hatch": "////"},
    {"facecolor": INK},
    {"facecolor": PALE},
    {"facecolor": "white", "hatch": "...."},
    {"facecolor": GREY},
)


def reasons_of(evaluation: Evaluation) -> list[str]:
    """Why episodes did not recover, in the order of REASONS, unknown ones last."""
    met = {reason for name in evaluation.rows for reason in evaluation.score(name).failures}
    return [*(reason for reason in REASONS if reason in met), *sorted(met - REASONS.keys())]


def reason_cells(evaluation: Evaluation, labels: Mapping[str, str]) -> list[tuple[str, ...]]:
    """Of each policy how many pushes it recovered from, and how many were lost for each of `reasons_of`."""
    reasons = reasons_of(evaluation)
    cells = []
    for name in evaluation.rows:
        score = evaluation.score(name)
        cells.append((labels[name], str(score.recovered), *(str(score.failures.get(r, 0)) for r in reasons)))
    return cells


def ending_figure(evaluation: Evaluation, labels: Mapping[str, str]) -> str:
    """One bar for each policy: its pushes by what became of them."""
    reasons, names = reasons_of(evaluation), list(evaluation.rows)
    parts = [(RECOVERED, [evaluation.score(name).recovered for name in names])]
    parts += [(r, [evaluation.score(name).failures.get(r, 0) for name in names]) for r in reasons]
    with page_style():
        figure, axes = new_panel(0.95 + 0.3 * len(names) + 0.16 * len(parts))
        left = [0] * len(names)
        for index, (label, counts) in enumerate(parts):
            look = LOOKS[index % len(LOOKS)]
            axes.barh(
                range(len(names)), counts, left=left, height=0.62, edgecolor=INK, linewidth=0.6,
                label=label, **look,
            )  # fmt: skip
            left = [start + count for start, count in zip(left, counts, strict=True)]
        axes.set_yticks(range(len(names)), [beside_axis(labels[name]) for name in names])
        axes.invert_yaxis()
        axes.set(xlabel="pushes", xlim=(0, len(evaluation.suite.scenarios)))
        figure.legend(loc="outside lower left", frameon=False, fontsize=8.0, ncols=2)
        return to_svg(figure, "Pushes of each policy by what became of them; the numbers stand in the table")


def limit_cells(evaluation: Evaluation, labels: Mapping[str, str]) -> tuple[list[str], list[tuple[str, ...]]]:
    """Headings and rows: of each limit met, what it is, and how long falls and recoveries were at it."""
    summaries = {name: bound_summary(rows) for name, rows in evaluation.rows.items()}
    cells = []
    for limit in BOUNDS:
        if not any(limit in part for summary in summaries.values() for part in summary.values()):
            continue
        shares = [_shares(summary, limit) for summary in summaries.values()]
        cells.append((limit, LIMITS.get(limit, ""), *shares))
    return ["limit", "met while", *(labels[name] for name in summaries)], cells


def _shares(summary: Mapping[str, Mapping[str, Mapping[str, float]]], limit: str) -> str:
    """Mean share of the time at a limit, of falls and of recoveries."""
    times = (summary[part].get(limit, {}).get("time", 0.0) for part in ("falls", "recovered"))
    return " / ".join(f"{100.0 * time:.0f} %" for time in times)


def explained(reasons: Iterable[str]) -> list[tuple[str, str]]:
    """Reasons with what they mean, each once, as far as that is known."""
    return [(reason, REASONS[reason]) for reason in dict.fromkeys(reasons) if reason in REASONS]


ScenarioRow = Mapping[str, Any]
SIGNS = {"recovered": "\N{CHECK MARK}", "survived": "\N{WHITE CIRCLE}", "fell": "\N{MULTIPLICATION X}"}


@dataclass(frozen=True)
class ScenarioLine:
    """A push and one sign for each policy, with words behind it: what became of it, and what it took."""

    scenario_id: str
    words: str
    signs: tuple[tuple[str, str], ...]
    kind: str  # all, none or some of the policies recover
    share: str  # of F* at its moment; empty where there is none


def sign_of(row: ScenarioRow) -> str:
    """Of SIGNS."""
    return SIGNS["recovered" if row["recovered"] else "survived" if row["survived"] else "fell"]


def scenario_lines(evaluation: Evaluation, shares: Mapping[str, float]) -> list[ScenarioLine]:
    """One line for each scenario, in the order of the suite; `shares` of F* by scenario, where it has one."""
    lines = []
    for scenario, rows in evaluation.by_scenario():
        recovered = [row["recovered"] for row in rows]
        kind = "all" if all(recovered) else "some" if any(recovered) else "none"
        signs = tuple((sign_of(row), _behind(row)) for row in rows)
        share = f"{shares[scenario.id]:.2f}" if scenario.id in shares else ""
        lines.append(ScenarioLine(scenario.id, scenario_words(scenario), signs, kind, share))
    return lines


def _behind(row: ScenarioRow) -> str:
    """Words behind a sign."""
    told = "" if row["recovered"] else outcome_words(row), effort_words(row)
    return "; ".join(words for words in told if words)


@dataclass(frozen=True)
class Picture:
    """One push under two policies."""

    caption: str
    content: str  # address of the data themselves


@dataclass(frozen=True)
class PicturePart:
    """Pictures, or why there are none."""

    pictures: tuple[Picture, ...] = ()
    reason: str = ""


def opponents(evaluation: Evaluation, labels: Mapping[str, str]) -> tuple[str, str] | None:
    """The policy that recovers most and the next one of another recipe; None where there is none."""
    best, *others = ranked(evaluation)
    recipe = SEED.sub("", labels[best])
    return next(((best, other) for other in others if SEED.sub("", labels[other]) != recipe), None)


def telling_pushes(evaluation: Evaluation, a: str, b: str) -> list[Scenario]:
    """The weakest push that only a recovers from, and the weakest of b, as far as there are any."""
    sides: dict[bool, list[tuple[float, int]]] = {True: [], False: []}  # whether a recovers
    rows = zip(evaluation.suite.scenarios, evaluation.rows[a], evaluation.rows[b], strict=True)
    for place, (scenario, of_a, of_b) in enumerate(rows):
        if scenario.pushes and of_a["recovered"] != of_b["recovered"]:
            sides[of_a["recovered"]].append((of_a["impulse"], place))
    return [evaluation.suite.scenarios[min(found)[1]] for found in sides.values() if found]


def picture_part(evaluation: Evaluation, labels: Mapping[str, str]) -> PicturePart:
    """Draw the telling pushes of a biped; where nothing can be drawn, the reason."""
    pair = opponents(evaluation, labels)
    if pair is None or not _is_biped(evaluation.env_id):
        return PicturePart()
    try:
        return PicturePart(
            tuple(
                _drawn(evaluation, scenario, pair, labels) for scenario in telling_pushes(evaluation, *pair)
            )
        )
    except PushRecoveryError as error:
        return PicturePart(reason=str(error))


def _is_biped(env_id: str) -> bool:
    env = make_env(env_id)
    env.close()
    return isinstance(getattr(env.unwrapped, "episodes", None), BipedEpisodes)


def _drawn(
    evaluation: Evaluation, scenario: Scenario, policies: tuple[str, str], labels: Mapping[str, str]
) -> Picture:
    place = evaluation.suite.scenarios.index(scenario)
    rows, said = [], []
    for policy in policies:
        words = outcome_words(evaluation.rows[policy][place])
        rows.append((f"{labels[policy]} {words}", watch(evaluation.env_id, policy, scenario)))
        said.append(f"{labels[policy]} {words}")
    content = base64.b64encode(sheet(rows)).decode()
    caption = f"{scenario.id}: {scenario_words(scenario)}. {'; '.join(said)}."
    return Picture(caption, f"data:image/jpeg;base64,{content}")
