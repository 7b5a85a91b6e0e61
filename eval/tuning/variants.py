"""The same search for several variants of the planner: one budget, one start, one record, and its tables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.settings import PresetFile, load_preset
from ..output.rows import Writer, default_directory
from ..output.tables import Table
from ..rollout.environments import code_digest, preset_digest
from .study import OnTrial, Study, TuningSettings, check_can_begin, tune, whose


@dataclass(frozen=True)
class VariantStudies:
    """Results of the studies of some variants."""

    studies: Mapping[str, Study]  # by variant
    preset: PresetFile  # the start, with the best settings of each variant; `found` says how, by variant
    directory: Path

    @property
    def path(self) -> Path:
        """The preset file."""
        return self.directory / "preset.json"


def place_of(settings: TuningSettings, policies: Sequence[str]) -> Path:
    """The directory of such studies under runs/, where none is named."""
    start = {**load_preset(settings.preset).to_dict(), "found": {}}
    tuned = {**settings.to_dict(), "policy": list(policies)}
    content = {"tune": tuned, "start": start, "code": code_digest(), **preset_digest(settings.env_id)}
    return default_directory("tune", content)


def tune_variants(
    settings: TuningSettings,
    policies: Sequence[str],
    trials: int,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
    on_trial: Mapping[str, OnTrial] | None = None,
    on_begin: Callable[[], object] = lambda: None,
) -> VariantStudies:
    """Search for each variant in a directory of its own name; finished trials are not run again.

    Args:
        settings: what is tuned on what; its policy is replaced by each variant in turn.
        policies: the variants.
        trials: the budget of each.
        workers: processes; they change no result.
        directory: of the variants' directories and of preset.json; by default under runs/.
        overwrite: start over where a directory holds trials.
        on_trial: by variant, called after each of its trials.
        on_begin: called once the directory is this run's.

    Raises:
        PushRecoveryError: unknown names, impossible values, a directory of another study, or one to which
            another run is writing.
    """
    each = check_variants(settings, policies)
    directory = directory or place_of(settings, list(each))
    with Writer(directory):
        on_begin()
        studies = {
            name: tune(own, trials, workers, directory / name, overwrite, (on_trial or {}).get(name))
            for name, own in each.items()
        }
        start = load_preset(settings.preset)
        tuned = {name: study.preset.variants[name] for name, study in studies.items()}
        own = {name: study.preset.found for name, study in studies.items()}
        about = {**whose(start), "trials": all_trials(start, own), **own}
        merged = replace(start, variants={**start.variants, **tuned}, found=about)
        found = VariantStudies(studies, merged, directory)
        found.preset.save(found.path)
    return found


def all_trials(start: PresetFile, own: Mapping[str, Mapping[str, Any]]) -> dict[str, int]:
    """Trials behind the settings of each variant: those that the start states, and those of its own study."""
    stated: Any = start.found.get("trials")
    before = stated if isinstance(stated, dict) else {}
    return {**before, **{name: before.get(name, 0) + found["trials"] for name, found in own.items()}}


def check_variants(settings: TuningSettings, policies: Sequence[str]) -> dict[str, TuningSettings]:
    """Settings of each variant's study; one that is impossible is refused before any of them begins."""
    if twice := [name for name in policies if policies.count(name) > 1]:
        raise InvalidValueError(f"variant {twice[0]!r} is given more than once")
    each = {name: replace(settings, policy=name) for name in policies}
    for own in each.values():
        check_can_begin(own)
    return each


def result_tables(found: VariantStudies) -> list[Table]:
    """Scores of each variant on both suites, and the fields that moved most."""
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


def summary(found: VariantStudies) -> dict[str, Any]:
    """The object of `--json`: how each variant's preset was found, and where they lie."""
    keys = ("by", "trials", "stopped_early", "episodes", "trial", "suites", "code", "tuning", "held_out")
    variants = {}
    for name, study in found.studies.items():
        about = {"env": study.settings.env_id, "policy": study.settings.policy}
        about |= {key: study.preset.found[key] for key in keys} | {"settings": study.best["settings"]}
        variants[name] = {**about, "preset": str(study.path), "out": str(study.directory)}
    return {"variants": variants, "preset": str(found.path), "out": str(found.directory)}


def score_cells(name: str, entry: dict[str, Any]) -> tuple[str, ...]:
    """One suite: scores, recovered of all, the paired difference of the rates."""
    low, high = entry["ci95"]
    parts = entry["start"], entry["best"]
    scores = [f"{part['score']:.3f} ({part['recovered']}/{entry['scenarios']})" for part in parts]
    difference = f"{entry['rate_difference']:+.3f} ({low:+.3f} to {high:+.3f})"
    return (name.replace("_", " "), *scores, difference, f"{entry['mcnemar_p']:.3g}")


def field_cells(study: Study, most: int = 12) -> list[tuple[str, ...]]:
    """The fields whose values moved most, in their own units."""
    start, best = study.start["settings"], study.best["settings"]
    moves = zip(study.space.dimensions, study.best["point"], strict=True)
    moved = sorted(moves, key=lambda pair: -abs(pair[1]))[:most]
    return [
        (d.label, f"{start[d.group][d.name]:g}", f"{best[d.group][d.name]:g}", f"{move:+.2f}")
        for d, move in moved
    ]
