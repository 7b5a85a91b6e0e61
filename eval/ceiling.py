"""Hindsight search over a suite: answers to every push that all policies lose, kept, replayed and reported.

What policies and searches recover together is the row `ceiling`: a lower bound on what is possible.
"""

import json
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..controllers import files, validation
from ..controllers.errors import InvalidValueError
from . import hindsight
from .hindsight import CEILING, NEIGHBOURS, CeilingSettings, Row, Sequence, SequencePolicy
from .output.progress import Work, about, episode_seconds, progress_bars
from .output.rows import RowFile, read_json
from .output.statistics import PairedCounts
from .output.tables import Table, markdown_page, write_reports
from .rollout import DEFAULT_ENV, environments, episodes
from .rollout.outcome import Score
from .rollout.workers import parallel
from .score.evaluate import SCORED, Evaluation, Rows, configuration, evaluate
from .score.report import rates_table
from .score.suites import Suite
from .search import SequenceRule

FORMAT = 1  # of the rows
FOLDER = "ceiling"  # of the searches, in the directory of the evaluation
KEY = ("scenario_id",)
FIELDS = (*SCORED, "attempts", "period", "corrections", "neighbours")


@dataclass(frozen=True)
class Ceiling:
    """Rows of policies and of hindsight searches over one suite."""

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
        """Score of the ceiling, over the whole suite."""
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
                "settings": asdict(self.settings),
                "out": str(self.directory),
            },
        }


def best_rows(evaluation: Evaluation, answers: list[Row]) -> list[Row]:
    """For each push the best of the policies' rows and its answer, if it has one."""
    found = {row["scenario_id"]: [row] for row in answers}
    return [_best([*rows, *found.get(scenario.id, ())]) for scenario, rows in evaluation.by_scenario()]


def _best(rows: list[Row]) -> Row:
    """The first row that has recovered, otherwise the first that has survived, otherwise the last."""
    ranked = (row for field in ("recovered", "survived") for row in rows if row[field])
    return next(ranked, rows[-1])


def ceiling(
    suite: Suite,
    env_id: str,
    policies: Any,
    settings: CeilingSettings,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
) -> Ceiling:
    """Evaluate policies, and search each push that all of them lose; a run that was stopped goes on.

    The environment has bipeds under plain gait actions. The directory is that of the evaluation; the searches
    lie in `ceiling` below it.

    Raises:
        PushRecoveryError: as `evaluate`; another environment; searches of other settings in the directory.
    """
    _check_env(env_id)
    evaluation = evaluate(suite, env_id, policies, workers, directory, overwrite)
    lost = [one for one, rows in evaluation.by_scenario() if not any(row["recovered"] for row in rows)]
    config = configuration(suite, env_id)
    config |= {"rows": config["format"], "format": FORMAT, "ceiling": asdict(settings)}
    with RowFile(evaluation.directory / FOLDER, config, KEY, overwrite, FIELDS) as store:
        missing = [scenario for scenario in lost if (scenario.id,) not in store.rows]
        most = settings.budget * episode_seconds(env_id, missing, workers)
        pushes = "the push" if len(lost) == 1 else f"each of the {len(lost)} pushes"
        what = f"up to {settings.budget} attempts at {pushes} that all policies lose"
        work = Work(what, about(most) + (" at most" if missing else ""), store.directory)
        done = [store.rows[scenario.id,] for scenario in lost if (scenario.id,) in store.rows]
        with progress_bars([CEILING], len(lost), work, {CEILING: len(done)}) as bars:
            jobs = [(settings, scenario) for scenario in missing]
            for row in parallel(env_id, hindsight.search_row, jobs, workers):
                store.append(row)
                done.append(row)
                bars.set(CEILING, len(done), f"answered {sum(one['recovered'] for one in done)}")
    searched = [store.rows[scenario.id,] for scenario in lost]
    return Ceiling(evaluation, settings, searched, store.directory)


def _check_env(env_id: str) -> None:
    """Raise InvalidValueError for robots that are not put back, or an action that is no gait."""
    with closing(environments.make_env(env_id)) as env:
        rule = episodes.action_rule(env)
        if rule is None or rule.residual is not None or rule.hold != 1:
            raise InvalidValueError(f"a ceiling needs plain gait actions, and {env_id} has others")
        hindsight.require_bipeds(getattr(env.unwrapped, "episodes", None))


FILE = "answers.json"


@dataclass(frozen=True)
class Answers:
    """Sequences by scenario id, for the pushes of one suite."""

    suite: Mapping[str, Any]  # its summary
    settings: CeilingSettings  # of the searches
    sequences: Mapping[str, Sequence]

    @classmethod
    def of(cls, found: Ceiling) -> Self:
        """Answers that searches have found."""
        return cls(found.evaluation.suite.summary(), found.settings, _sequences(found.answered))

    def policy(self, env: Any) -> SequencePolicy:
        """A policy for the robot of an environment that replays them; where there is none, the planner."""
        rule = SequenceRule.of(env, self.settings.policy, self.settings.scale)
        return SequencePolicy(rule, self.sequences)

    def save(self, path: Path) -> None:
        """Write them as JSON, an answer a line, whole or not at all."""
        head = {"format": FORMAT, "suite": dict(self.suite), "settings": asdict(self.settings)}
        entries = {name: [one.period, one.corrections] for name, one in self.sequences.items()}
        body = ",\n".join(f"{json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items())
        files.write_text(path, f'{json.dumps(head)[:-1]}, "answers": {{\n{body}\n}}}}\n')

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read them from a file.

        Raises:
            InvalidValueError: it cannot be read, or holds no answers of this format.
        """
        what = f"file of answers {str(path)!r}"
        data = validation.require_keys(
            what, read_json(path, "file of answers"), {"format", "suite", "settings", "answers"}, set()
        )
        if data["format"] != FORMAT:
            raise InvalidValueError(f"{what} has format {data['format']!r}, and {FORMAT} is read")
        try:
            sequences = {name: Sequence(*entry) for name, entry in data["answers"].items()}
        except (AttributeError, TypeError, ValueError) as error:
            raise InvalidValueError(f"{what}: {error}") from error
        suite = validation.require_keys(
            f"suite of {what}", data["suite"], {"name", "version", "sha256", "scenarios"}, set()
        )
        return cls(suite, _settings(data["settings"]), sequences)

    @classmethod
    def of_searches(cls, directory: Path) -> Self:
        """The best attempt at each push in the rows of a directory, whether it has recovered or not.

        Raises:
            InvalidValueError: the directory holds no searches of this format.
        """
        path = directory / "config.json"
        config = read_json(path) if path.exists() else {}
        known = config if isinstance(config, dict) else {}
        if "ceiling" not in known or known.get("format") != FORMAT:
            raise InvalidValueError(
                f"{str(directory)!r} holds no searches of format {FORMAT}, see config.json"
            )
        rows = RowFile(directory, known, KEY, fields=FIELDS).rows.values()
        tried = [row for row in rows if row["corrections"] is not None]
        return cls(known["suite"], _settings(known["ceiling"]), _sequences(tried))


def load_answers(path: str | Path, env: Any) -> SequencePolicy:
    """The answers of a file or of a directory of searches, replayed by scenario id.

    As a policy of the ordinary rollout and of `evaluate({"ceiling": load_answers(PATH, env)})` it gives the
    outcomes of the searches where code and robot are the same. On a push without a sequence it is the
    planner.

    Args:
        path: `answers.json`, or the directory that it lies in.
        env: environment that it is to act in.

    Raises:
        InvalidValueError: there are no answers of this format.
    """
    place = Path(path)
    return (Answers.of_searches(place) if place.is_dir() else Answers.load(place)).policy(env)


def _sequences(rows: Iterable[Row]) -> dict[str, Sequence]:
    return {row["scenario_id"]: Sequence(row["period"], row["corrections"]) for row in rows}


def _settings(data: object) -> CeilingSettings:
    names = {field.name for field in fields(CeilingSettings)}
    return CeilingSettings(**validation.require_keys("settings of a ceiling", data, names, set()))


NOTE = (
    f"`{CEILING}`: pushes that a policy recovers from, or for which a search with hindsight found an answer: "
    "a lower bound on what is possible with these actions."
)


def ceiling_table(found: Ceiling) -> Table:
    """Rates of each policy and of the ceiling."""
    table = rates_table(replace(found.evaluation, rows=found.rows))
    return replace(table, note=f"{table.note} {NOTE}")


def shares_table(found: Ceiling) -> Table:
    """How near each policy comes to the ceiling."""
    rows, most = found.rows, found.score.recovered
    cells = []
    for name in found.evaluation.rows:
        pairs = PairedCounts.of_rows(rows[CEILING], rows[name])
        recovered = pairs.both + pairs.only_b
        share = f"{recovered / most:.3f}" if most else "-"
        cells.append((name, str(recovered), share, str(pairs.only_a), f"{pairs.p_value:.2g}"))
    columns = ("policy", "recovered", "share of the ceiling", "below it", "p")
    return Table("Policies below it", columns, cells, "p: exact McNemar.")


def search_lines(found: Ceiling) -> str:
    """Sentences on the searches: their number, their cost, and how fragile the answers are."""
    s, searched, answered = found.settings, len(found.searched), len(found.answered)
    attempts = [row["attempts"] for row in found.answered]
    pushes = "push" if searched == 1 else "pushes"
    lines = (
        f"{searched} {pushes} lost by all policies, {answered} of them answered. Each search: at most "
        f"{s.budget} attempts ({s.generations} generations of {s.population}) at {s.size} numbers, "
        f"{s.steps} steps of {s.policy} corrected by up to {s.scale:g} times the residual's scale; "
        f"seed {s.seed}."
    )
    if not answered:
        return lines + "\n"
    robust = np.array(found.robust)
    return (
        f"{lines} Median {np.median(attempts):.0f} attempts for an answer. The same sequence also recovers "
        f"{robust.mean():.0%} of the {NEIGHBOURS} pushes within {max(hindsight.FORCES):.0%} of the force and "
        f"{max(hindsight.TURNS):g} degrees of the direction, in the mean of the answers, "
        f"{np.median(robust):.0%} in the median; {(robust >= 0.5).sum()} of {answered} answers recover half "
        "of them or more.\n"
    )


def write_ceiling_reports(found: Ceiling) -> Path:
    """Write report.json, report.md and answers.json beside the searches; returns the path of the report."""
    Answers.of(found).save(found.directory / FILE)
    tables = markdown_page("Ceiling", [ceiling_table(found), shares_table(found)])
    return write_reports(found.directory, found.to_dict(), f"{tables}\n## Searches\n\n{search_lines(found)}")


REPLAYED = "ceiling-replayed"  # folder of the rows, below the directory of the evaluation
STORED = Path(__file__).parent / "answers"


def stored_answers(suite: Suite) -> Answers | None:
    """Stored answers for a suite; None where there are none to just these pushes."""
    path = STORED / f"{suite.name}.json"
    if not path.is_file():
        return None
    answers = Answers.load(path)
    return answers if answers.suite["sha256"] == suite.sha256 else None


def answered(suite: Suite, env_id: str) -> tuple[Suite, SequencePolicy] | None:
    """The pushes of a suite that have a stored answer, and what replays it; None where there are none."""
    answers = stored_answers(suite) if env_id == DEFAULT_ENV else None
    if answers is None:
        return None
    pushes = tuple(one for one in suite.scenarios if one.id in answers.sequences)
    if not pushes:
        return None
    with closing(environments.make_env(env_id)) as env:
        return Suite(f"{suite.name}-answered", suite.version, pushes), answers.policy(env)


def with_ceiling(evaluation: Evaluation, workers: int = 1, overwrite: bool = False) -> Evaluation:
    """The evaluation with the ceiling among its policies, where answers to its suite are stored.

    They are replayed on today's robot, so that only what they recover on it counts.
    """
    if CEILING in evaluation.rows or (found := answered(evaluation.suite, evaluation.env_id)) is None:
        return evaluation
    suite, policy = found
    replayed = evaluate(
        suite, evaluation.env_id, {CEILING: policy}, workers, evaluation.directory / REPLAYED, overwrite
    )
    rows = best_rows(evaluation, replayed.rows[CEILING])
    return replace(evaluation, rows={**evaluation.rows, CEILING: rows})
