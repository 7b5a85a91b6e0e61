"""Every two policies on the same pushes, and the pushes on which the best one and another differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

from ...output.statistics import PairedCounts, holm
from ...score.evaluate import Evaluation
from ..labels import outcome_words, scenario_words
from ..replay import Command
from .headline import p_words, points, ranked, sureness

COLUMNS = ("A and B", "both", "only A", "only B", "neither", "A minus B [points]", "p", "p, Holm")
MOST_SHOWN = 20  # pushes of one list


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


def pair_cells(evaluation: Evaluation, labels: Mapping[str, str]) -> list[tuple[str, ...]]:
    """One row of cells for every two policies, in COLUMNS."""
    pairs = {
        (a, b): PairedCounts.of_rows(evaluation.rows[a], evaluation.rows[b])
        for a, b in combinations(ranked(evaluation), 2)
    }
    corrected = holm([counts.p_value for counts in pairs.values()])
    cells = []
    for ((a, b), counts), p in zip(pairs.items(), corrected, strict=True):
        low, high = counts.interval
        found = f"{points(counts.rate_difference)} ({points(low)} to {points(high)})"
        numbers = (counts.both, counts.only_a, counts.only_b, counts.neither)
        said = (p_words(value).removeprefix("p ").removeprefix("= ") for value in (counts.p_value, p))
        cells.append((f"{labels[a]} and {labels[b]}", *map(str, numbers), found, *said))
    return cells


def pairs_with_best(
    evaluation: Evaluation, labels: Mapping[str, str], profile: str, command: Command
) -> list[Pair]:
    """The policy that recovers most against each other one."""
    if len(evaluation.rows) < 2:
        return []
    best, *others = ranked(evaluation)
    return [_pair(evaluation, best, other, labels, profile, command) for other in others]


def _pair(
    evaluation: Evaluation, a: str, b: str, labels: Mapping[str, str], profile: str, command: Command
) -> Pair:
    counts = PairedCounts.of_rows(evaluation.rows[a], evaluation.rows[b])
    lists: tuple[list[Differing], list[Differing]] = ([], [])
    rows = zip(evaluation.suite.scenarios, evaluation.rows[a], evaluation.rows[b], strict=True)
    for scenario, of_a, of_b in rows:
        if of_a["recovered"] == of_b["recovered"]:
            continue
        loser = of_b if of_a["recovered"] else of_a
        commands = command.replay(profile, scenario.id, a), command.replay(profile, scenario.id, b)
        found = Differing(
            scenario.id, scenario_words(scenario), loser["impulse"], outcome_words(loser), commands
        )
        lists[0 if of_a["recovered"] else 1].append(found)
    only_a, only_b = (tuple(sorted(found, key=lambda one: one.impulse)) for found in lists)
    return Pair(labels[a], labels[b], counts, sureness(counts), only_a, only_b)
