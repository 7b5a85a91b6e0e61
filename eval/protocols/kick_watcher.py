"""What RecoverFormer measures of an episode: fallen by its criterion, time to stable, largest tilt."""

from __future__ import annotations

import math

import numpy as np

from ...controllers.whole_body.kinematics import TRUNK
from ...envs.biped.core import BipedCore
from ...envs.scenario.push import GaitEvent
from ...envs.scenario.scenario import Scenario
from ..rollout.outcome import Ending
from .watched import Found

LOWEST = 0.30 / 0.79  # height of the pelvis at which it counts as fallen, share of that in which it stands
STEEPEST = 1.2  # tilt of the trunk at which it does [rad]
STILL = 0.15  # speed of the base below which it counts as stable [m/s]
UPRIGHT = 8  # entry of a body's rotation matrix: the cosine of its tilt


class KickWatcher:
    """Looks at pelvis and trunk of each robot, at the true state, from the disturbance on."""

    def __init__(self) -> None:
        self._episodes: dict[int, _Measured] = {}

    def begin(self, core: BipedCore, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario with one kick or one push at a time."""
        starts = [kick.start for kick in scenario.kicks] + [push.start for push in scenario.pushes]
        times = [start for start in starts if not isinstance(start, GaitEvent)]
        standing = float(core.true_state(k).qpos[k, 2])
        self._episodes[k] = _Measured(min(times, default=math.inf), standing)

    def look(self, core: BipedCore, k: int) -> None:
        """Take in where robot k is."""
        state = core.true_state(k)
        self._episodes[k].take(
            float(core.gait.time[k]),
            float(state.qpos[k, 2]),
            float(np.linalg.norm(state.qvel[k, :3])),
            math.acos(min(max(float(state.xmat[k, TRUNK, UPRIGHT]), -1.0), 1.0)),
        )

    def found(self, core: BipedCore, k: int, ending: Ending) -> Found:
        """RSR, TTS and PTT of the episode."""
        return self._episodes.pop(k).told(ending)


class _Measured:
    """One episode so far."""

    def __init__(self, start: float, standing: float):
        self._start, self._standing = start, standing
        self._lowest, self._steepest, self._tilt, self._stable = standing, 0.0, 0.0, math.nan

    def take(self, time: float, height: float, speed: float, tilt: float) -> None:
        """One moment: [s], [m], [m/s], [rad]."""
        self._lowest, self._steepest = min(self._lowest, height), max(self._steepest, tilt)
        if time > self._start:
            self._tilt = max(self._tilt, tilt)
            if math.isnan(self._stable) and speed < STILL:
                self._stable = time

    def told(self, ending: Ending) -> Found:
        """Their measures; the time to stable of one that never was is what was left of its episode."""
        stands = not ending.fell and self._lowest >= LOWEST * self._standing and self._steepest <= STEEPEST
        stable = ending.time if math.isnan(self._stable) else self._stable
        after = math.isfinite(self._start)
        return {
            "stood": stands,
            "time_to_stable": round(stable - self._start, 6) if after else None,
            "peak_tilt_deg": round(math.degrees(self._tilt), 4) if after else None,
        }
