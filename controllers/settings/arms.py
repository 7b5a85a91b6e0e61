"""The arms of the planner: what each may use, by name."""

from __future__ import annotations

from typing import Any, NamedTuple


class Stages(NamedTuple):
    """What an arm may adapt, and by which rule."""

    use_cop: bool
    use_trunk: bool
    fixed_time: bool = False  # T stays nominal
    foothold: str = "optimal"  # of `PlannerConfig`; another one than this leaves T nominal

    @property
    def settings(self) -> dict[str, Any]:
        """The fields of `PlannerConfig` that make a configuration that of the arm."""
        values: dict[str, Any] = {"use_cop": self.use_cop, "use_trunk": self.use_trunk}
        if self.fixed_time:
            values["adapt_duration"] = False
        if self.foothold != "optimal":
            values["foothold"] = self.foothold
        return values


ARMS: dict[str, Stages] = {
    "passive": Stages(False, False),  # walks the nominal gait, without reaction
    "raibert": Stages(False, False, foothold="capture_point"),
    "herdt": Stages(False, False, foothold="linear_mpc"),
    "fixed-time": Stages(False, False, fixed_time=True),
    "stage-1-paper": Stages(False, False),
    "stage-1": Stages(False, False),
    "stage-1+cop": Stages(True, False),
    "stage-1+momentum": Stages(False, True),
    "two-stage-paper": Stages(True, True),
    "two-stage": Stages(True, True),
}
PAPER_SUFFIX = "-paper"  # of arms with the paper's Table II
# Not in tables unless asked for: no parts of the planner
ON_REQUEST = ("passive", "raibert", "herdt", "fixed-time")
