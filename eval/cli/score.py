"""Commands that score: `evaluate`, `compare`, `frontier`, `basin`, `sensitivity`, `ceiling` and others."""

import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from ...controllers.errors import InvalidValueError, shown
from ..output.tables import named_apart, stem_or_hash
from ..rollout import TABLE_VARIANTS
from . import options
from .options import Count, CountOrNone, EnvOptions, Policies, Real, RunningOptions, SuiteName, within

DEFAULT_TEXT = f"{options.SUITES_TEXT} By default quick, and on the pendulum, which does not turn, quick-1."
SEVERAL_TEXT = f"{DEFAULT_TEXT} Each of several suites has results of its own, and one table shows them all."
PROFILES_TEXT = f"{options.PROFILE_TEXT} Several profiles are shown side by side."


@dataclass(frozen=True, kw_only=True)
class SuiteOptions(options.EnvOptions, options.ErrorOptions, options.TrustOption, options.RunningOptions):
    """Options of a command that runs policies on a suite."""

    suite: tuple[str, ...] | str | None = None  # as a command takes it: one or several
    sample: CountOrNone = field(default=None, metadata=within(1))
    """Number of pushes, evenly spread over the suite (by default all of them)."""
    film: Annotated[Literal["discordant"] | None, arg(metavar="discordant", help_behavior_hint="")] = None
    """Film the pushes that one policy recovers from and another does not, side by side, as GIF
    and mp4."""
    films: Count = field(default=4, metadata=options.within(1))
    """Largest number of pushes that are filmed."""

    def check_film(self) -> None:
        """Raise MissingExtraError before any work where films are asked for and can't be written."""
        if self.film is not None:
            from ..record.film import require_imageio

            require_imageio()

    def make_films(self, evaluation: Any, policies: Sequence[Any]) -> None:
        """Write the films asked for, and say where they are."""
        if self.film is not None:
            from ..record.film import FOLDER, film_discordant

            paths = film_discordant(evaluation, self.films, policies)
            if paths and not self.json:
                print(f"films: {evaluation.directory / FOLDER}")

    def write_page(
        self, command: str, found: Mapping[str, Any], directory: Path, positional: Sequence[str] = ()
    ) -> list[str]:
        """Write the page of evaluations by profile, and say where it is."""
        from ..report import evaluation, page

        typed = page.command_of(command, self, positional)
        return options.page_lines(lambda: evaluation.with_pictures(found, typed, directory))


@dataclass(frozen=True, kw_only=True)
class Evaluate(SuiteOptions):
    """Score policies on suites."""

    suite: Annotated[
        tuple[str, ...] | None, arg(metavar="NAME|FILE", help=SEVERAL_TEXT, help_behavior_hint="")
    ] = None
    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE")] = TABLE_VARIANTS
    """Policies to score: names (see list), policy files, or MODULE:ATTRIBUTE. By default the
    planner and its variants are scored; baselines and learned policies have to be named."""
    profile: Annotated[tuple[str, ...], arg(metavar="NAME", help=PROFILES_TEXT)] = ("exact",)

    def __post_init__(self) -> None:
        super().__post_init__()
        for option, values in {"--profile": self.profile, "--suite": self.suite or ()}.items():
            if len(set(values)) < len(values):
                raise InvalidValueError(f"{option} must name each one once, got {' '.join(values)}")

    def run(self) -> None:
        """Evaluate on each suite under each profile, print one table or object, write the reports.

        Each suite has a directory of its own below DIR where there are several, and so has each profile.
        """
        from ..rollout.policy_source import policy_sources
        from ..rollout.workers import Runner
        from ..score import report

        self.check_film()
        suites = {  # unknown ones fail here
            name: {one: options.pushes_of(self, name, one, self.sample) for one in self.profile}
            for name in self.suite or (None,)
        }
        every = [suite for by_profile in suites.values() for suite in by_profile.values()]
        names, policies = [suite.name for suite in every], self.trusted(self.policies)
        if twice := [name for name in names if names.count(name) > 1]:
            raise InvalidValueError(f"two suites of --suite are called {twice[0]!r}")
        if len(every) > 1:  # so that nothing is scored in vain
            with closing(Runner(self.env_id, policy_sources(policies))) as runner:
                runner.check_can_begin(one for suite in every for one in suite.scenarios)
        evaluations, objects, tables, lines, several = [], {}, [], [], len(suites) > 1
        for name, by_profile in suites.items():
            one, place, label = self, self.directory, next(iter(by_profile.values())).name
            if several:
                one, place = replace(self, suite=(name,)), place and place / label
            found, objects[label], table, more = one.scored(by_profile, policies, place)
            evaluations += found.values()
            tables.append(table)
            lines += more
        if several:
            tables = [report.beside_table({one.suite.name: one for one in evaluations})]
        self.show({"suites": objects} if several else next(iter(objects.values())), tables, lines)
        for one in evaluations:
            self.make_films(one, policies)

    def scored(
        self, suites: Mapping[str, Any], policies: Sequence[Any], place: Path | None
    ) -> tuple[dict[str, Any], dict[str, Any], Any, list[str]]:
        """Evaluations by profile of one suite, their object, their table, and where their reports are."""
        from ..ceiling import with_ceiling
        from ..score import evaluate, report

        found, objects, lines, table, several = {}, {}, [], None, len(suites) > 1
        for name, suite in suites.items():
            own = place / name if several and place else place
            one = evaluate.evaluate(suite, self.env_id, policies, self.processes, own, self.overwrite)
            reported = with_ceiling(one, self.processes, self.overwrite)
            lines.append(f"report: {report.write_evaluation_reports(one, reported)}")
            more = [policy for policy in reported.rows if policy not in one.rows]  # a stored ceiling
            objects[name] = one.to_dict() | {policy: reported.score(policy).to_dict() for policy in more}
            found[name], table = one, report.rates_table(reported)
        directory = place or next(iter(found.values())).directory
        if several:
            table = report.beside_table(found)
            lines.insert(0, f"profiles: {report.write_profiles(found, directory)}")
        lines += self.write_page("evaluate", found, directory)
        content = {"profiles": objects} if several else next(iter(objects.values()))
        return found, content, table, lines


@dataclass(frozen=True, kw_only=True)
class Compare(SuiteOptions, options.RobotOptions):
    """Compare two policies on the same pushes."""

    a: Annotated[Positional[str], arg(metavar="A")]
    """First policy: name (see list), file, or MODULE:ATTRIBUTE."""
    b: Annotated[Positional[str], arg(metavar="B")]
    """Second policy, in the same form."""
    suite: Annotated[str | None, arg(metavar="NAME|FILE", help=DEFAULT_TEXT, help_behavior_hint="")] = None

    def run(self) -> None:
        """Compare two policies, print the table or the object."""
        from ..score import evaluate, report

        self.check_film()
        suite = options.pushes_of(self, self.suite, self.profile, self.sample)
        a, b = self.trusted((self.a, self.b))
        found = evaluate.compare(a, b, suite, self.env_id, self.processes, self.directory, self.overwrite)
        page = self.write_page("compare", {self.profile: found.evaluation}, found.directory, ("a", "b"))
        outcomes = f"outcomes: {found.directory / 'outcomes.jsonl'}"
        self.show(found.to_dict(), [report.comparison_table(found)], [outcomes, *page])
        self.make_films(found.evaluation, (a, b))


@dataclass(frozen=True, kw_only=True)
class Frontier(EnvOptions, options.PushOptions, options.TrustOption, RunningOptions):
    """Find the largest push that is recovered from, by direction."""

    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE", aliases=("--policy",))] = ("two-stage",)
    """Policies in one picture: names (see list), policy files, or MODULE:ATTRIBUTE."""
    directions: Count = field(default=16, metadata=within(1, 3600))
    """Number of directions, evenly spread, counter-clockwise from forward."""
    grid: options.RealOrNone = field(default=None, metadata=within(1, 1000))
    """Least step between the forces that are tried [N] (by default 40 for 60 kg and as much less for less;
    with one replica 10 on the pendulum and 20 elsewhere)."""

    def run(self) -> None:
        """Write picture and frontier.json, print the table or the object."""
        from ...controllers.files import write_text
        from ..report import frontier as report
        from ..report import page
        from ..score import frontier as scan

        settings = self.scanned(self.env_id, grid=self.grid or scan.default_grid(self.env_id, self.replicas))
        policies = self.trusted(self.policies)
        found = scan.frontier(
            settings, policies, self.directions, self.processes, self.directory, self.overwrite
        )
        objects = {name: found.to_dict(name) for name in found.rows}
        content = next(iter(objects.values())) if len(objects) == 1 else {"policies": objects}
        own = f"frontier{named_apart(found.directory, found.rows, report.question(found))}.json"
        write_text(found.directory / own, json.dumps(content, indent=1) + "\n")
        lines = [
            f"report: {report.write_frontier_reports(found)}",
            "pictures: " + ", ".join(map(str, report.save_pictures(found))),
            *options.page_lines(lambda: report.write_frontier_page(found, page.command_of("frontier", self))),
        ]
        tables = filter(None, [report.frontier_table(found), report.replicas_table(found)])
        self.show(content, tables, lines)


@dataclass(frozen=True, kw_only=True)
class Basin(EnvOptions, RunningOptions):
    """Map the N-step capture basin, measured and by theory."""

    policies: Policies = ("two-stage",)
    points: Count = field(default=21, metadata=within(2, 400))
    """Number of points along each axis of the grid of DCMs."""

    def run(self) -> None:
        """Run the kicks, print the table or the object, write reports and pictures."""
        from ..score import basin

        found = basin.basin(
            self.env_id, self.policies, self.points, self.processes, self.directory, self.overwrite
        )
        pictures = ", ".join(map(str, basin.save_basin(found)))
        lines = [f"report: {basin.write_basin_reports(found)}", f"pictures: {pictures}"]
        self.show(found.to_dict(), [basin.basin_table(found)], lines)


@dataclass(frozen=True, kw_only=True)
class Sensitivity(EnvOptions, RunningOptions):
    """Measure what outcomes depend on."""

    suite: SuiteName = "hard"
    sample: Count = field(default=128, metadata=within(1))
    """Number of pushes, evenly spread over the suite."""
    policies: Policies = ("two-stage",)
    variations: Annotated[tuple[str, ...] | None, arg(metavar="NAME", help_behavior_hint="")] = None
    """Variations to run, such as step-1ms elliptic joint-friction-1 hardware (docs/generated/sensitivity.md;
    by default all of them)."""

    def run(self) -> None:
        """Run the variations, print a table for each policy or the object, write the reports."""
        from ..score import sensitivity as study
        from ..score.suites import get_suite

        found = study.sensitivity(
            get_suite(self.suite, self.env_id), self.sample, self.env_id, self.policies,
            tuple(study.VARIATIONS) if self.variations is None else self.variations,
            self.processes, self.directory, self.overwrite,
        )  # fmt: skip
        report = f"report: {study.write_sensitivity_reports(found)}"
        self.show(found.to_dict(), study.sensitivity_tables(found), [report])


@dataclass(frozen=True, kw_only=True)
class CeilingCommand(EnvOptions, options.RobotOptions, RunningOptions):
    """Search what is possible at least; the settings are those of `CeilingSettings`."""

    suite: SuiteName = "hard"
    sample: CountOrNone = field(default=None, metadata=within(1))
    """Number of pushes, evenly spread over the suite (by default all of them)."""
    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE")] = TABLE_VARIANTS
    """Policies whose lost pushes are searched: names (see list), policy files, or MODULE:ATTRIBUTE."""
    planner: Annotated[str, arg(metavar="NAME")] = "two-stage"
    """The planner whose actions are corrected."""
    steps: Count = field(default=4, metadata=within(1, 100))
    """Number of steps that have a correction of their own, counted from the step in which the push comes."""
    population: Count = field(default=64, metadata=within(2, 10_000))
    """Number of attempts in a generation."""
    generations: Count = field(default=20, metadata=within(1, 100_000))
    """Largest number of generations; times the population it is the budget of a push."""
    elites: Count = field(default=8, metadata=within(1, 10_000))
    """Number of best attempts from which the next generation is drawn."""
    spread: Real = field(default=0.8, metadata=within(0.01, 10))
    """Standard deviation of the first generation, as a share of the largest correction."""
    scale: Real = field(default=1.0, metadata=within(0.01, 10))
    """Largest correction, as a multiple of the one of BipedResidual-v0."""
    seed: Count = field(default=0, metadata=within(0))
    """Seed of the searches."""

    def run(self) -> None:
        """Evaluate, search, print the table or the object, write the reports."""
        from .. import ceiling, hindsight

        settings = hindsight.CeilingSettings(
            policy=self.planner, steps=self.steps, population=self.population, elites=self.elites,
            generations=self.generations, spread=self.spread, scale=self.scale, seed=self.seed,
        )  # fmt: skip
        suite = options.pushes_of(self, self.suite, self.profile, self.sample)
        found = ceiling.ceiling(
            suite, self.env_id, self.policies, settings, self.processes, self.directory, self.overwrite
        )
        lines = [ceiling.search_lines(found).rstrip(), f"report: {ceiling.write_ceiling_reports(found)}"]
        self.show(found.to_dict(), [ceiling.ceiling_table(found)], lines)


FOLDER = Path("runs/corrections")
ALONE = 2.0  # what a robot costs alone, of its cost among others


@dataclass(frozen=True, kw_only=True)
class Corrections(EnvOptions, options.RobotOptions):
    """Show what a residual adds to the planner, by the direction of the push and by step."""

    policy: Annotated[Positional[str], arg(metavar="NAME|FILE")]
    """Name or file of a residual on gait actions, such as residual."""
    suite: SuiteName = "hard"
    sample: Count = field(default=256, metadata=within(1))
    """Number of pushes, evenly spread over the suite; each runs with the residual and without it."""
    out: options.Directory = None
    """Directory for corrections-POLICY.md and its figure (default: runs/corrections)."""

    def run(self) -> None:
        """Run the pushes, print the tables, write corrections-POLICY.md and its figure."""
        from ...controllers.files import write_text
        from ..output.progress import Work, about, episode_seconds, progress_bars
        from ..output.rows import require_place
        from ..record import corrections
        from ..rollout.policy_source import acting_in

        suite = options.pushes_of(self, self.suite, self.profile, self.sample)
        directory, found = FOLDER if self.out is None else Path(self.out), []
        require_place(directory / f"corrections-{stem_or_hash([self.policy], self.policy)}.md")
        what = f"{self.sample} pushes of {suite.name}, each with {self.policy} and without"
        length = about(ALONE * 2.0 * episode_seconds(self.env_id, suite.scenarios))
        with (
            acting_in(self.env_id, self.policy) as (env, policy, name),
            progress_bars([name], self.sample, Work(what, length, directory)) as bars,
        ):
            for one in corrections.collect(env, policy, suite.scenarios):
                found.append(one)
                bars.set(name, len(found), "")
        summary = corrections.summarise(found)
        parts = [f"# What {name} adds, on {suite.name} ({self.profile})", corrections.outcome_table(summary)]
        for step, title in enumerate(corrections.STEP_NAMES):
            about = f"## During {title}: mean (standard deviation)"
            parts += [about, corrections.correction_table(summary, step)]
        text = "\n\n".join(part.strip() for part in parts) + "\n"
        directory.mkdir(parents=True, exist_ok=True)
        page = directory / f"corrections-{stem_or_hash([name], name)}.md"
        write_text(page, text)
        print(text)
        for path in (page, *corrections.save_corrections(summary, directory, page.stem)):
            print(path)


@dataclass(frozen=True, kw_only=True)
class Reproduce(RunningOptions):
    """Measure the paper's results again on the pendulum."""

    section: Positional[Literal["all", "scenario-1", "scenario-2", "ablations", "limits"]] = "all"
    """Part of the paper that is measured again."""
    directions: Count = field(default=36, metadata=within(1, 3600))
    """Number of directions of scenario 2, and of the limits up to 12, evenly spread, counter-clockwise
    from forward."""
    page: Annotated[str | None, arg(metavar="FILE.md", help_behavior_hint="")] = None
    """Write a page that holds the paper's claims against the run, with its pictures beside it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.page is not None and Path(self.page).suffix != ".md":
            raise InvalidValueError(f"--page must name a .md file, got {shown(self.page)}")

    def run(self) -> None:
        """Reproduce, write everything into the directory, print the tables or the object."""
        from ..report import page as pages
        from ..reproduction import run

        page = None if self.page is None else Path(self.page)
        where = self.processes, self.directory, self.overwrite, page
        found = run.reproduce(self.section, self.directions, *where)
        command = pages.command_of("reproduce", self, ("section",))
        paths = (found.directory / run.RESULT, found.directory / run.TABLES, *found.pictures)
        written = options.page_lines(lambda: run.write_reproduction_page(found, command))
        tables = *found.tables, *([run.claims_table(found.claims)] if found.claims else [])
        self.show(found.content, tables, [run.verdict(found.claims), *map(str, paths), *written])
