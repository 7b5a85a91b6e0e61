"""Films of the pushes on which policies disagree: one recovers, another one does not."""

from __future__ import annotations

import re
from itertools import chain, zip_longest
from pathlib import Path
from typing import NamedTuple

from ...envs.scenario.scenario import Scenario
from ..output.progress import progress_bars, say
from ..output.work import Work, about
from ..score.evaluate import Evaluation
from .film import RATE, SLOW, shoot, write_pair

FOLDER = "films"  # below the results
SECONDS = 20.0  # that a film takes, about


class Disagreement(NamedTuple):
    """A push that one policy recovers from and another one does not."""

    place: int  # in the suite, from 0
    scenario: Scenario
    policies: tuple[str, str]  # in the order of the evaluation


def disagreements(evaluation: Evaluation) -> list[Disagreement]:
    """Pushes on which policies disagree; of many, the first that recovers and the first that does not.

    Who recovers takes turns, so that a few from the front show both sides.
    """
    turns: dict[tuple[str, str], list[Disagreement]] = {}
    order = list(evaluation.rows)
    for index, (scenario, rows) in enumerate(evaluation.by_scenario()):
        ends = {bool(row["recovered"]): name for name, row in reversed([*zip(order, rows, strict=True)])}
        if len(ends) == 2:
            first, second = sorted(ends.values(), key=order.index)
            turns.setdefault((ends[True], ends[False]), []).append(
                Disagreement(index, scenario, (first, second))
            )
    return [found for found in chain.from_iterable(zip_longest(*turns.values())) if found is not None]


def film_discordant(evaluation: Evaluation, count: int) -> list[Path]:
    """Film at most `count` of the pushes on which the policies disagree; returns the paths of the films.

    Args:
        evaluation: of two policies or more, each by its name, file or MODULE:ATTRIBUTE.
        count: of pushes; each makes a GIF and an mp4.

    Raises:
        PushRecoveryError: nothing can be drawn here.
    """
    found = disagreements(evaluation)
    chosen, folder, paths = found[:count], evaluation.directory / FOLDER, []
    what = f"films of {len(chosen)} of the {len(found)} pushes on which the policies disagree"
    if not chosen:
        say(Work(what, about(0.0)))
        return []
    folder.mkdir(parents=True, exist_ok=True)
    work = Work(what, about(SECONDS * len(chosen)), folder)
    with progress_bars([FOLDER], len(chosen), work) as bars:
        for done, (index, scenario, policies) in enumerate(chosen):
            shots = [shoot(evaluation.env_id, policy, scenario, RATE / SLOW) for policy in policies]
            paths += write_pair(shots, folder / film_name(index, scenario.id))
            bars.set(FOLDER, done + 1)
    return paths


def film_name(index: int, scenario_id: str) -> str:
    """Of the files of a film: place in the suite and id, without what the name of a file can't hold."""
    return f"{index:04d}-{re.sub(r'[^A-Za-z0-9.+-]+', '_', scenario_id)[:80]}"
