"""`push-recovery evaluate` and `compare`.

`push-recovery evaluate`.

`push-recovery compare`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from ...controllers.errors import InvalidValueError
from ..rollout.names import TABLE_ARMS
from .options import (
    PROFILE_TEXT,
    SUITES_TEXT,
    Count,
    EnvOptions,
    ErrorOptions,
    Flag,
    RobotOptions,
    RunningOptions,
    print_page,
    within,
    write_or_say,
)

if TYPE_CHECKING:
    from ..score.evaluate import Comparison, Evaluation
    from ..score.suites import Suite

REPORT = "report.md"
POLICIES_TEXT = (
    "Policies to score: names (see list), policy files, or MODULE:ATTRIBUTE. passive is not among the "
    "default ones, since it falls in 2 s without a push."
)
DEFAULT_TEXT = f"{SUITES_TEXT} By default quick, and on the pendulum, which does not turn, quick-1."
PROFILES_TEXT = f"{PROFILE_TEXT} Several profiles are shown side by side."


@dataclass(frozen=True, kw_only=True)
class SuiteOptions(EnvOptions, ErrorOptions, RunningOptions):
    """Of a command that runs policies on a suite."""

    suite: Annotated[str | None, arg(metavar="NAME|FILE", help=DEFAULT_TEXT, help_behavior_hint="")] = None
    trust: Flag = False
    """Take archives of Stable-Baselines3 (FILE.zip) as policies: loading one runs the code that is in it, as
    you (docs/reliability.md)."""
    film: Annotated[Literal["discordant"] | None, arg(metavar="discordant", help_behavior_hint="")] = None
    """Film the pushes that one policy recovers from and another does not, side by side, as GIF
    and mp4."""
    films: Count = field(default=4, metadata=within(1))
    """Largest number of pushes that are filmed."""

    def check_film(self) -> None:
        """Raise MissingExtraError before any work where films are asked for and can't be written."""
        if self.film is not None:
            from ..record.film import require_imageio

            require_imageio()

    def write_films(self, evaluation: Evaluation) -> None:
        """The films asked for, and where they are."""
        if self.film is None:
            return
        from ..record.film import FOLDER, film_discordant

        paths = film_discordant(evaluation, self.films)
        if paths and not self.json:
            print(f"films: {evaluation.directory / FOLDER}")

    def pushes_under(self, profile: str) -> Suite:
        """The suite, with the model errors and a profile in every scenario."""
        from ..score.suites import pushes_on

        return pushes_on(self.env_id, self.suite, self.model_errors, profile)


@dataclass(frozen=True, kw_only=True)
class Evaluate(SuiteOptions):
    """Score policies on a suite."""

    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE", help=POLICIES_TEXT)] = TABLE_ARMS
    profile: Annotated[tuple[str, ...], arg(metavar="NAME", help=PROFILES_TEXT)] = ("exact",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(set(self.profile)) < len(self.profile):
            raise InvalidValueError(f"--profile must name each one once, got {' '.join(self.profile)}")

    def run(self) -> None:
        """Evaluate under each profile, print one table or object, write the reports."""
        from ..output.tables import print_table
        from ..score.report import (
            COLUMNS,
            evaluation_cells,
            evaluation_title,
            profile_cells,
            profile_columns,
            write_profiles,
        )

        self.check_film()
        found, shown = self._evaluations()
        (first, *others) = found.values()
        page = self._page(found, first.directory)
        if self.json:
            objects = {name: self._object(evaluation, shown[name]) for name, evaluation in found.items()}
            for evaluation in found.values():
                self.write_films(evaluation)
            self.print_json({"profiles": objects} if others else next(iter(objects.values())))
            return
        if not others:
            (whole,) = shown.values()
            print_table(evaluation_title(whole), COLUMNS, evaluation_cells(whole))
        else:
            print_table(evaluation_title(first), profile_columns(found), profile_cells(found))
            print(f"profiles: {write_profiles(found, self.directory or first.directory)}")
        for evaluation in found.values():
            print(f"report: {evaluation.directory / REPORT}")
            self.write_films(evaluation)
        print_page(page)

    def _page(self, found: dict[str, Evaluation], default: Path) -> Path | None:
        """The page of all profiles, in the directory that was named or in the first profile's."""
        from ..report.evaluation import with_pictures
        from ..report.page import command_of

        command = command_of("evaluate", self)
        return write_or_say(lambda: with_pictures(found, command, self.directory or default))

    def _object(self, evaluation: Evaluation, shown: Evaluation) -> dict[str, Any]:
        """The contract's object, and beside it the score of a stored ceiling where there is one."""
        more = [name for name in shown.rows if name not in evaluation.rows]
        return evaluation.to_dict() | {name: shown.score(name).to_dict() for name in more}

    def _evaluations(self) -> tuple[dict[str, Evaluation], dict[str, Evaluation]]:
        """By profile, and the same with the ceiling where answers to the suite are stored.

        Each has a directory of its own, below DIR where there are several.
        """
        from ..ceiling import with_ceiling
        from ..score.evaluate import evaluate, write_reports
        from ..score.report import evaluation_markdown
        from .options import trusted

        suites = {name: self.pushes_under(name) for name in self.profile}  # unknown ones fail here
        policies, found, shown = trusted(self.policies, self.trust), {}, {}
        for name, suite in suites.items():
            several = self.directory is not None and len(suites) > 1
            place = self.directory / name if several and self.directory else self.directory
            found[name] = evaluate(suite, self.env_id, policies, self.processes, place, self.overwrite)
            shown[name] = with_ceiling(found[name], self.processes, self.overwrite)
            write_reports(found[name], evaluation_markdown(shown[name]))
        return found, shown


@dataclass(frozen=True, kw_only=True)
class Compare(SuiteOptions, RobotOptions):
    """Compare two policies on the same pushes."""

    a: Annotated[Positional[str], arg(metavar="A")]
    """First policy: name (see list), file, or MODULE:ATTRIBUTE."""
    b: Annotated[Positional[str], arg(metavar="B")]
    """Second policy, in the same form."""

    def run(self) -> None:
        """Compare two policies, print the table or the object."""
        from ..output.tables import print_table
        from ..score.evaluate import compare
        from .options import trusted

        self.check_film()
        env_id = self.env_id
        a, b = trusted((self.a, self.b), self.trust)
        comparison = compare(
            a,
            b,
            self.pushes_under(self.profile),
            env_id,
            self.processes,
            self.directory,
            self.overwrite,
        )
        content = comparison.to_dict()
        page = self._page(comparison)
        if self.json:
            self.write_films(comparison.evaluation)
            self.print_json(content)
            return
        low, high = content["ci95"]
        cells = [
            ("both recovered", str(content["both"])),
            (f"only {self.a}", str(content["only_a"])),
            (f"only {self.b}", str(content["only_b"])),
            ("neither", str(content["neither"])),
            (
                f"rate of {self.a} minus rate of {self.b}",
                f"{content['rate_difference']:+.3f} ({low:+.3f} to {high:+.3f})",
            ),
            (f"survived {self.a}, {self.b}", f"{content['survived_a']}, {content['survived_b']}"),
            ("exact McNemar p", f"{content['mcnemar_p']:.3g}"),
        ]
        print_table(f"{env_id}: {content['pairs']} pairs of suite {content['suite']}", ("", "value"), cells)
        print(f"outcomes: {comparison.directory / 'outcomes.jsonl'}")
        self.write_films(comparison.evaluation)
        print_page(page)

    def _page(self, comparison: Comparison) -> Path | None:
        """The page of both policies, beside their rows."""
        from ..report.evaluation import with_pictures
        from ..report.page import command_of

        found = {self.profile: comparison.evaluation}
        command = command_of("compare", self, ("a", "b"))
        return write_or_say(lambda: with_pictures(found, command, comparison.directory))
