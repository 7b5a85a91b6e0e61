"""`push-recovery corrections`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from ..options import SUITES_TEXT, Directory, EnvOptions, RobotOptions, within

FOLDER = Path("runs/corrections")
ALONE = 2.0  # what a robot costs alone, of its cost among others


@dataclass(frozen=True, kw_only=True)
class Corrections(EnvOptions, RobotOptions):
    """What a residual adds to the planner, by the direction of the push and by step."""

    policy: Annotated[Positional[str], arg(metavar="NAME|FILE")]
    """Name or file of a residual on gait actions, such as residual."""
    suite: Annotated[str, arg(metavar="NAME|FILE", help=SUITES_TEXT)] = "hard"
    sample: Annotated[int, arg(metavar="N")] = field(default=256, metadata=within(1))
    """Number of pushes, evenly spread over the suite; each runs with the residual and without it."""
    out: Directory = None
    """Directory for report and figure (default: runs/corrections)."""

    def run(self) -> None:
        """Run the pushes, print the tables, write report.md and corrections.png."""
        from ....controllers.files import write_text
        from ...learned.corrections import collect
        from ...learned.corrections_plot import save_corrections
        from ...learned.summary import STEP_NAMES, correction_table, outcome_table, summarise
        from ...output.progress import progress_bars
        from ...output.work import Work, about, episode_seconds
        from ...rollout.policy_source import acting_in
        from ...score.suites import pushes_on
        from ...sensitivity.run import sample_of

        suite = pushes_on(self.env_id, self.suite, self.model_errors, self.profile)
        suite = sample_of(suite, self.sample)
        directory, found = FOLDER if self.out is None else Path(self.out), []
        what = f"{self.sample} pushes of {suite.name}, each with {self.policy} and without"
        length = about(ALONE * 2.0 * episode_seconds(self.env_id, suite.scenarios))
        with (
            acting_in(self.env_id, self.policy) as (env, policy, name),
            progress_bars([name], self.sample, Work(what, length, directory)) as bars,
        ):
            for one in collect(env, policy, suite.scenarios):
                found.append(one)
                bars.set(name, len(found), "")
        summary = summarise(found)
        parts = [f"# What {name} adds, on {suite.name} ({self.profile})", outcome_table(summary)]
        for step, title in enumerate(STEP_NAMES):
            parts += [f"## During {title}: mean (standard deviation)", correction_table(summary, step)]
        text = "\n\n".join(part.strip() for part in parts) + "\n"
        directory.mkdir(parents=True, exist_ok=True)
        write_text(directory / "report.md", text)
        print(text)
        for path in (directory / "report.md", *save_corrections(summary, directory)):
            print(path)
