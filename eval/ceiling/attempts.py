"""Many attempts at one push, side by side from the same moment on, and what each was worth."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...envs.biped.env import BipedEpisodes
from ...envs.scenario.scenario import Scenario
from ...envs.snapshot.robot_snapshot import RobotSnapshot
from ..rollout.loop import Ints, run_episodes
from ..rollout.outcome import Outcome
from ..rollout.slots import Slots
from ..sampling_mpc.corrections import Actions, SequenceRule
from ..sampling_mpc.forecast import worth
from .sequences import AttemptsPolicy

RECOVERED = 1e3  # worth of a recovery: above that of everything else


class Attempts(NamedTuple):
    """What became of n attempts, in their order."""

    outcomes: list[Outcome]  # times since reset; steps and reward since the snapshot
    values: NDArray[np.float64]  # (n,) see `RestoredSlots`


class RestoredSlots(Slots):
    """Robots that begin their scenarios where another robot was when it was pushed.

    The value of an attempt is  int worth(m) dt  over the time that the robot stands, m its capture margin:
    the longer it stands and the nearer it stays to what can be captured, the more [m s]; RECOVERED more where
    it has recovered.
    """

    def __init__(self, episodes: BipedEpisodes, snapshot: RobotSnapshot):
        super().__init__(episodes)
        self._snapshot, self.values = snapshot, np.zeros(episodes.n)

    def _enter(self, k: int, scenario: Scenario) -> None:
        """Put robot k back, in a scenario that goes on from there."""
        self.episodes.restore(k, self._snapshot, scenario)

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """One planning period of the robots in `rows`."""
        ended = super().step(rows, actions)
        standing = rows[self.episodes.failure()[rows] == 0]
        self.values[standing] += worth(self.episodes.core.margin[standing]) / self.episodes.control_hz
        return ended


def run_attempts(
    episodes: BipedEpisodes,
    rule: SequenceRule,
    snapshot: RobotSnapshot,
    scenarios: list[Scenario],
    corrections: Actions,
) -> Attempts:
    """Run attempts to their ends.

    Args:
        episodes: of as many robots as there are attempts, or more; what they held before is lost.
        rule: how corrections are added.
        snapshot: where all begin.
        scenarios: that goes on from there, for each attempt.
        corrections: (n, steps, 7) in [-1, 1].
    """
    slots = RestoredSlots(episodes, snapshot)
    found = dict(run_episodes(slots, AttemptsPolicy(rule, corrections), scenarios, "attempt"))
    outcomes = [found[number] for number in range(len(scenarios))]
    recovered = np.array([outcome.recovered for outcome in outcomes])
    return Attempts(outcomes, slots.values[: len(scenarios)] + RECOVERED * recovered)
