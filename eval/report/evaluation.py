"""The page of `evaluate` and `compare`: policies on the same pushes, under one profile or several."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym

from ..record.film import STRIP
from ..rollout import environments, outcome
from ..score.evaluate import Evaluation
from ..score.report import EXPLAINED, Evaluations, evaluation_tables, limit_details, reasons_of
from . import headline, pushes
from .episodes import SIGNS, PicturePart, ending_figure, picture_part, scenario_lines
from .page import Command, manifest, require_report, rows_hash, short_labels, write_page

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
    return write_page(directory, "evaluation.html", content, command.page)


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
        "verdict": headline.verdict(found),
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
