"""A study: CMA-ES with successive halving over trials on disk, and the preset that comes of it.

A trial is one point of the space, run on the suite's scenarios and on disk when it is done. A search that
starts again with the same seed and is given the same scores makes the same proposals, so a study resumes by
giving it the scores of the finished trials (Hansen and Ostermeier 2001; package `cmaes`).

Trials meet the same scenarios in the same order, so that the difference of two trials on the first n of them
says more than either score: with d_i = value_i - best_i over those n,

    score ~ best + mean(d),        clearly worse: mean(d) + z s / sqrt(n) < 0,   s^2 = sample variance of d,

and a trial that is clearly worse than the best one is stopped early.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, MissingExtraError
from ...controllers.policies.two_stage import make_policy
from ...controllers.settings import PresetFile, load_preset
from ...controllers.validation import require_choice, require_integer
from ...envs.biped.core import SECTIONS, BipedSettings
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ...envs.scenario.scenario import one_of_each
from ..output.rows import RowFile, default_directory
from ..output.statistics import PairedCounts
from ..protocols.run import biped_of
from ..rollout.environments import code_digest, preset_digest, robot_of
from ..score.suites import Suite
from . import pushes
from .pushes import (
    BIPED,
    PENDULUM,
    RECOVERED,
    TUNING,
    VARIED,
    Scorer,
    check_env,
    own_episodes,
    preset_episodes,
)
from .space import OF_TRUNK, Space, planner_dimensions, robot_dimensions, select

SPACES = ("planner", "robot", "both")
FEWEST_SCENARIOS = 8
BIPED_PRESET = "biped"
SIGMA = 1.0  # first standard deviation, in the units of the dimensions
FEWEST_DIMENSIONS = 2  # the package's least number of dimensions
Z = 1.645  # one-sided 95 %: of trials as good as the best, one in twenty is stopped at each rung
RUNGS = (0.25, 0.5, 1.0)  # shares of the scenarios after which a trial is looked at
CANDIDATE = "candidate.json"  # the preset that is being run
START = 0  # number of the trial that is the start itself
KEY = ("suite", "trial")
FIELDS = ("score", "stopped", "scenarios", "settings", "point", "values")
FORMAT = 1
Row = dict[str, Any]
OnTrial = Callable[[Row, Row], None]


@dataclass(frozen=True)
class TuningSettings:
    """Settings of a study, besides its number of trials: fields, start, and pushes.

    Raises:
        UnknownNameError: an environment, a policy or a space that cannot be tuned.
        InvalidValueError: a space of another robot, or an impossible number.
    """

    env_id: str
    policy: str
    space: str = "planner"  # one of SPACES
    only: tuple[str, ...] = ()  # groups or fields of it; none: all of it
    preset: str = ""  # to start from, by name or file; the environment's own by default
    seed: int = 0
    suite: str = ""  # one of TUNING_SUITES; by default pushes of every kind where the robot takes them
    scenarios: int = 256  # of it
    held_out: int = 256  # of the one held out
    errors: ModelErrors = EXACT_MODEL  # of every second robot, see `tuning_suite`

    def __post_init__(self) -> None:
        object.__setattr__(self, "env_id", check_env(self.env_id))
        planner_dimensions(self.policy)  # knows the variants that can be tuned
        require_choice("space to tune", self.space, SPACES)
        if self.space != "planner" and self.env_id == PENDULUM:
            raise InvalidValueError(
                f"space {self.space!r} is that of robots; {PENDULUM} has the space 'planner' only"
            )
        require_integer("seed", self.seed)
        for name in ("scenarios", "held_out"):
            count, most = require_integer(name, getattr(self, name)), pushes.SUITE_SIZE
            if not FEWEST_SCENARIOS <= count <= most:
                raise InvalidValueError(f"{name} must be in [{FEWEST_SCENARIOS}, {most}], got {count}")
        if not self.preset:
            object.__setattr__(self, "preset", own_episodes(self.env_id).preset)
        if not self.suite:
            plain = self.env_id == PENDULUM or self.errors != EXACT_MODEL
            object.__setattr__(self, "suite", TUNING if plain else VARIED)
        require_choice("tuning suite", self.suite, list(pushes.TUNING_SUITES))
        if self.suite != TUNING and self.env_id == PENDULUM:
            raise InvalidValueError(
                f"suite {self.suite!r} is that of robots; {PENDULUM} takes {TUNING!r} only"
            )
        if self.suite in pushes.OF_EVERY_KIND and self.errors != EXACT_MODEL:
            raise InvalidValueError(
                f"every second robot of suite {self.suite!r} has the errors of the profile hardware already, "
                f"got {self.errors.to_dict()}: leave them out, or take suite {TUNING!r}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return {**asdict(self), "only": list(self.only), "errors": self.errors.to_dict()}


def space_of(settings: TuningSettings) -> Space:
    """The dimensions that a study searches, starting at its preset.

    Those of another robot than the biped have its bounds and units times as much as their start is of the
    biped's own value. What turns a trunk is left out where there is no waist.
    """
    planner, robot = settings.space != "robot", settings.space != "planner"
    dimensions = (planner_dimensions(settings.policy) if planner else ()) + (
        robot_dimensions(settings.policy) if robot else ()
    )
    start = _values(settings.preset, settings.policy)
    if settings.env_id not in (BIPED, PENDULUM):
        own, model = _values(BIPED_PRESET, settings.policy), own_episodes(settings.env_id).robot
        if not (model.trunk_pitch or model.trunk_roll):
            dimensions = tuple(d for d in dimensions if d.name not in OF_TRUNK)
        pairs = [(start[d.group][d.name], own[d.group][d.name]) for d in dimensions]
        ratios = [value / other if value * other > 0.0 else 1.0 for value, other in pairs]
        dimensions = tuple(d.times(ratio) for d, ratio in zip(dimensions, ratios, strict=True))
    return Space.at(select(dimensions, settings.only), start)


def _values(preset: str, policy: str) -> dict[str, Mapping[str, Any]]:
    """Group -> field -> value of a variant's own settings."""
    found = load_preset(preset)
    robot = BipedSettings().changed(found.robot(policy)).to_dict()
    return {"planner": asdict(found.config(policy)), **robot}


def preset_of(
    settings: TuningSettings,
    values: Mapping[str, Mapping[str, float]],
    found: Mapping[str, Any] | None = None,
) -> PresetFile:
    """The preset of a point: the study's start, with the point's values put in as the variant's own.

    The planner holds its plan when the gait machine commits the swing foot.
    """
    start = load_preset(settings.preset)
    own = {**start.variants.get(settings.policy, {}), **values.get("planner", {})}
    if "commit" in values.get("gait", {}):
        own["freeze"] = values["gait"]["commit"]
    if sections := {name: values[name] for name in SECTIONS if name in values}:
        robot = own.get("biped", {})
        own["biped"] = {**robot, **{name: {**robot.get(name, {}), **part} for name, part in sections.items()}}
    variants = {**start.variants, settings.policy: own}
    return replace(start, variants=variants, found={**whose(start), **(found or {})})


def whose(preset: PresetFile) -> dict[str, Any]:
    """Entries of `found` that a preset keeps from the one that it comes of: whose robot it is for."""
    return {} if preset.made_for is None else {"robot": preset.made_for}


class Search:
    """Proposes points of a space, generation by generation; the first one is drawn about the start."""

    def __init__(self, space: Space, seed: int):
        try:
            from cmaes import CMA
        except ImportError as error:
            raise MissingExtraError("cmaes", "tune") from error
        self.size = n = len(space.dimensions)
        if n < FEWEST_DIMENSIONS:
            raise InvalidValueError(f"a search needs at least {FEWEST_DIMENSIONS} fields, got {n}")
        word = int(np.random.SeedSequence(seed).generate_state(1)[0])
        self._cma = CMA(mean=np.zeros(n), sigma=SIGMA, bounds=space.bounds, seed=word)
        self._scored: list[tuple[NDArray[np.float64], float]] = []

    @property
    def population(self) -> int:
        """Proposals in a generation, 4 + floor(3 ln n)."""
        return int(self._cma.population_size)

    def ask(self) -> NDArray[np.float64]:
        """The next point, (n,)."""
        return np.asarray(self._cma.ask(), dtype=np.float64)

    def tell(self, point: NDArray[np.float64], score: float) -> None:
        """Give the score of the last point; a generation moves the search once all of it is scored."""
        self._scored.append((point, -score))  # the package minimises
        if len(self._scored) == self.population:
            self._cma.tell(self._scored)
            self._scored = []


def rungs(scenarios: int) -> list[int]:
    """Numbers of scenarios after which a trial is looked at; the last one is all of them."""
    return sorted({max(1, round(share * scenarios)) for share in RUNGS})


def estimate(values: Sequence[float], best: Sequence[float]) -> float:
    """Score of a trial from its first values; their mean where it has all, or where there is no best."""
    n = len(values)
    if n >= len(best):
        return float(np.mean(values))
    return float(np.mean(best) + np.mean(np.subtract(values, best[:n])))


def clearly_worse(values: Sequence[float], best: Sequence[float]) -> bool:
    """Whether the first values leave little hope of reaching the best trial."""
    n = len(values)
    if n >= len(best) or n < 2:
        return False
    difference = np.subtract(values, best[:n])
    return bool(difference.mean() + Z * difference.std(ddof=1) / math.sqrt(n) < 0.0)


def race(run: Callable[[int, int], list[float]], scenarios: int, best: Sequence[float]) -> list[float]:
    """Values of a trial, rung by rung, until it is clearly worse than the best one; without one, of all.

    `run` gives the values of the scenarios from its first number to before its second.
    """
    values: list[float] = []
    for end in rungs(scenarios) if len(best) else [scenarios]:
        values += run(len(values), end)
        if clearly_worse(values, best):
            break
    return values


def best_of(rows: Sequence[Row]) -> Row:
    """The row of the highest score among those that met every scenario; of equal ones the first."""
    return max((row for row in rows if not row["stopped"]), key=lambda row: row["score"])


@dataclass(frozen=True)
class Trials:
    """Runs points, or takes their rows out of the directory."""

    settings: TuningSettings
    space: Space  # whose points are run
    store: RowFile  # rows of the directory
    scorer: Scorer
    path: Path  # of the preset that is being run

    def run(self, number: int, point: NDArray[np.float64], suite: Suite, best: Row | None) -> Row:
        """The row of a point; stopped early where it is clearly worse than the best one so far."""
        key = (suite.name, number)
        if key in self.store.rows:
            row = self.store.rows[key]
            if row["settings"] != self.space.settings(row["point"]):
                raise InvalidValueError(
                    f"{str(self.store.path)!r} has trial {number} with other settings than those of its "
                    "point: choose another --out, or --overwrite to start over"
                )
            return row
        settings, paired = self.space.settings(point), best["values"] if best else ()
        preset_of(self.settings, settings).save(self.path)

        def run(first: int, end: int) -> list[float]:
            return self.scorer.values(self.path, suite.scenarios[first:end])

        values = race(run, len(suite.scenarios), paired)
        row = {
            "suite": suite.name, "trial": number, "score": estimate(values, paired),
            "stopped": len(values) < len(suite.scenarios), "scenarios": len(values), "settings": settings,
            "point": point.tolist(), "values": values,
        }  # fmt: skip
        self.store.append(row)
        return row


def comparison(start: Row, best: Row) -> dict[str, Any]:
    """Scores of start and best on the same scenarios, and how their recoveries differ."""
    recovered = [np.array(row["values"]) == RECOVERED for row in (best, start)]
    counts = PairedCounts.of(*recovered)
    return {
        "start": {"score": start["score"], "recovered": int(recovered[1].sum())},
        "best": {"score": best["score"], "recovered": int(recovered[0].sum())},
        "scenarios": counts.pairs,
        "only_best": counts.only_a,
        "only_start": counts.only_b,
        "mcnemar_p": counts.p_value,
        "rate_difference": counts.rate_difference,
        "ci95": list(counts.interval),
    }


def findings(
    config: Mapping[str, Any], population: int, rows: Sequence[Row], held_out: Mapping[int, Row]
) -> dict[str, Any]:
    """The section `found` of a preset file; `held_out` has the rows of start and best by trial."""
    best = best_of(rows)
    return {
        "by": f"CMA-ES (cmaes {version('cmaes')}), {population} trials a generation, successive halving",
        "trials": len(rows) - 1,
        "stopped_early": sum(row["stopped"] for row in rows),
        "episodes": sum(row["scenarios"] for row in [*rows, *held_out.values()]),
        "trial": best["trial"],
        "tuning": comparison(rows[START], best),
        "held_out": comparison(held_out[START], held_out[best["trial"]]),
        **{name: config[name] for name in ("tune", "suites", "code", "space")},
    }


@dataclass(frozen=True)
class Study:
    """Result of a study."""

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


def check_can_begin(settings: TuningSettings) -> None:
    """Raise PushRecoveryError where a search is impossible: its fields, its robot, or one of its pushes."""
    space_of(settings)
    episodes = preset_episodes(settings.env_id, 1, settings.preset, settings.policy)
    make_policy(settings.policy, episodes.robot, episodes.limits, settings.preset)
    for scenario in one_of_each(one for suite in suites_of(settings) for one in suite.scenarios):
        episodes.begin(0, scenario)


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
    check_can_begin(settings)
    space = space_of(settings)
    suite, held_out = suites_of(settings)
    config = configuration(settings, space, (suite, held_out))
    directory = directory or default_directory(f"tune-{settings.policy}", config)
    search = Search(space, settings.seed)
    with RowFile(directory, config, KEY, overwrite, FIELDS) as store:
        path = directory / CANDIDATE
        with Scorer(settings.env_id, settings.policy, workers) as scorer:
            runs = Trials(settings, space, store, scorer, path)
            try:
                rows = _search(search, runs, suite, trials, on_trial)
                best = best_of(rows)
                numbers = dict.fromkeys((START, best["trial"]))
                points = {number: np.array(rows[number]["point"]) for number in numbers}
                checked = {number: runs.run(number, points[number], held_out, None) for number in numbers}
            finally:
                path.unlink(missing_ok=True)
        found = findings(config, search.population, rows, checked)
        preset = preset_of(settings, best["settings"], found)
        study = Study(settings, space, rows, preset, directory)
        preset.save(study.path)
    return study


def suites_of(settings: TuningSettings) -> tuple[Suite, Suite]:
    """What a search meets, and what is held out for its start and best, for the robot of the settings."""
    names = settings.suite, pushes.held_out_of(settings.suite)
    sizes = zip(names, (settings.scenarios, settings.held_out), strict=True)
    if settings.suite == pushes.PUNCHES:
        robot = biped_of(settings.env_id)
        first, second = (pushes.punched_suite(*size, robot, settings.errors) for size in sizes)
    else:
        named = robot_of(settings.env_id)
        first, second = (pushes.tuning_suite(*size, settings.errors, named) for size in sizes)
    return first, second


def _search(search: Search, runs: Trials, suite: Suite, trials: int, on_trial: OnTrial | None) -> list[Row]:
    """The start, then what the search proposes; rows in order."""
    rows = [runs.run(START, np.zeros(search.size), suite, None)]
    best = rows[START]
    for number in range(1, trials + 1):
        point = search.ask()
        row = runs.run(number, point, suite, best)
        search.tell(np.array(row["point"]), row["score"])  # another machine may round proposals otherwise
        rows.append(row)
        best = best_of([best, row])
        if on_trial is not None:
            on_trial(row, best)
    return rows


def configuration(settings: TuningSettings, space: Space, suites: tuple[Suite, ...]) -> dict[str, Any]:
    """Key of a directory's trials; more trials of the same study go on in it."""
    start = {**load_preset(settings.preset).to_dict(), "found": {}}
    return {
        "format": FORMAT, "tune": settings.to_dict(), "start": start, "space": space.to_dict(),
        "suites": [suite.summary() for suite in suites], "code": code_digest(),
        **preset_digest(settings.env_id),
    }  # fmt: skip
