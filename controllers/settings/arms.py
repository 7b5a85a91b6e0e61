"""The arms of the planner: what each may use, by name."""

from __future__ import annotations

from typing import NamedTuple


class Stages(NamedTuple):
    """What an arm may adapt beyond place and time of the step."""

    use_cop: bool
    use_trunk: bool


ARMS: dict[str, Stages] = {
    "passive": Stages(False, False),  # walks the nominal gait, without reaction
    "stage-1-paper": Stages(False, False),
    "stage-1": Stages(False, False),
    "stage-1+cop": Stages(True, False),
    "stage-1+momentum": Stages(False, True),
    "two-stage-paper": Stages(True, True),
    "two-stage": Stages(True, True),
}
PAPER_SUFFIX = "-paper"  # of arms with the paper's Table II
