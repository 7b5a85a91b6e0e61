"""`push-recovery tune`: run or resume a study, show how it goes, and say what it found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import arg

from ..options import Count, EnvOptions, ErrorOptions, RunningOptions, within

if TYPE_CHECKING:
    from ...tuning.settings import TuningSettings
    from ...tuning.trials import Row

ERRORS = "Model errors of every second robot, half of these with the mass error negated (docs/tuning.md)."


@dataclass(frozen=True, kw_only=True)
class Tune(EnvOptions, ErrorOptions, RunningOptions):
    """Search settings; the defaults are those of `tuning.settings.TuningSettings`."""

    policy: Annotated[str, arg(metavar="NAME")] = "two-stage"
    """Arm whose gains are tuned."""
    space: Literal["planner", "robot", "both"] = "planner"
    """The arm's gains; gait box, gait machine and whole-body control, which all arms share; or both."""
    only: Annotated[tuple[str, ...] | None, arg(metavar="FIELD", help_behavior_hint="")] = None
    """Groups or fields of the space, such as limits or gait.apex (all of it)."""
    trials: Count = field(default=100, metadata=within(1))
    """Budget."""
    scenarios: Count = field(default=256, metadata=within(8))
    """Of a trial that is not stopped early."""
    seed: Count = field(default=0, metadata=within(0))
    """Of the search."""
    errors: Annotated[str, arg(metavar="JSON", help=ERRORS)] = "{}"

    @property
    def settings(self) -> TuningSettings:
        """What the study is, besides its number of trials."""
        from ...tuning.settings import TuningSettings

        return TuningSettings(
            self.env,
            self.policy,
            self.space,
            self.only or (),
            self.preset or "",
            self.seed,
            self.scenarios,
            self.model_errors,
        )

    def run(self) -> None:
        """Run a study, print the tables or the object."""
        from ...output.progress import progress_bars
        from ...tuning.candidate import space_of
        from ...tuning.report import print_study, summary
        from ...tuning.study import tune

        settings = self.settings
        space_of(settings)  # unknown fields fail here, before the bar
        with progress_bars([settings.policy], self.trials) as bars:

            def show(row: Row, best: Row) -> None:
                bars.set(settings.policy, row["trial"], f"best {best['score']:.3f} (trial {best['trial']})")

            study = tune(settings, self.trials, self.workers, self.directory, self.overwrite, show)
        if self.json:
            self.print_json(summary(study))
        else:
            print_study(study)
