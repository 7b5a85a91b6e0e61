"""A study: a search of so many trials, and the preset that comes of it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...controllers.settings.presets import PresetFile, load_preset
from ..output.rows import RowFile, default_directory
from ..protocols.watched import biped_of
from ..rollout.environments import code_digest, preset_digest, robot_of
from ..score.suites import Suite
from ..score.tuning_pushes import PUNCHES, held_out_of, punched_suite, tuning_suite
from .candidate import preset_of, space_of
from .findings import findings
from .scorer import Scorer
from .search import Search
from .settings import TuningSettings
from .space import Space
from .trials import FIELDS, KEY, START, Row, Trials, best_of

FORMAT = 1
OnTrial = Callable[[Row, Row], None]


@dataclass(frozen=True)
class Study:
    """What a study has found."""

    settings: TuningSettings
    space: Space
    trials: list[Row]  # in order; the first is the start
    preset: PresetFile  # of the best trial; its `found` says how
    directory: Path

    @property
    def start(self) -> Row:
        """The trial of the preset it started from."""
        return self.trials[START]

    @property
    def best(self) -> Row:
        """The best of the trials that met every scenario."""
        return best_of(self.trials)

    @property
    def path(self) -> Path:
        """The preset file."""
        return self.directory / "preset.json"


def tune(
    settings: TuningSettings,
    trials: int,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
    on_trial: OnTrial | None = None,
) -> Study:
    """Search with `trials` trials besides the start; those present in the directory are not run again.

    Args:
        settings: what is tuned on what.
        trials: the budget.
        workers: processes; they change no result.
        directory: where outcomes.jsonl, config.json and preset.json go; by default under runs/.
        overwrite: start over where the directory holds trials.
        on_trial: called after each trial with its row and the best one so far.

    Raises:
        PushRecoveryError: unknown names, impossible values, a directory of another study, or one to which
            another run is writing.
    """
    space = space_of(settings)
    suite = _suite(settings, settings.suite, settings.scenarios)
    held_out = _suite(settings, held_out_of(settings.suite), settings.held_out)
    config = configuration(settings, space, (suite, held_out))
    directory = directory or default_directory(f"tune-{settings.policy}", config)
    search = Search(space, settings.seed)
    with RowFile(directory, config, KEY, overwrite, FIELDS) as store:
        with (
            Scorer(settings.env_id, settings.policy, workers) as scorer,
            closing(Trials(settings, space, store, scorer, directory)) as runs,
        ):
            rows = _search(search, runs, suite, trials, on_trial)
            best = best_of(rows)
            checked = _on_held_out(runs, held_out, [rows[START], best])
        found = findings(config, search.population, rows, checked)
        preset = preset_of(settings, best["settings"], found)
        study = Study(settings, space, rows, preset, directory)
        preset.save(study.path)
    return study


def _suite(settings: TuningSettings, name: str, scenarios: int) -> Suite:
    """The first scenarios of a suite, for the robot of the settings."""
    if settings.suite == PUNCHES:
        return punched_suite(name, scenarios, biped_of(settings.env_id), settings.errors)
    return tuning_suite(name, scenarios, settings.errors, robot_of(settings.env_id))


def _search(search: Search, runs: Trials, suite: Suite, trials: int, on_trial: OnTrial | None) -> list[Row]:
    """The start, then what the search proposes; rows in order."""
    rows = [runs.run(START, np.zeros(search.size), suite, None)]
    best = rows[START]
    for number in range(1, trials + 1):
        point = search.ask()
        row = runs.run(number, point, suite, best)
        search.tell(point, row["score"])
        rows.append(row)
        best = best_of([best, row])
        if on_trial is not None:
            on_trial(row, best)
    return rows


def _on_held_out(runs: Trials, held_out: Suite, rows: list[Row]) -> dict[int, Row]:
    """The trials of rows on pushes that the search has not seen, by number."""
    points = {row["trial"]: np.array(row["point"]) for row in rows}
    return {number: runs.run(number, point, held_out, None) for number, point in points.items()}


def configuration(settings: TuningSettings, space: Space, suites: tuple[Suite, ...]) -> dict[str, Any]:
    """What the trials of a directory belong to; more trials of the same study go on in it."""
    start = {**load_preset(settings.preset).to_dict(), "found": {}}
    return {
        "format": FORMAT, "tune": settings.to_dict(), "start": start, "space": space.to_dict(),
        "suites": [suite.summary() for suite in suites], "code": code_digest(),
        **preset_digest(settings.env_id),
    }  # fmt: skip
