"""Tells robots how to walk from waypoint to waypoint, and measures where they stand at the end of each."""

from __future__ import annotations

import math

from ...controllers.model.similarity import Similarity
from ...controllers.whole_body.kinematics import PELVIS
from ...envs.biped.core import BipedCore
from ...envs.scenario.scenario import Scenario
from ..rollout.outcome import Ending
from .follower import Follower, Pose, in_frame, missing
from .tour import SEGMENT, SEGMENTS, run_id_of, waypoints
from .watched import Found

HAIR = 1e-9  # times are sums of steps [s]


class TourWatcher:
    """Looks at the true pose of each robot's pelvis and writes its command, as the harness there does."""

    def __init__(self) -> None:
        self._tours: dict[int, _Tour] = {}

    def begin(self, core: BipedCore, k: int, scenario: Scenario) -> None:
        """Robot k begins a tour where it stands."""
        velocity = Similarity.of(core.robot).velocity
        self._tours[k] = _Tour(run_id_of(scenario.id), pose_of(core, k), velocity)

    def look(self, core: BipedCore, k: int) -> None:
        """Tell robot k where to go from here on; the planning period after the next one is planned on it."""
        core.command[k] = self._tours[k].command(float(core.gait.time[k]), pose_of(core, k))

    def found(self, core: BipedCore, k: int, ending: Ending) -> Found:
        """Errors at the ends of the segments."""
        return self._tours.pop(k).told()


def pose_of(core: BipedCore, k: int) -> Pose:
    """Where the pelvis of robot k truly is."""
    state = core.true_state(k)
    (x, y), rotation = state.qpos[k, :2].tolist(), state.xmat[k, PELVIS].tolist()
    return Pose(x, y, math.atan2(rotation[3], rotation[0]))


class _Tour:
    """One robot on its way."""

    def __init__(self, run_id: int, origin: Pose, velocity: float):
        self._waypoints, self._origin = waypoints(run_id), origin
        self._follower = Follower(velocity)
        self._errors: list[tuple[float, float]] = []  # distance [m] and heading [rad], by segment begun

    def command(self, time: float, pose: Pose) -> tuple[float, float, float]:
        """What is asked of it now."""
        index = min(int((time + HAIR) / SEGMENT), SEGMENTS - 1)
        here, target = in_frame(pose, self._origin), self._waypoints[index]
        forward, left, turn = missing(here, target)
        error = math.hypot(forward, left), abs(turn)
        if index == len(self._errors):
            self._errors.append(error)
        else:
            self._errors[index] = error
        return self._follower.command(here, target)

    def told(self) -> Found:
        """Errors at the last look of each segment begun, also the one in which it fell."""
        return {
            "position_errors_cm": [round(100.0 * distance, 3) for distance, _ in self._errors],
            "heading_errors_deg": [round(math.degrees(turn), 3) for _, turn in self._errors],
        }
