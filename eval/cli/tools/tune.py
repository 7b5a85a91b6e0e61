"""`push-recovery tune`: run or resume a study, show how it goes, and say what it found."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import arg

from ..options import Count, EnvOptions, ErrorOptions, RunningOptions, within

if TYPE_CHECKING:
    from ...tuning.settings import TuningSettings
    from ...tuning.trials import Row

EPISODE = 6.5  # [s]
RACED = 0.5  # of the pushes that a trial runs on average, as the worse ones end early
PushesToTuneOn = Literal["tuning", "tuning-varied", "tuning-punches"]
ERRORS = (
    "Model errors of every second robot; half of these robots have the mass error negated (docs/tuning.md)."
)


@dataclass(frozen=True, kw_only=True)
class Tune(EnvOptions, ErrorOptions, RunningOptions):
    """Search settings; the defaults are those of `tuning.settings.TuningSettings`."""

    policies: Annotated[tuple[str, ...], arg(metavar="NAME")] = ("two-stage",)
    """Planners that are tuned one after the other, each by a search of its own."""
    space: Literal["planner", "robot", "both"] = "planner"
    """What is searched: the planner's gains; the robot's gait box, gait machine and whole-body control; or
    both."""
    only: Annotated[tuple[str, ...] | None, arg(metavar="FIELD", help_behavior_hint="")] = None
    """Groups or fields of the space, such as limits or gait.apex (by default all of it)."""
    trials: Count = field(default=100, metadata=within(1))
    """Number of trials of each planner."""
    suite: Annotated[PushesToTuneOn | None, arg(help_behavior_hint="")] = None
    """Pushes of the search: tuning has single pushes at the pelvis, tuning-varied has pushes of every kind
    under both profiles, tuning-punches has punches of the tour (docs/protocols.md) all over the robot (by
    default tuning-varied on robots)."""
    scenarios: Count = field(default=256, metadata=within(8))
    """Number of scenarios of a trial that is not stopped early."""
    held_out: Count = field(default=256, metadata=within(8))
    """Number of pushes that the search does not see; start and best meet them at its end."""
    seed: Count = field(default=0, metadata=within(0))
    """Seed of the search."""
    errors: Annotated[str, arg(metavar="JSON", help=ERRORS)] = "{}"

    @property
    def settings(self) -> TuningSettings:
        """What each study is, of the first arm, besides its number of trials."""
        from ...tuning.settings import TuningSettings

        return TuningSettings(
            self.env,
            self.policies[0],
            self.space,
            self.only or (),
            self.preset or "",
            self.seed,
            self.suite or "",
            self.scenarios,
            self.held_out,
            self.model_errors,
        )

    def run(self) -> None:
        """Run the studies, print the tables or the object."""
        from ...output.progress import Bars, progress_bars
        from ...output.work import Work, about, robot_seconds
        from ...tuning.arms import check_arms, place_of, tune_arms
        from ...tuning.report import print_arms, summary

        each = check_arms(self.settings, self.policies)  # unknown names fail here, before the bars
        simulated = EPISODE * (RACED * self.trials * self.scenarios + 2 * self.held_out) * len(each)
        what = f"{self.trials} trials of {', '.join(each)} on {self.scenarios} pushes"
        place = self.directory or place_of(self.settings, list(each))
        work = Work(what, about(robot_seconds(self.env, simulated, self.processes)), place)
        bars: list[Bars] = []

        def show(row: Row, best: Row, policy: str) -> None:
            bars[0].set(policy, row["trial"], f"best {best['score']:.3f} (trial {best['trial']})")

        with ExitStack() as stack:
            found = tune_arms(
                self.settings,
                self.policies,
                self.trials,
                self.processes,
                place,
                self.overwrite,
                {name: partial(show, policy=name) for name in each},
                lambda: bars.append(stack.enter_context(progress_bars(list(each), self.trials, work))),
            )
        if self.json:
            self.print_json(summary(found))
        else:
            print_arms(found)
