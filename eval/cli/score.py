"""`push-recovery evaluate` and `compare`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from ...controllers.errors import InvalidValueError
from ..rollout import TABLE_ARMS
from . import options
from .options import Count, Flag

ARCHIVE = ".zip"
LOADER = "...training.model_policy"  # a package after this one, which is loaded only where it is needed
DEFAULT_TEXT = f"{options.SUITES_TEXT} By default quick, and on the pendulum, which does not turn, quick-1."
PROFILES_TEXT = f"{options.PROFILE_TEXT} Several profiles are shown side by side."


@dataclass(frozen=True, kw_only=True)
class SuiteOptions(options.EnvOptions, options.ErrorOptions, options.RunningOptions):
    """Options of a command that runs policies on a suite."""

    suite: Annotated[str | None, arg(metavar="NAME|FILE", help=DEFAULT_TEXT, help_behavior_hint="")] = None
    trust: Flag = False
    """Take archives of Stable-Baselines3 (FILE.zip) and networks in TorchScript as policies: loading one runs
    the code that is in it, as you (docs/reliability.md)."""
    film: Annotated[Literal["discordant"] | None, arg(metavar="discordant", help_behavior_hint="")] = None
    """Film the pushes that one policy recovers from and another does not, side by side, as GIF
    and mp4."""
    films: Count = field(default=4, metadata=options.within(1))
    """Largest number of pushes that are filmed."""

    def trusted(self, policies: Sequence[str]) -> list[Any]:
        """The policies, those that may run code under their label; without trust they stay, to be refused."""
        from ..rollout.contract import Trusted, is_contract

        if not self.trust:
            return list(policies)

        def one(name: str) -> Any:
            if name.endswith(ARCHIVE):
                return {name: import_module(LOADER, __package__).ArchivePolicy.of(name)}
            return {name: Trusted(name)} if is_contract(name) else name

        return [one(name) for name in policies]

    def check_film(self) -> None:
        """Raise MissingExtraError before any work where films are asked for and can't be written."""
        if self.film is not None:
            from ..record.film import require_imageio

            require_imageio()

    def make_films(self, evaluation: Any) -> None:
        """Write the films asked for, and say where they are."""
        if self.film is not None:
            from ..record.film import FOLDER, film_discordant

            paths = film_discordant(evaluation, self.films)
            if paths and not self.json:
                print(f"films: {evaluation.directory / FOLDER}")

    def pushes_under(self, profile: str) -> Any:
        """The suite, with the model errors and a profile in every scenario."""
        from ..score.suites import pushes_on

        return pushes_on(self.env_id, self.suite, self.model_errors, profile)

    def write_page(
        self, command: str, found: Mapping[str, Any], directory: Path, positional: Sequence[str] = ()
    ) -> list[str]:
        """Write the page of evaluations by profile, and say where it is."""
        from ..report import evaluation, page

        typed = page.command_of(command, self, positional)
        return options.page_lines(lambda: evaluation.with_pictures(found, typed, directory))


@dataclass(frozen=True, kw_only=True)
class Evaluate(SuiteOptions):
    """Score policies on a suite."""

    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE")] = TABLE_ARMS
    """Policies to score: names (see list), policy files, or MODULE:ATTRIBUTE. passive is not among the
    default ones, since it falls in 2 s without a push."""
    profile: Annotated[tuple[str, ...], arg(metavar="NAME", help=PROFILES_TEXT)] = ("exact",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(set(self.profile)) < len(self.profile):
            raise InvalidValueError(f"--profile must name each one once, got {' '.join(self.profile)}")

    def run(self) -> None:
        """Evaluate under each profile, print one table or object, write the reports.

        Each profile has a directory of its own, below DIR where there are several.
        """
        from ..ceiling import with_ceiling
        from ..score import evaluate, report

        self.check_film()
        suites = {name: self.pushes_under(name) for name in self.profile}  # unknown ones fail here
        policies, several = self.trusted(self.policies), len(suites) > 1
        found, objects, lines, table = {}, {}, [], None
        for name, suite in suites.items():
            place = self.directory / name if several and self.directory else self.directory
            one = evaluate.evaluate(suite, self.env_id, policies, self.processes, place, self.overwrite)
            reported = with_ceiling(one, self.processes, self.overwrite)
            lines.append(f"report: {report.write_evaluation_reports(one, reported)}")
            more = [policy for policy in reported.rows if policy not in one.rows]  # a stored ceiling
            objects[name] = one.to_dict() | {policy: reported.score(policy).to_dict() for policy in more}
            found[name], table = one, report.rates_table(reported)
        directory = self.directory or next(iter(found.values())).directory
        if several:
            table = report.profiles_table(found)
            lines.insert(0, f"profiles: {report.write_profiles(found, directory)}")
        lines += self.write_page("evaluate", found, directory)
        content = {"profiles": objects} if several else next(iter(objects.values()))
        self.show(content, filter(None, [table]), lines)
        for one in found.values():
            self.make_films(one)


@dataclass(frozen=True, kw_only=True)
class Compare(SuiteOptions, options.RobotOptions):
    """Compare two policies on the same pushes."""

    a: Annotated[Positional[str], arg(metavar="A")]
    """First policy: name (see list), file, or MODULE:ATTRIBUTE."""
    b: Annotated[Positional[str], arg(metavar="B")]
    """Second policy, in the same form."""

    def run(self) -> None:
        """Compare two policies, print the table or the object."""
        from ..score import evaluate, report

        self.check_film()
        suite, (a, b) = self.pushes_under(self.profile), self.trusted((self.a, self.b))
        found = evaluate.compare(a, b, suite, self.env_id, self.processes, self.directory, self.overwrite)
        page = self.write_page("compare", {self.profile: found.evaluation}, found.directory, ("a", "b"))
        outcomes = f"outcomes: {found.directory / 'outcomes.jsonl'}"
        self.show(found.to_dict(), [report.comparison_table(found)], [outcomes, *page])
        self.make_films(found.evaluation)
