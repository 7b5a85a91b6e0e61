"""The same search for several variants of the planner, and what it found.

The same search for several arms, one after the other: one budget, one start, one record.

What a study has found, as tables and as one object.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.settings import PresetFile, load_preset
from ..output.rows import Writer, default_directory
from ..output.tables import Table
from ..rollout.environments import code_digest
from .study import OnTrial, Study, TuningSettings, space_of, tune, whose


@dataclass(frozen=True)
class ArmStudies:
    """What the studies of some arms have found."""

    studies: Mapping[str, Study]  # by arm
    preset: PresetFile  # the start, with what is best for each arm; `found` says how, by arm
    directory: Path

    @property
    def path(self) -> Path:
        """The preset file."""
        return self.directory / "preset.json"


def place_of(settings: TuningSettings, policies: Sequence[str]) -> Path:
    """The directory of such studies under runs/, where none is named."""
    return default_directory("tune", _configuration(settings, policies))


def tune_arms(
    settings: TuningSettings,
    policies: Sequence[str],
    trials: int,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
    on_trial: Mapping[str, OnTrial] | None = None,
    on_begin: Callable[[], object] = lambda: None,
) -> ArmStudies:
    """Search for each arm in a directory of its own name; what is there already is not run again.

    Args:
        settings: what is tuned on what; its policy is replaced by each arm in turn.
        policies: the arms.
        trials: the budget of each.
        workers: processes; they change no result.
        directory: of the arms' directories and of preset.json; by default under runs/.
        overwrite: start over where a directory holds trials.
        on_trial: by arm, called after each of its trials.
        on_begin: called once the directory is this run's.

    Raises:
        PushRecoveryError: unknown names, impossible values, a directory of another study, or one to which
            another run is writing.
    """
    each = check_arms(settings, policies)
    directory = directory or place_of(settings, list(each))
    with Writer(directory):
        on_begin()
        studies = {
            name: tune(own, trials, workers, directory / name, overwrite, (on_trial or {}).get(name))
            for name, own in each.items()
        }
        found = ArmStudies(studies, _merged(settings, studies), directory)
        found.preset.save(found.path)
    return found


def check_arms(settings: TuningSettings, policies: Sequence[str]) -> dict[str, TuningSettings]:
    """What each arm's study is.

    Raises:
        PushRecoveryError: an arm or a field that cannot be tuned, or an arm that comes twice.
    """
    if twice := [name for name in policies if policies.count(name) > 1]:
        raise InvalidValueError(f"arm {twice[0]!r} is given more than once")
    each = {name: replace(settings, policy=name) for name in policies}
    for own in each.values():
        space_of(own)
    return each


def _merged(settings: TuningSettings, studies: Mapping[str, Study]) -> PresetFile:
    """The start with the arms' own settings of every study put in."""
    start = load_preset(settings.preset)
    arms = {**start.arms, **{name: study.preset.arms[name] for name, study in studies.items()}}
    found = {name: study.preset.found for name, study in studies.items()}
    return replace(start, arms=arms, found={**whose(start), **found})


def _configuration(settings: TuningSettings, policies: Sequence[str]) -> dict[str, Any]:
    """What the default directory is named after."""
    start = {**load_preset(settings.preset).to_dict(), "found": {}}
    return {"tune": {**settings.to_dict(), "policy": list(policies)}, "start": start, "code": code_digest()}


def result_tables(found: ArmStudies) -> list[Table]:
    """Of each arm its scores on both suites, and the fields that moved most."""
    tables = []
    for study in found.studies.values():
        settings, content = study.settings, study.preset.found
        title = (
            f"{settings.env_id}: {settings.policy}, {content['trials']} trials, "
            f"{content['episodes']} episodes ({study.path})"
        )
        scores = [score_cells(name, content[name]) for name in ("tuning", "held_out")]
        tables.append(Table(title, ("suite", "start", "best", "difference", "McNemar p"), scores))
        moved = field_cells(study)
        tables.append(Table("Fields that moved most", ("field", "start", "best", "change [units]"), moved))
    return tables


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
