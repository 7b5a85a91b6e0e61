"""What a study has found, as tables and as one object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..output.tables import print_table
from .arms import ArmStudies
from .study import Study

COLUMNS = ("field", "start", "best", "change [units]")


def print_arms(found: ArmStudies) -> None:
    """The tables of every arm, and where the presets lie."""
    for study in found.studies.values():
        _print_study(study)
    print(f"preset of all of these arms: {found.path}")


def _print_study(study: Study) -> None:
    """Scores on both suites, and the fields that moved most."""
    settings, found = study.settings, study.preset.found
    print_table(
        f"{settings.env_id}: {settings.policy}, {found['trials']} trials, {found['episodes']} episodes",
        ("suite", "start", "best", "difference", "McNemar p"),
        [score_cells(name, found[name]) for name in ("tuning", "held_out")],
    )
    print_table("Fields that moved most", COLUMNS, field_cells(study))
    print(f"preset: {study.path}")


def summary(found: ArmStudies) -> dict[str, Any]:
    """What `--json` prints: how each arm's preset was found, and where they lie."""
    arms = {name: _summary(study) for name, study in found.studies.items()}
    return {"arms": arms, "preset": str(found.path), "out": str(found.directory)}


def _summary(study: Study) -> dict[str, Any]:
    found = study.preset.found
    keys = ("by", "trials", "stopped_early", "episodes", "trial", "suites", "code", "tuning", "held_out")
    return {
        "env": study.settings.env_id,
        "policy": study.settings.policy,
        **{name: found[name] for name in keys},
        "settings": study.best["settings"],
        "preset": str(study.path),
        "out": str(study.directory),
    }


def score_cells(name: str, entry: dict[str, Any]) -> tuple[str, ...]:
    """One suite: scores, recovered of all, the paired difference of the rates."""
    low, high = entry["ci95"]
    scores = [f"{part['score']:.3f} ({part['recovered']}/{entry['scenarios']})" for part in _parts(entry)]
    difference = f"{entry['rate_difference']:+.3f} ({low:+.3f} to {high:+.3f})"
    return (name.replace("_", " "), *scores, difference, f"{entry['mcnemar_p']:.3g}")


def field_cells(study: Study, most: int = 12) -> list[tuple[str, ...]]:
    """The fields whose values moved most, in their own units."""
    start, best = study.start["settings"], study.best["settings"]
    moves = zip(study.space.dimensions, study.best["point"], strict=True)
    cells: Sequence[tuple[float, tuple[str, ...]]] = [
        (abs(move), (d.label, f"{start[d.group][d.name]:g}", f"{best[d.group][d.name]:g}", f"{move:+.2f}"))
        for d, move in moves
    ]
    return [cell for _, cell in sorted(cells, key=lambda pair: -pair[0])[:most]]


def _parts(entry: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    return entry["start"], entry["best"]
