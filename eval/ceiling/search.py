"""The search for an answer to one push: the same row whoever does it, and whatever runs beside it."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from ...controllers.model.gait_box import GAIT_SIZE
from ...envs.biped.env import BipedEpisodes
from ...envs.scenario.scenario import Scenario
from ..rollout.batch import batch_episodes
from ..rollout.one import rollout
from ..rollout.workers import Runner
from ..sampling_mpc.corrections import Actions, SequenceRule
from ..sampling_mpc.cross_entropy import CrossEntropy, as_text
from .attempts import run_attempts
from .moment import Moment, moment_of_push, require_bipeds
from .neighbours import NEIGHBOURS, neighbours
from .sequences import Sequence, SequencePolicy
from .settings import CeilingSettings

CEILING = "ceiling"  # label of the rows
SearchJob = tuple[CeilingSettings, Scenario]
Row = dict[str, Any]


class Answer(NamedTuple):
    """The best attempt at a push."""

    corrections: Actions  # (steps, 7)
    recovered: bool
    attempts: int  # that were made


class Searcher:
    """Robots and planner of one environment, for one search after the other.

    Args:
        env: single environment.
        settings: of the searches.
    """

    def __init__(self, env: gym.Env, settings: CeilingSettings):
        biped: Any = env.unwrapped
        self.env, self.settings = env, settings
        self._planner = settings.policy, biped.robot, biped.limits, biped.preset, settings.scale
        self.rule = SequenceRule(*self._planner)
        self._walker = require_bipeds(batch_episodes(env, 1))
        self._robots: BipedEpisodes = require_bipeds(
            batch_episodes(env, max(settings.population, NEIGHBOURS))
        )

    def row(self, scenario: Scenario) -> Row:
        """What comes of replaying the best attempt at a scenario; its sequence, and how fragile it is."""
        moment = moment_of_push(self._walker, self.rule, scenario)
        found: dict[str, Any] = {"attempts": 0, "period": None, "corrections": None, "neighbours": None}
        sequences = {}
        if moment is not None:
            answer = self.search(moment, scenario)
            rows = as_text(answer.corrections)
            found |= {"attempts": answer.attempts, "period": moment.period, "corrections": rows}
            if answer.recovered:
                found["neighbours"] = self.neighbours_recovered(moment, scenario, answer)
            sequences = {scenario.id: Sequence(moment.period, rows)}
        replay = SequencePolicy(*self._planner, sequences)
        return {**rollout(self.env, replay, scenario, CEILING).to_dict(), **found}

    def search(self, moment: Moment, scenario: Scenario) -> Answer:
        """Search until a generation has recovered, or the budget is spent.

        Of several attempts that recover, the answer is the one with the least corrections. The first attempt
        of all is none at all.
        """
        s, shape = self.settings, (self.settings.steps, GAIT_SIZE)
        begin = np.zeros(s.size), np.full(s.size, s.spread)
        rng = generator_of(s.seed, scenario)
        method = CrossEntropy(rng, *begin, s.population, s.elites, s.least_spread)
        best, most = np.zeros(shape, np.float32), -np.inf
        for generation in range(s.generations):
            candidates = method.ask()
            if generation == 0:
                candidates[0] = 0.0
            tried = candidates.reshape(-1, *shape)
            came = run_attempts(self._robots, self.rule, moment.snapshot, [scenario] * s.population, tried)
            recovered = np.flatnonzero([outcome.recovered for outcome in came.outcomes])
            if len(recovered):
                effort = np.square(candidates[recovered], dtype=np.float64).sum(axis=1)
                return Answer(tried[recovered[effort.argmin()]], True, (generation + 1) * s.population)
            if came.values.max() > most:
                best, most = tried[came.values.argmax()].copy(), came.values.max()
            method.tell(candidates, came.values)
        return Answer(best, False, s.budget)

    def neighbours_recovered(self, moment: Moment, scenario: Scenario, answer: Answer) -> int:
        """How many of NEIGHBOURS the same sequence recovers."""
        beside = neighbours(scenario)
        same = np.repeat(answer.corrections[None], len(beside), axis=0)
        came = run_attempts(self._robots, self.rule, moment.snapshot, beside, same)
        return sum(outcome.recovered for outcome in came.outcomes)


def generator_of(seed: int, scenario: Scenario) -> np.random.Generator:
    """Random numbers of a scenario's content and a seed alone."""
    content = hashlib.sha256(scenario.to_json().encode()).digest()
    return np.random.default_rng(np.random.SeedSequence([seed, int.from_bytes(content[:16], "big")]))


@lru_cache(maxsize=1)
def _searcher(env: gym.Env, settings: CeilingSettings) -> Searcher:
    return Searcher(env, settings)


def search_row(runner: Runner, job: SearchJob) -> Row:
    """The task of `parallel`: the row of one push."""
    settings, scenario = job
    return _searcher(runner.env_of(settings.policy), settings).row(scenario)
