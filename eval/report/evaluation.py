"""The page of `evaluate` and `compare`: policies on the same pushes, a line and a picture of single ones.

Evaluations here have the labels of policies as their names; rows keep the names that commands take.
"""

import base64
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium as gym

from ...controllers.errors import PushRecoveryError
from ...envs.biped.env import BipedEpisodes
from ...envs.scenario.scenario import Scenario
from ..record.film import STRIP, sheet, watch
from ..rollout import environments, outcome
from ..rollout.environments import make_env
from ..rollout.outcome import reason_words
from ..score.evaluate import Evaluation
from ..score.report import (
    EXPLAINED,
    Evaluations,
    brief_measures,
    evaluation_tables,
    limit_details,
    ranked,
    reasons_of,
)
from . import headline, page, pushes
from .headline import SEED, rival
from .page import Command, manifest, require_report, rows_hash, short_labels, write_page

RECOVERED: dict[str, Any] = {"facecolor": page.BLUE}
OTHER: dict[str, Any] = {"facecolor": "white", "hatch": "xxxx"}  # a reason of an environment of others
LOOKS: Mapping[str, dict[str, Any]] = {  # of a reason, the same on every page
    outcome.NOT_SETTLED: {"facecolor": "white", "hatch": "////"},
    "com_height": {"facecolor": page.INK},
    "pelvis_tilt": {"facecolor": page.PALE},
    "dcm_diverged": {"facecolor": "white", "hatch": "...."},
    "not_finite": {"facecolor": page.GREY},
}


def ending_figure(evaluation: Evaluation) -> str:
    """One bar for each policy: its pushes by what became of them."""
    names = list(evaluation.rows)
    scores = [evaluation.score(name) for name in names]
    parts = [("recovered", RECOVERED, [score.recovered for score in scores])]
    for reason in reasons_of(evaluation):
        counts = [score.failures.get(reason, 0) for score in scores]
        parts.append((reason_words(reason), LOOKS.get(reason, OTHER), counts))
    with page.panel(0.7 + 0.25 * len(names)) as (figure, axes):
        left = [0] * len(names)
        for label, look, counts in parts:
            axes.barh(
                range(len(names)), counts, left=left, height=0.62, edgecolor=page.INK, linewidth=0.6,
                label=label, **look,
            )  # fmt: skip
            left = [start + count for start, count in zip(left, counts, strict=True)]
        axes.set_yticks(range(len(names)), [page.beside_axis(name) for name in names])
        axes.invert_yaxis()
        axes.set(xlabel="pushes", xlim=(0, len(evaluation.suite.scenarios)))
        page.legend_below(figure)
        words = "Pushes of each policy by what became of them; the numbers stand in the table"
        return page.to_svg(figure, words)


SIGNS = {"recovered": "\N{CHECK MARK}", "survived": "\N{WHITE CIRCLE}", "fell": "\N{MULTIPLICATION X}"}


@dataclass(frozen=True)
class ScenarioLine:
    """A push and one sign for each policy, with words behind it: what became of it, and what it took."""

    scenario_id: str
    words: str
    signs: tuple[tuple[str, str], ...]
    kind: str  # all, none or some of the policies recover
    share: str  # of F* at its moment; empty where there is none


def _sign(row: Mapping[str, Any]) -> tuple[str, str]:
    """One of SIGNS, and the words behind it."""
    ending = "recovered" if row["recovered"] else "survived" if row["survived"] else "fell"
    words = "" if row["recovered"] else page.outcome_words(row), brief_measures(row)
    return SIGNS[ending], "; ".join(filter(None, words))


def scenario_lines(evaluation: Evaluation, shares: Mapping[str, float]) -> list[ScenarioLine]:
    """One line for each scenario, in the order of the suite; `shares` of F* by scenario, where it has one."""
    lines = []
    for scenario, rows in evaluation.by_scenario():
        recovered = [row["recovered"] for row in rows]
        kind = "all" if all(recovered) else "some" if any(recovered) else "none"
        signs = tuple(map(_sign, rows))
        share = f"{shares[scenario.id]:.2f}" if scenario.id in shares else ""
        lines.append(ScenarioLine(scenario.id, page.scenario_words(scenario), signs, kind, share))
    return lines


@dataclass(frozen=True)
class PicturePart:
    """Captions and contents (addresses of the data themselves) of pictures, or why there are none."""

    pictures: tuple[tuple[str, str], ...] = ()
    reason: str = ""


def opponents(evaluation: Evaluation) -> tuple[str, str] | None:
    """The policy that recovers most and its rival; None where that differs by the seed of training alone."""
    best, other = ranked(evaluation)[0], rival(evaluation)
    return None if other is None or SEED.sub("", other) == SEED.sub("", best) else (best, other)


def telling_pushes(evaluation: Evaluation, a: str, b: str) -> list[Scenario]:
    """The weakest push that only a recovers from, and the weakest of b, as far as there are any."""
    sides: dict[bool, list[tuple[float, int]]] = {True: [], False: []}  # whether a recovers
    rows = zip(evaluation.suite.scenarios, evaluation.rows[a], evaluation.rows[b], strict=True)
    for place, (scenario, of_a, of_b) in enumerate(rows):
        if scenario.forces and of_a["recovered"] != of_b["recovered"]:
            sides[of_a["recovered"]].append((of_a["impulse"], place))
    return [evaluation.suite.scenarios[min(found)[1]] for found in sides.values() if found]


def picture_part(evaluation: Evaluation) -> PicturePart:
    """Draw the telling pushes of a biped; where nothing can be drawn, the reason."""
    pair = opponents(evaluation)
    if pair is None:
        return PicturePart()
    env = make_env(evaluation.env_id)
    env.close()
    if not isinstance(getattr(env.unwrapped, "episodes", None), BipedEpisodes):
        return PicturePart()
    try:
        return PicturePart(
            tuple(_drawn(evaluation, scenario, pair) for scenario in telling_pushes(evaluation, *pair))
        )
    except PushRecoveryError as error:
        return PicturePart(reason=str(error))


def _drawn(evaluation: Evaluation, scenario: Scenario, policies: tuple[str, str]) -> tuple[str, str]:
    """Caption and content of the picture of one push under two policies."""
    place = evaluation.suite.scenarios.index(scenario)
    rows = []
    for label in policies:
        row = evaluation.rows[label][place]
        camera = watch(evaluation.env_id, row["policy"], scenario)
        rows.append((f"{label} {page.outcome_words(row)}", camera))
    content = base64.b64encode(sheet(rows)).decode()
    caption = f"{scenario.id}: {page.scenario_words(scenario)}. {'; '.join(title for title, _ in rows)}."
    return caption, f"data:image/jpeg;base64,{content}"


NONE = PicturePart()


def labelled(evaluations: Evaluations) -> dict[str, Evaluation]:
    """The same evaluations with short labels as the names of their policies; rows keep the names."""
    labels = short_labels(next(iter(evaluations.values())).rows)
    return {
        profile: replace(one, rows={labels[name]: rows for name, rows in one.rows.items()})
        for profile, one in evaluations.items()
    }


def write_evaluation_page(
    evaluations: Evaluations, command: Command, directory: Path, pictures: PicturePart = NONE
) -> Path:
    """Write the page of a command into a directory, for evaluations of the same policies; returns its path.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    found = labelled(evaluations)
    first = next(iter(found.values()))
    env = environments.make_env(first.env_id)
    unwrapped: Any = env.unwrapped
    content = {
        "title": f"Push recovery on {first.suite.name}",
        "env_id": first.env_id,
        "suite": first.suite,
        "mass": float(unwrapped.robot.mass),
        "labels": list(first.rows),
        "parts": [_part(profile, one, env, command) for profile, one in found.items()],
        "rate_figure": headline.rate_figure(found),
        "pictures": pictures,
        "moments": f"{STRIP[0]:g} s to {STRIP[-1]:g} s",
        "most_shown": headline.SHOWN,
        "explained": {
            outcome.reason_words(r): EXPLAINED[r]
            for one in found.values()
            for r in reasons_of(one)
            if r in EXPLAINED
        },
        "measures": [one for one in outcome.MEASURES.values() if one.about],
        "signs": SIGNS,
        "replay": command.replay("PROFILE", "ID", "POLICY"),
        "manifest": manifest(command, _hashes(evaluations), _seeds(first)),
    }
    env.close()
    return write_page(directory, "evaluation.html", content, command)


def with_pictures(evaluations: Evaluations, command: Command, directory: Path) -> Path:
    """`write_evaluation_page` with pictures of the first profile, which take seconds; see there."""
    require_report()
    pictures = picture_part(next(iter(labelled(evaluations).values())))
    return write_evaluation_page(evaluations, command, directory, pictures)


def _part(profile: str, found: Evaluation, env: gym.Env, command: Command) -> Mapping[str, Any]:
    """Tables, figures and lists of one profile, as the template names them."""
    scenarios = found.suite.scenarios
    curves = {name: pushes.curves_of(scenarios, rows, name) for name, rows in found.rows.items()}
    furthest = max((float(c.impulse.max()) for group in curves.values() for c in group), default=0.0)
    mapped = pushes.mapped_pushes(env, scenarios)
    by_id = {name: {row["scenario_id"]: row for row in rows} for name, rows in found.rows.items()}
    return {
        "name": profile,
        "verdict": headline.verdict(found).replace(" %", "\N{NO-BREAK SPACE}%"),
        **evaluation_tables(found),
        "rates": headline.rates_table(found),
        "curves": pushes.curves_table(curve for group in curves.values() for curve in group),
        "curve_figures": [
            (name, pushes.curve_figure(group, furthest)) for name, group in curves.items() if group
        ],
        "mapped": len(mapped),
        "stands": any(push.stands for push in mapped),
        "direction_figures": [
            (name, pushes.direction_figure(name, mapped, rows)) for name, rows in by_id.items() if mapped
        ],
        "differing": headline.pairs_with_best(found, profile, command),
        "ending_figure": ending_figure(found),
        "limit_details": [one for one in limit_details(found) if one],
        "scenarios": scenario_lines(found, {push.scenario_id: push.share for push in mapped}),
        "seeds": headline.seed_part(found),
        "survival": pushes.survival_part(found),
    }


def _hashes(evaluations: Evaluations) -> list[tuple[str, str]]:
    """Hashes of suites, rows and policies."""
    hashes = []
    for one in evaluations.values():
        hashes.append((f"suite {one.suite.name} v{one.suite.version}", f"sha256 {one.suite.sha256}"))
        hashes.append(("its outcomes.jsonl", rows_hash(one.directory)[1]))
    for policy, rows in next(iter(evaluations.values())).rows.items():
        if digest := rows[0].get("policy_sha256"):
            hashes.append((f"policy {policy}", f"sha256 {digest}"))
    return hashes


def _seeds(evaluation: Evaluation) -> str:
    """Where the randomness of the scenarios comes from."""
    seeds = [scenario.noise_seed for scenario in evaluation.suite.scenarios]
    return (
        "pushes are fixed by the suite's hash; noise of sensors and model errors by the noise_seed of each "
        f"scenario, {min(seeds)} to {max(seeds)}; nothing else is random"
    )
