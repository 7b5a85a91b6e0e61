"""`push-recovery reproduce`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from ....controllers.errors import InvalidValueError, shown
from ..options import Count, RunningOptions, within
from ..page import print_page, write_or_say

Section = Literal["all", "scenario-1", "scenario-2", "ablations", "limits"]


@dataclass(frozen=True, kw_only=True)
class Reproduce(RunningOptions):
    """Measure the paper's results again on the pendulum."""

    section: Positional[Section] = "all"
    """Part of the paper that is measured again."""
    directions: Count = field(default=36, metadata=within(1))
    """Number of directions of scenario 2, evenly spread, counter-clockwise from forward."""
    page: Annotated[str | None, arg(metavar="FILE.md", help_behavior_hint="")] = None
    """Write a page that holds the paper's claims against the run, with its pictures beside it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.page is not None and Path(self.page).suffix != ".md":
            raise InvalidValueError(f"--page must name a .md file, got {shown(self.page)}")

    def run(self) -> None:
        """Reproduce, write everything into the directory, print the tables or the object."""
        from ...output.tables import print_table
        from ...report.pages.reproduction import write_reproduction_page
        from ...report.replay import command_of
        from ...reproduction.report.run import RESULT, TABLES, reproduce

        page = None if self.page is None else Path(self.page)
        found = reproduce(self.section, self.directions, self.processes, self.directory, self.overwrite, page)
        report = write_or_say(
            lambda: write_reproduction_page(found, command_of("reproduce", self, ("section",)))
        )
        if self.json:
            self.print_json(found.content)
            return
        for table in found.tables:
            print_table(*table)
        for path in (found.directory / RESULT, found.directory / TABLES, *found.pictures):
            print(path)
        print_page(report)
