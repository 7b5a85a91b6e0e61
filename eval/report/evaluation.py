"""The page of `evaluate` and `compare`: policies on the same pushes, under one profile or several."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

from ..record.film import STRIP
from ..rollout.environments import make_env
from ..score.evaluate import Evaluation
from ..score.report import EFFORT_COLUMNS, effort_cells, effort_summary, groups_of, kind_cells
from . import episodes as failures
from . import headline
from . import headline as pairs
from . import headline as training_seeds
from . import pushes as impulse
from .episodes import SIGNS, PicturePart, ScenarioLine, picture_part, scenario_lines
from .headline import SeedPart, seed_part
from .page import Command, code_hash, manifest, require_report, rows_hash, short_labels, write_page
from .pushes import SurvivalPart, direction_figure, mapped_pushes, survival_part

Evaluations = Mapping[str, Evaluation]  # by profile
Cells = list[tuple[str, ...]]
NONE = PicturePart()


@dataclass(frozen=True)
class ProfilePart:
    """What the page shows of one profile."""

    name: str
    verdict: str
    rates: Cells
    curves: Cells
    curve_figures: list[tuple[str, str]]  # label and figure
    mapped: int  # single pushes on the maps
    direction_figures: list[tuple[str, str]]
    pair_cells: Cells
    pairs: list[pairs.Pair]
    reason_columns: list[str]
    reasons: Cells
    ending_figure: str
    limit_columns: list[str]
    limits: Cells
    kind_columns: list[str]
    kinds: Cells
    effort: Cells
    together: int  # pushes that all policies recover from
    scenarios: list[ScenarioLine]
    seeds: SeedPart | None
    survival: SurvivalPart | None


def write_evaluation_page(
    evaluations: Evaluations, command: Command, directory: Path, pictures: PicturePart = NONE
) -> Path:
    """Write report.html into a directory; returns its path.

    Args:
        evaluations: of the same policies, by profile.
        command: that led to them.
        directory: where the page goes.
        pictures: of pushes that set two policies apart.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    first = next(iter(evaluations.values()))
    labels = short_labels(first.rows)
    env = make_env(first.env_id)
    parts = [_part(name, found, labels, env, command) for name, found in evaluations.items()]
    unwrapped: Any = env.unwrapped
    mass = float(unwrapped.robot.mass)
    env.close()
    content = {
        "title": f"Push recovery on {first.suite.name}",
        "env_id": first.env_id,
        "suite": first.suite,
        "mass": mass,
        "labels": labels,
        "parts": parts,
        "rate_figure": headline.rate_figure(evaluations, labels),
        "rate_columns": headline.RATE_COLUMNS,
        "curve_columns": impulse.COLUMNS,
        "pictures": pictures,
        "moments": f"{STRIP[0]:g} s to {STRIP[-1]:g} s",
        "pair_columns": pairs.PAIR_COLUMNS,
        "most_shown": pairs.MOST_SHOWN,
        "seed_columns": training_seeds.SEED_COLUMNS,
        "against_columns": training_seeds.AGAINST,
        "effort_columns": EFFORT_COLUMNS,
        "explained": failures.explained([r for part in parts for r in part.reason_columns]),
        "signs": SIGNS,
        "replay": command.replay("PROFILE", "ID", "POLICY"),
        "manifest": manifest(command, _hashes(evaluations), _seeds(first)),
    }
    return write_page(directory, "evaluation.html", content)


def with_pictures(evaluations: Evaluations, command: Command, directory: Path) -> Path:
    """`write_evaluation_page` with pictures of the first profile, which take seconds; see there."""
    require_report()
    first = next(iter(evaluations.values()))
    pictures = picture_part(first, short_labels(first.rows))
    return write_evaluation_page(evaluations, command, directory, pictures)


def _part(
    name: str, found: Evaluation, labels: Mapping[str, str], env: gym.Env, command: Command
) -> ProfilePart:
    """Everything of one profile."""
    scenarios = found.suite.scenarios
    curves = {
        policy: impulse.curves_of(scenarios, rows, labels[policy]) for policy, rows in found.rows.items()
    }
    furthest = max((float(c.impulse.max()) for group in curves.values() for c in group), default=0.0)
    mapped = mapped_pushes(env, scenarios)
    by_id = {policy: {row["scenario_id"]: row for row in rows} for policy, rows in found.rows.items()}
    limit_columns, limits = failures.limit_cells(found, labels)
    groups = {policy: kind_cells(scenarios, rows) for policy, rows in found.rows.items()}
    return ProfilePart(
        name,
        headline.verdict(found, dict(labels)),
        headline.rate_cells(found, labels),
        [cell for group in curves.values() for cell in impulse.curve_cells(group)],
        [(group[0].policy, impulse.curve_figure(group, furthest)) for group in curves.values() if group],
        len(mapped),
        [(labels[p], direction_figure(labels[p], mapped, rows)) for p, rows in by_id.items() if mapped],
        pairs.pair_cells(found, labels),
        pairs.pairs_with_best(found, labels, name, command),
        failures.reasons_of(found),
        failures.reason_cells(found, labels),
        failures.ending_figure(found, labels),
        limit_columns,
        limits,
        ["kind of push", *labels.values()],
        [(group, *(cells[group] for cells in groups.values())) for group in groups_of(scenarios)],
        effort_cells(found, labels),
        effort_summary(found)[0],
        scenario_lines(found, {push.scenario_id: push.share for push in mapped}),
        seed_part(found, labels),
        survival_part(found, labels),
    )


def _hashes(evaluations: Evaluations) -> list[tuple[str, str]]:
    """Of suites, rows, code and policies."""
    found = []
    for one in evaluations.values():
        found.append((f"suite {one.suite.name} v{one.suite.version}", f"sha256 {one.suite.sha256}"))
        found.append(("its outcomes.jsonl", rows_hash(one.directory)))
    first = next(iter(evaluations.values()))
    found.append(code_hash())
    for policy, rows in first.rows.items():
        if digest := rows[0].get("policy_sha256"):
            found.append((f"policy {policy}", f"sha256 {digest}"))
    return found


def _seeds(evaluation: Evaluation) -> str:
    """Where the randomness of the scenarios comes from."""
    seeds = [scenario.noise_seed for scenario in evaluation.suite.scenarios]
    return (
        "pushes are fixed by the suite's hash; noise of sensors and model errors by the noise_seed of each "
        f"scenario, {min(seeds)} to {max(seeds)}; nothing else is random"
    )
