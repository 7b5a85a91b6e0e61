"""`push-recovery sensitivity`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from tyro.conf import arg

from ..options import SUITES_TEXT, Count, EnvOptions, RunningOptions, within


@dataclass(frozen=True, kw_only=True)
class Sensitivity(EnvOptions, RunningOptions):
    """What outcomes hang on."""

    suite: Annotated[str, arg(metavar="NAME|FILE", help=SUITES_TEXT)] = "hard"
    sample: Count = field(default=128, metadata=within(1))
    """Number of pushes, evenly spread over the suite."""
    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE")] = ("two-stage",)
    """Policies to run: names (see list), policy files, or MODULE:ATTRIBUTE."""
    variations: Annotated[tuple[str, ...] | None, arg(metavar="NAME", help_behavior_hint="")] = None
    """Variations to run, such as step-1ms elliptic joint-friction-1 hardware (docs/sensitivity.md; by default
    all of them)."""

    def run(self) -> None:
        """Run the variations, print a table for each policy or the object, write the reports."""
        from ...output.tables import print_table
        from ...score.suites import get_suite
        from ...sensitivity.report import (
            COLUMNS,
            sensitivity_cells,
            sensitivity_title,
            write_sensitivity_reports,
        )
        from ...sensitivity.run import sensitivity
        from ...sensitivity.variations import VARIATIONS

        result = sensitivity(
            get_suite(self.suite, self.env_id), self.sample, self.env_id, self.policies,
            tuple(VARIATIONS) if self.variations is None else self.variations,
            self.processes, self.directory, self.overwrite,
        )  # fmt: skip
        report = write_sensitivity_reports(result)
        if self.json:
            self.print_json(result.to_dict())
            return
        for policy in result.evaluation.rows:
            cells = sensitivity_cells(result.changes(policy))
            print_table(sensitivity_title(result, policy), COLUMNS, cells)
        print(f"report: {report}")
