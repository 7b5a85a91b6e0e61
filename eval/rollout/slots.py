"""Robots that share one core: each slot holds an episode, and all move in one planning period."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...envs.episode.env import check_action
from ...envs.episode.episodes import GaitEpisodes
from ...envs.episode.held_action import Held, Mask, hold_action
from ...envs.scenario.scenario import Scenario
from ..measures.effort import EffortMeter
from .loop import Ints, Watch
from .one import bounds_met
from .outcome import Ending
from .wrapped_action import ActionRule, Actions


class Slots:
    """The robots of a core, for `run_episodes`.

    Args:
        episodes: of the core; what they held before is lost.
        rule: what an action means, see `action_rule`; an action for one period without it.
        watch: called with the slots after the start of an episode and after every planning period.
    """

    def __init__(self, episodes: GaitEpisodes, rule: ActionRule | None = None, watch: Watch | None = None):
        self.episodes, self.n = episodes, episodes.n
        self._rule, self._watch = rule, watch
        self._hold = 1 if rule is None else rule.hold
        self._actions = np.zeros((episodes.n, episodes.action_size), np.float32)
        self._begun = np.zeros(episodes.n, np.bool_)
        self._total = np.zeros(episodes.n)  # reward
        self._meter = EffortMeter(episodes)
        self._ends: dict[int, Ending] = {}  # by slot; without the reward of the held action

    def begin(self, k: int, scenario: Scenario) -> None:
        """Begin a scenario in slot k."""
        self._total[k] = 0.0
        self._enter(k, scenario)
        self._meter.begin(k)
        self._begun[k] = True
        self._look()

    def _enter(self, k: int, scenario: Scenario) -> None:
        """Put robot k where the scenario begins."""
        self.episodes.begin(k, scenario)

    def rest(self, k: int) -> None:
        """Leave slot k empty; a robot that has fallen rests, so that it costs no physics."""
        if not self._begun[k]:
            self.episodes.begin(k, Scenario("empty"))
            self._begun[k] = True
        self.episodes.failure()[k] = 1

    def observe(self, rows: Ints) -> NDArray[np.float64]:
        """Observations (len(rows), observation_size)."""
        return self.episodes.seen[rows]

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """One action of the episodes in `rows`, for as long as it is held; returns the slots that ended.

        Raises:
            InvalidValueError: actions of another shape or not finite.
        """
        held = check_action(actions, "actions", (len(rows), self.episodes.action_size))
        live = np.zeros(self.n, np.bool_)
        live[rows] = True

        def act(live: Mask) -> Actions:
            self._actions[live] = self._gait_actions(np.flatnonzero(live), held[live[rows]])
            return self._actions

        came = hold_action(self.episodes, live, self._hold, act, self._end, self._after_period)
        self._total[rows] += came.reward[rows]
        return sorted(self._ends)

    def ending(self, k: int) -> Ending:
        """Of the episode that has ended in slot k."""
        ending = self._ends.pop(k)
        return replace(ending, total_reward=float(self._total[k]))

    def _gait_actions(self, rows: Ints, actions: Actions) -> Actions:
        if self._rule is None:
            return actions
        return self._rule.gait_actions(self.episodes.core.observation[rows], actions)

    def _end(self, over: Mask, left: int, came: Held) -> None:
        """Keep what becomes of the slots `over`; within a held action their robots go on."""
        episodes = self.episodes
        for k in np.flatnonzero(over).tolist():
            self._ends[k] = Ending(
                fell=bool(came.failed[k]),
                time=float(episodes.motion().time[k]),
                recovered_at=episodes.monitor.recovered_at(k),
                failure_reason=episodes.failures[episodes.failure()[k]],
                total_reward=0.0,
                bounds=bounds_met(episodes, k),
                measures=self._meter.of(k),
            )

    def _after_period(self) -> None:
        self._meter.look()
        self._look()

    def _look(self) -> None:
        if self._watch is not None:
            self._watch(self)
