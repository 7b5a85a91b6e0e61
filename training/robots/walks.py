"""Robots in the middle of undisturbed walks, which training puts back at the moment of a push."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.policies.interface import Policy
from ...envs.episode.episodes import GaitEpisodes
from ...envs.scenario.push_distribution import PushDistribution
from ...envs.scenario.scenario import Scenario
from ...envs.snapshot.robot_snapshot import RobotSnapshot

EARLIEST, LATEST = 1.2, 3.6  # of a snapshot since reset: at least three steps, and two of them on [s]
LONG = 60.0  # of a scenario without pushes, which no walk reaches the end of [s]


class Uncorrected:
    """The policy of robots that walk by themselves: zeros for each of them.

    Args:
        size: of an action.
    """

    def __init__(self, size: int):
        self._size = size

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Zeros (n, size) for observations (n, ...)."""
        return np.zeros((len(observation), self._size), np.float32), state


def take_walks(
    episodes: GaitEpisodes, policy: Policy, pushes: PushDistribution, count: int, rng: np.random.Generator
) -> list[RobotSnapshot]:
    """Snapshots of `count` walks under a policy, each of another robot and command, at a random moment.

    A walk that falls is not taken.

    Args:
        episodes: what they held before is lost.
        policy: that walks, without a memory.
        pushes: of which the commands and the model errors are drawn, and no push.
        count: of snapshots.
        rng: of the draws.
    """
    n, due, taken = episodes.n, np.zeros(episodes.n), []

    def begin(k: int) -> None:
        episodes.begin(k, walking(episodes.drawn(pushes, rng)))
        due[k] = rng.uniform(EARLIEST, LATEST)

    for k in range(n):
        begin(k)
    while len(taken) < count:
        actions, _ = policy.predict(episodes.core.observation)
        failed = episodes.step(actions).failed
        arrived = ~failed & (episodes.motion().time >= due)
        for k in np.flatnonzero(failed | arrived).tolist():
            if arrived[k]:
                taken.append(episodes.state_snapshot(k))
            begin(k)
    return taken[:count]


def walking(scenario: Scenario) -> Scenario:
    """A scenario without its pushes."""
    return replace(scenario, pushes=(), duration=LONG)
