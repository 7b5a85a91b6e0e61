"""`push-recovery evaluate`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from ...rollout.names import TABLE_ARMS
from ..options import SUITES_TEXT, EnvOptions, RobotOptions, RunningOptions

if TYPE_CHECKING:
    from ...score.suites import Suite


@dataclass(frozen=True, kw_only=True)
class SuiteOptions(EnvOptions, RobotOptions, RunningOptions):
    """Of a command that runs policies on a suite."""

    suite: Annotated[str, arg(metavar="NAME|FILE", help=SUITES_TEXT)] = "quick"

    @property
    def pushes(self) -> Suite:
        """The suite, with the model errors and the profile in every scenario."""
        from ...score.suites import get_suite, on_robots

        return on_robots(get_suite(self.suite), self.model_errors, self.profile)


@dataclass(frozen=True, kw_only=True)
class Evaluate(SuiteOptions):
    """Score policies on a suite."""

    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE")] = TABLE_ARMS
    """Names (see list), policy files, or MODULE:ATTRIBUTE."""

    def run(self) -> None:
        """Evaluate, print the table or the object, write the reports."""
        from ...output.tables import print_table
        from ...score.evaluate import evaluate, write_reports
        from ...score.report import COLUMNS, evaluation_cells, evaluation_markdown, evaluation_title

        evaluation = evaluate(
            self.pushes, self.env_id, self.policies, self.workers, self.directory, self.overwrite
        )
        report = write_reports(evaluation, evaluation_markdown(evaluation))
        if self.json:
            self.print_json(evaluation.to_dict())
            return
        print_table(evaluation_title(evaluation), COLUMNS, evaluation_cells(evaluation))
        print(f"report: {report}")
