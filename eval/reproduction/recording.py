"""One recorded episode of the pendulum, and what a case of scenario 1 shows in numbers.

One recorded episode of the pendulum: what the figures of scenario 1 are drawn from.

From a watched episode to its `Record`.

What a case of scenario 1 shows, in numbers: gait before the push, the pushed step, what follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.nominal_gait import NominalGait
from ...controllers.model.observation import SWING_POSITION, side_sign
from ...envs.pendulum.env import PendulumCore
from ..rollout.episodes import Slots
from .pendulum import EpisodeJob, PushKind, Variant, built, run_batch

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Record:
    """Time histories, world frame (x forward, y left); one sample per planning period, n of them, m steps."""

    arm: str  # name of the policy
    time: Array  # (n,) since reset [s]
    com: Array  # (n, 2) [m]
    dcm: Array  # (n, 2) [m]
    cop: Array  # (n, 2) held since the sample before [m]
    cmp: Array  # (n, 2) [m]
    trunk_angle: Array  # (n, 2) lean towards +x, +y [rad]
    trunk_torque: Array  # (n, 2) held since the sample before [N m]
    stance: Array  # (n, 2) centre of the stance sole [m]
    swing: Array  # (n, 3) centre of the swing sole [m]
    step: Ints  # (n,) number of touchdowns so far
    foothold: Array  # (m, 2) centre of every sole that was stood on, in order [m]
    foothold_side: Ints  # (m,) 0 left, 1 right
    touchdown: Array  # (m,) when it was set down, 0 for the first [s]
    push_force: Array  # (2,) [N]
    push_start: float  # [s]
    push_duration: float  # [s]
    survived: bool
    foot_size: tuple[float, float]  # length, width [m]
    com_height: float  # [m]
    trunk_torque_max: float  # [N m]
    trunk_angle_max: float  # [rad]


class _Recorder:
    """Copies what passes of the first pendulum of a core."""

    def __init__(self) -> None:
        self._rows: list[dict[str, Array]] = []
        self.push_start = 0.0  # [s]

    def __call__(self, slots: Slots) -> None:
        """Take one sample."""
        core: PendulumCore = slots.episodes.core
        s, seen = core.state, core.observation[0]
        outward = np.array([1.0, side_sign(s.side[0]), 1.0])
        self.push_start = float(core.pushes.start[0, 0])
        row = {
            "time": s.time[0],
            "com": s.com[0],
            "dcm": s.com[0] + s.velocity[0] / core.robot.omega,
            "cop": s.cop[0],
            "cmp": s.cmp[0],
            "trunk_angle": s.angle[0],
            "trunk_torque": core.robot.weight * (s.cmp[0] - s.cop[0]),
            "stance": s.stance[0],
            "swing": np.append(s.stance[0], 0.0) + outward * seen[SWING_POSITION],
            "step": s.steps[0],
            "side": s.side[0],
            "step_start": s.step_start[0],
        }
        self._rows.append({name: np.array(value) for name, value in row.items()})

    def histories(self) -> dict[str, Array]:
        """Samples by name, (n, ...)."""
        return {name: np.stack([row[name] for row in self._rows]) for name in self._rows[0]}


def record(variant: Variant, push: PushKind, strength: float) -> Record:
    """The time histories of one push of one variant."""
    policy, plant = built(variant)
    recorder = _Recorder()
    scenario = push.scenario(strength)
    ending = run_batch(policy, [scenario], plant, variant.measurement, recorder)[0]
    values = recorder.histories()
    first = np.flatnonzero(np.diff(values["step"], prepend=-1) > 0)  # first sample of every step
    robot = variant.robot_model
    return Record(
        arm=variant.label,
        step=values.pop("step").astype(np.int64),
        foothold_side=values.pop("side")[first].astype(np.int64),
        touchdown=values.pop("step_start")[first],
        foothold=values["stance"][first],
        **values,
        push_force=np.array(scenario.pushes[0].force[:2]),
        push_start=recorder.push_start,
        push_duration=scenario.pushes[0].duration,
        survived=ending.survived,
        foot_size=(robot.foot_length, robot.foot_width),
        com_height=robot.com_height,
        trunk_torque_max=robot.trunk_torque_max,
        trunk_angle_max=robot.trunk_angle_max,
    )


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
