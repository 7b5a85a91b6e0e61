"""From a watched episode to its `Record`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....controllers.model.frame import side_sign
from ....controllers.model.observation import SWING_POSITION
from ....envs.pendulum.core import PendulumCore
from ...rollout.slots import Slots
from .batch import run_batch
from .record import Record
from .scan import PushKind
from .variants import Variant, built

Array = NDArray[np.float64]


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
