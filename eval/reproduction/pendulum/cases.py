"""What a case of scenario 1 shows, in numbers: gait before the push, the pushed step, what follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ....controllers.model.frame import side_sign
from ....controllers.model.nominal_gait import NominalGait
from .record import Record
from .recording import record
from .scan import EpisodeJob

SWAY_TIME = 1.0  # the sway is that within this time of the push's onset [s]
LAST_STEPS = 2  # the final speed is that of so many steps


@dataclass(frozen=True)
class CaseJob(EpisodeJob):
    """The numbers of one push of one variant."""

    FIELDS: ClassVar[tuple[str, ...]] = (
        "survived", "end_time", "step_error_before", "duration_error_before", "pushed_step",
        "cop_to_inner_edge", "peak_lean_within_1_s", "peak_lean", "final_lean",
    )  # fmt: skip
    kind: ClassVar[str] = "case"

    def run(self) -> dict[str, Any]:
        """Run and measure it."""
        episode = record(self.variant, self.push, self.strength)
        return case_numbers(episode, self.variant.gait(self.push.vx))


def case_numbers(episode: Record, gait: NominalGait) -> dict[str, Any]:
    """Numbers of one case as JSON; lengths [m], times [s], angles [rad], speed [m/s].

    Args:
        episode: its time histories, from before the push on.
        gait: nominal gait of its command.
    """
    pushed = int(np.searchsorted(episode.touchdown, episode.push_start + 1e-9, side="right")) - 1
    strides, durations = np.diff(episode.foothold, axis=0), np.diff(episode.touchdown)
    before = slice(0, pushed)
    nominal = np.array([gait.length, gait.width])
    steps = np.stack([strides[:, 0], np.abs(strides[:, 1])], axis=1)
    inside = episode.step == pushed
    outward = side_sign(episode.foothold_side[pushed])
    inner = outward * (episode.cop[inside, 1] - episode.foothold[pushed, 1])
    lean = np.abs(episode.trunk_angle).max(axis=1)
    swaying = (episode.time >= episode.push_start) & (episode.time <= episode.push_start + SWAY_TIME)
    numbers = {
        "survived": episode.survived,
        "end_time": float(episode.time[-1]),
        "step_error_before": float(np.abs(steps[before] - nominal).max()),
        "duration_error_before": float(np.abs(durations[before] - gait.duration).max()),
        "pushed_step": {"length": float(steps[pushed, 0]), "width": float(steps[pushed, 1]),
                        "duration": float(durations[pushed])},
        "cop_to_inner_edge": float(inner.max()),
        "peak_lean_within_1_s": float(lean[swaying].max()),
        "peak_lean": float(lean.max()),
        "final_lean": float(lean[-1]),
    }  # fmt: skip
    if episode.survived:
        first, last = episode.touchdown[-1 - LAST_STEPS], episode.touchdown[-1]
        at = np.searchsorted(episode.time, [first, last])
        run = episode.com[at[1], 0] - episode.com[at[0], 0]
        numbers["final_speed"] = float(run / (episode.time[at[1]] - episode.time[at[0]]))
    return numbers
