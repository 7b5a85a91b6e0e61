"""Pictures of the pushes that tell most: the weakest ones that one of two policies recovers from alone."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass

from ....controllers.errors import PushRecoveryError
from ....envs.biped.env import BipedEpisodes
from ....envs.scenario.scenario import Scenario
from ...film.moments import Row, sheet, watch
from ...rollout.environments import make_env
from ...score.evaluate import Evaluation
from ..labels import outcome_words, scenario_words
from .headline import ranked
from .training_seeds import SEED


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
        rows.append(Row(f"{labels[policy]} {words}", watch(evaluation.env_id, policy, scenario)))
        said.append(f"{labels[policy]} {words}")
    content = base64.b64encode(sheet(rows)).decode()
    caption = f"{scenario.id}: {scenario_words(scenario)}. {'; '.join(said)}."
    return Picture(caption, f"data:image/jpeg;base64,{content}")
