"""`push-recovery ceiling`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from tyro.conf import arg

from ...rollout.names import TABLE_ARMS
from ..options import SUITES_TEXT, Count, EnvOptions, Real, RobotOptions, RunningOptions, within

POLICIES_TEXT = (
    "Policies whose lost pushes are searched: names (see list), policy files, or MODULE:ATTRIBUTE."
)


@dataclass(frozen=True, kw_only=True)
class CeilingCommand(EnvOptions, RobotOptions, RunningOptions):
    """What is possible at least; the searches are those of `ceiling.settings.CeilingSettings`."""

    suite: Annotated[str, arg(metavar="NAME|FILE", help=SUITES_TEXT)] = "hard"
    sample: Annotated[int | None, arg(metavar="N", help_behavior_hint="")] = field(
        default=None, metadata=within(1)
    )
    """Number of pushes, evenly spread over the suite (by default all of them)."""
    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE", help=POLICIES_TEXT)] = TABLE_ARMS
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
        from ...ceiling.report import ceiling_cells, search_lines, write_ceiling_reports
        from ...ceiling.run import ceiling
        from ...ceiling.settings import CeilingSettings
        from ...output.tables import print_table
        from ...score.report import COLUMNS, evaluation_title
        from ...score.suites import pushes_on
        from ...sensitivity.run import sample_of

        settings = CeilingSettings(
            policy=self.planner, steps=self.steps, population=self.population, elites=self.elites,
            generations=self.generations, spread=self.spread, scale=self.scale, seed=self.seed,
        )  # fmt: skip
        suite = pushes_on(self.env_id, self.suite, self.model_errors, self.profile)
        if self.sample is not None:
            suite = sample_of(suite, self.sample)
        found = ceiling(
            suite, self.env_id, self.policies, settings, self.processes, self.directory, self.overwrite
        )
        report = write_ceiling_reports(found)
        if self.json:
            self.print_json(found.to_dict())
            return
        print_table(evaluation_title(found.evaluation), COLUMNS, ceiling_cells(found))
        print(search_lines(found), end="")
        print(f"report: {report}")
