"""Copies of one robot that go on from where it is, as it would if nothing further happened to it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...envs.biped.env import BipedEpisodes
from ...envs.snapshot.robot_snapshot import NEXT_CHANGE, RobotSnapshot
from .corrections import Actions, Array, SequenceRule, begun

LEAST, MOST = -0.3, 0.05  # capture margins beyond which more or less is worth the same [m]
HAIR = 1e-9  # times are sums of steps [s]
CAUGHT = -0.02  # least capture margin of a robot that is taken to stay up [m]


def worth(margin: Array) -> Array:
    """What a second of standing with a capture margin [m] is worth: clip(m, LEAST, MOST) - LEAST [m]."""
    return np.clip(margin, LEAST, MOST) - LEAST


def state_of(episodes: BipedEpisodes) -> Array:
    """Where the first robot is: positions and velocities (nq + nv,)."""
    physics = episodes.core.physics
    return np.concatenate([physics.qpos[0], physics.qvel[0]])


class Future(NamedTuple):
    """What comes of n corrections within the horizon."""

    values: Array  # (n,) int worth(m) dt over the time that the robot stands, m its capture margin [m s]
    stands: NDArray[np.bool_]  # (n,) at the end of it, with a capture margin of at least CAUGHT


class Forecast:
    """n copies of a robot, each under corrections of its own.

    They have its state and its command. What is to come of its scenario is unknown to them: of a push that
    acts on it the rest, later pushes and kicks, and changes of the command.

    Args:
        episodes: of n robots of the same kind; what they held before is lost.
        rule: how corrections are added.
        periods: planning periods of the horizon.
        outlast: a push that acts is taken to last longer by this share of the time that it has acted.
    """

    def __init__(self, episodes: BipedEpisodes, rule: SequenceRule, periods: int, outlast: float):
        self.episodes, self._rule, self._periods, self._outlast = episodes, rule, periods, outlast

    def run(self, now: RobotSnapshot, corrections: Actions) -> Future:
        """Simulate corrections (n, steps, 7), the first row of each for the step that has begun."""
        core = self.episodes.core
        self.put(now, self._outlast)
        progress, values = begun(corrections), np.zeros(self.episodes.n)
        for _ in range(self._periods):
            actions, progress = self._rule.act(core.observation, progress)
            self.episodes.step(actions)
            standing = self.episodes.failure() == 0
            if not standing.any():
                break
            values += standing * worth(core.margin)
        stands = (self.episodes.failure() == 0) & (core.margin >= CAUGHT)
        return Future(values / self.episodes.control_hz, stands)

    def put(self, now: RobotSnapshot, outlast: float) -> None:
        """Put all robots where another one is; what pushes it lasts longer by a share of its time so far."""
        core, due = self.episodes.core, now.rows[NEXT_CHANGE].item()
        scenario = replace(now.scenario, changes=now.scenario.changes[:due])
        for k in range(self.episodes.n):
            self.episodes.restore(k, now, scenario)
            core.kicks.assign(k, ())
        last = now.time - 1.0 / self.episodes.control_hz + HAIR
        for i in range(len(scenario.pushes)):
            start, duration = now.rows["pushes.start"][i], now.rows["pushes.duration"][i]
            if start < now.time and last < start + duration:  # it has been felt
                core.pushes.duration[:, i] = (1.0 + outlast) * (now.time - start)
            else:
                core.pushes.force[:, i] = 0.0

    def after(self, now: RobotSnapshot, action: Actions) -> Array:
        """Where a robot is a planning period later if nothing pushes it, see `state_of`."""
        self.put(now, 0.0)
        self.episodes.step(action)
        return state_of(self.episodes)
