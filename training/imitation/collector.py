"""Robots that a learner and its teacher lead in turn, and what the teacher would ask in every state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...envs.joint.taught import TaughtEpisodes
from .settings import ImitationSettings

Floats = NDArray[np.float32]
Act = Callable[[NDArray[np.float64]], Floats]  # observations (n, 58) -> targets (n, 14)


@dataclass(frozen=True)
class Shown:
    """What one round has given."""

    observations: Floats  # (samples, 58)
    targets: Floats  # (samples, 14) of the teacher, within [-1, 1]
    alone: float  # robot seconds that the learner has walked [s]
    falls: int  # of robots that it led


class Collector:
    """Robots under joint targets that go on from round to round.

    In a free episode the learner leads from the start, in the others after a while. The teacher's torques
    lead before that, and what its targets were is taken for the action.

    Args:
        settings: of the run.
        episodes: of `settings.robots` robots.
        rng: of scenarios and turns.
    """

    def __init__(self, settings: ImitationSettings, episodes: TaughtEpisodes, rng: np.random.Generator):
        self.settings, self.episodes, self.rng = settings, episodes, rng
        self._turn = np.zeros(episodes.n)  # time from which the learner leads [s]
        self._begun = False

    def collect(self, act: Act, number: int) -> Shown:
        """Let all robots walk for a round."""
        if not self._begun:
            for k in range(self.episodes.n):
                self._begin(k, number)
            self._begun = True
        samples, alone, falls = [], 0.0, 0
        for _ in range(self.settings.periods):
            led = self.episodes.core.gait.time < self._turn
            observations, targets, good, over, fell = self._period(act, led)
            samples.append((observations[good], targets[good]))
            alone += float((~led).sum()) / self.episodes.control_hz
            falls += int((fell & ~led).sum())
            for k in np.flatnonzero(over).tolist():
                self._begin(k, number)
        seen, asked = (np.concatenate(part) for part in zip(*samples, strict=True))
        return Shown(seen, asked, alone, falls)

    def _period(self, act: Act, led: NDArray[np.bool_]) -> tuple[Floats, Floats, NDArray, NDArray, NDArray]:
        """One period: observations before it, the teacher's targets, which are good, over, and fallen."""
        episodes = self.episodes
        episodes.lead(led)
        observations = episodes.seen.astype(np.float32)
        actions = act(episodes.seen)
        actions[led] = np.clip(episodes.targets[led], -1.0, 1.0)
        # a teacher who takes the robot to stand on the other foot would show the mirrored answer
        agree = episodes.core.walk.stance == episodes.core.gait.stance
        period = episodes.step(actions)
        failed = period.failed.copy()
        good = agree & ~failed & (np.abs(episodes.targets).max(axis=1) < self.settings.largest)
        targets = np.clip(episodes.targets, -1.0, 1.0).astype(np.float32)
        return observations, targets, good, failed | period.truncated, failed

    def _begin(self, k: int, number: int) -> None:
        settings, rng = self.settings, self.rng
        scenario = self.episodes.drawn(settings.pushes, rng)
        if rng.random() < settings.unpushed:
            scenario = replace(scenario, pushes=(), duration=4.0)
        self.episodes.begin(k, scenario)
        free = rng.random() < settings.free(number)
        shown = number < settings.shown_rounds
        self._turn[k] = np.inf if shown else 0.0 if free else rng.uniform(0.0, settings.longest_lead)
