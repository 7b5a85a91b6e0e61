"""`push-recovery frontier`."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Annotated

from tyro.conf import arg

from ....envs.scenario.scenario import Command
from ..options import Count, EnvOptions, PushOptions, RobotOptions, RunningOptions, within
from ..page import print_page, write_or_say


@dataclass(frozen=True, kw_only=True)
class Frontier(EnvOptions, PushOptions, RobotOptions, RunningOptions):
    """Scan the directions for the largest recoverable push."""

    policies: Annotated[tuple[str, ...], arg(metavar="NAME|FILE", aliases=("--policy",))] = ("two-stage",)
    """Policies in one picture: names (see list), policy files, or MODULE:ATTRIBUTE."""
    directions: Count = field(default=16, metadata=within(1))
    """Number of directions, evenly spread, counter-clockwise from forward."""
    grid: Annotated[float | None, arg(metavar="X", help_behavior_hint="")] = field(
        default=None, metadata=within(1, 1000)
    )
    """Step between the forces that are tried [N] (by default 10 on the pendulum and 20 elsewhere)."""

    def run(self) -> None:
        """Write picture and frontier.json, print the table or the object."""
        from ....controllers.files import write_text
        from ...frontier.plot import save_pictures
        from ...frontier.report import frontier_cells, frontier_columns, write_frontier_reports
        from ...frontier.scan import FrontierSettings, default_grid, frontier
        from ...output.tables import print_table
        from ...report.pages.frontier import write_frontier_page
        from ...report.replay import command_of

        env_id = self.env_id
        settings = FrontierSettings(
            env_id,
            self.grid or default_grid(env_id),
            self.duration,
            self.body,
            Command(self.vx, self.vy),
            self.model_errors,
            self.profile,
        )
        result = frontier(
            settings, self.policies, self.directions, self.processes, self.directory, self.overwrite
        )
        objects = {name: result.to_dict(name) for name in result.rows}
        content = next(iter(objects.values())) if len(objects) == 1 else {"policies": objects}
        write_text(result.directory / "frontier.json", json.dumps(content, indent=1) + "\n")
        pictures = save_pictures(result)
        title = f"{env_id}: largest force before the first failure [N]"
        report = write_frontier_reports(result, title)
        page = write_or_say(lambda: write_frontier_page(result, command_of("frontier", self)))
        if self.json:
            self.print_json(content)
            return
        title = f"{title} (share of F* of its own box, of the paper's; largest survived)"
        print_table(title, frontier_columns(result), frontier_cells(result))
        print(f"report: {report}")
        print("pictures: " + ", ".join(str(path) for path in pictures))
        print_page(page)
