"""The ceiling of a suite: every push that all policies lose is searched for an answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ..output.progress import progress_bars
from ..output.rows import RowFile
from ..output.work import Work, about, episode_seconds
from ..rollout.environments import make_env
from ..rollout.outcome import Score
from ..rollout.workers import parallel
from ..rollout.wrapped_action import action_rule
from ..score.evaluate import FORMAT as ROWS_FORMAT
from ..score.evaluate import SCORED, Evaluation, Rows, configuration, evaluate
from ..score.suites import Suite
from .moment import require_bipeds
from .neighbours import NEIGHBOURS
from .search import CEILING, Row, search_row
from .settings import CeilingSettings

FORMAT = 1  # of the rows
FOLDER = "ceiling"  # of the searches, in the directory of the evaluation
KEY = ("scenario_id",)
FIELDS = (*SCORED, "attempts", "period", "corrections", "neighbours")
OnRow = Callable[[Row], None]


@dataclass(frozen=True)
class Ceiling:
    """What policies and searches recover together."""

    evaluation: Evaluation  # of the policies
    settings: CeilingSettings
    searched: list[Row]  # the pushes that all policies lose, in the suite's order
    directory: Path  # of the searches

    @property
    def rows(self) -> Rows:
        """The policies' rows, and last those of the ceiling: for each push the best that is known."""
        return {**self.evaluation.rows, CEILING: best_rows(self.evaluation, self.searched)}

    @property
    def score(self) -> Score:
        """Of the ceiling, over the whole suite."""
        return Score.of(self.rows[CEILING])

    @property
    def answered(self) -> list[Row]:
        """Searches that found an answer."""
        return [row for row in self.searched if row["recovered"]]

    @property
    def robust(self) -> list[float]:
        """Share of the neighbouring pushes that each answer recovers, too."""
        return [row["neighbours"] / NEIGHBOURS for row in self.answered]

    def to_dict(self) -> dict[str, Any]:
        """The evaluation's object, with the ceiling among the policies and what was searched."""
        content = self.evaluation.to_dict()
        attempts = [row["attempts"] for row in self.searched]
        return {
            **content,
            "policies": {**content["policies"], CEILING: self.score.to_dict()},
            "search": {
                "searched": len(self.searched),
                "answered": len(self.answered),
                "attempts": sum(attempts),
                "budget": self.settings.budget,
                "neighbours": NEIGHBOURS,
                "neighbours_recovered": self.robust,
                "settings": self.settings.to_dict(),
                "out": str(self.directory),
            },
        }


def best_rows(evaluation: Evaluation, answers: list[Row]) -> list[Row]:
    """For each push the best of the policies' rows and its answer, if it has one."""
    found = {row["scenario_id"]: row for row in answers}
    rows = []
    for scenario, alike in evaluation.by_scenario():
        rows.append(_best([*alike, found[scenario.id]] if scenario.id in found else alike))
    return rows


def _best(rows: list[Row]) -> Row:
    """The first row that has recovered, otherwise the first that has survived, otherwise the last."""
    for field in ("recovered", "survived"):
        if kept := [row for row in rows if row[field]]:
            return kept[0]
    return rows[-1]


def ceiling(
    suite: Suite,
    env_id: str,
    policies: Any,
    settings: CeilingSettings,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
    on_row: OnRow | None = None,
) -> Ceiling:
    """Evaluate policies, and search each push that all of them lose; a run that was stopped goes on.

    Args:
        suite: scenarios.
        env_id: environment of bipeds under gait actions.
        policies: as those of `evaluate`; rows that the directory holds are kept.
        settings: of the searches.
        workers: processes; they change no row.
        directory: of the evaluation, by default its own under runs/; the searches lie in `ceiling` below it.
        overwrite: start over where the directory holds rows.
        on_row: called after each search is on disk.

    Raises:
        PushRecoveryError: as `evaluate`; another environment; searches of other settings in the directory.
    """
    _check_env(env_id)
    evaluation = evaluate(suite, env_id, policies, workers, directory, overwrite)
    config = {
        **configuration(suite, env_id),
        "rows": ROWS_FORMAT,
        "format": FORMAT,
        "ceiling": settings.to_dict(),
    }
    with RowFile(evaluation.directory / FOLDER, config, KEY, overwrite, FIELDS) as store:
        searched = _search_missing(evaluation, settings, store, workers, on_row)
    return Ceiling(evaluation, settings, searched, store.directory)


def _search_missing(
    evaluation: Evaluation, settings: CeilingSettings, store: RowFile, workers: int, on_row: OnRow | None
) -> list[Row]:
    """Rows of all pushes that are lost; those that the store lacks are searched for."""
    lost = [
        scenario for scenario, rows in evaluation.by_scenario() if not any(row["recovered"] for row in rows)
    ]
    jobs = [(settings, scenario) for scenario in lost if (scenario.id,) not in store.rows]
    most = settings.budget * episode_seconds(evaluation.env_id, (scenario for _, scenario in jobs), workers)
    pushes = "the push" if len(lost) == 1 else f"each of the {len(lost)} pushes"
    what = f"up to {settings.budget} attempts at {pushes} that all policies lose"
    done = [store.rows[scenario.id,] for scenario in lost if (scenario.id,) in store.rows]
    work = Work(what, about(most) + (" at most" if jobs else ""), store.directory)
    with progress_bars([CEILING], len(lost), work, {CEILING: len(done)}) as bars:
        for row in parallel(evaluation.env_id, search_row, jobs, workers):
            store.append(row)
            done.append(row)
            bars.set(CEILING, len(done), f"answered {sum(one['recovered'] for one in done)}")
            if on_row is not None:
                on_row(row)
    return [store.rows[scenario.id,] for scenario in lost]


def _check_env(env_id: str) -> None:
    """Raise InvalidValueError for robots that are not put back, or an action that is no gait."""
    env = make_env(env_id)
    try:
        rule = action_rule(env)
        if rule is None or rule.residual is not None or rule.hold != 1:
            raise InvalidValueError(f"a ceiling needs plain gait actions, and {env_id} has others")
        require_bipeds(getattr(env.unwrapped, "episodes", None))
    finally:
        env.close()
