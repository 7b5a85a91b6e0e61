"""Hindsight search: an answer to one push, found on many copies of the robot, each under its own corrections.

It begins in the last planning period before the push, and its row is the same whoever searches and whatever
runs beside it. An answer is a sequence of corrections that a rollout of its own replays.
"""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count, product
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np

from ..controllers.errors import InvalidValueError, UnknownNameError, shown
from ..controllers.model.gait_box import GAIT_SIZE
from ..controllers.settings import VARIANTS
from ..controllers.validation import require_integer
from ..envs.biped.env import BipedEpisodes
from ..envs.scenario.push import Push
from ..envs.scenario.scenario import Scenario
from ..envs.snapshot import RobotSnapshot
from .rollout.episodes import Ints, Observer, Slots, batch_episodes, rollout, run_episodes
from .rollout.outcome import Outcome
from .rollout.workers import Runner
from .search import Actions, CrossEntropy, Progress, SearchSettings, SequenceRule, as_text, begun, worth


@dataclass(frozen=True)
class CeilingSettings(SearchSettings):
    """Settings of one hindsight search; its first step is the pushed one.

    Raises:
        UnknownNameError: no analytic policy of that name.
        InvalidValueError: another field that is impossible.
    """

    most_generations: ClassVar[int] = 100_000

    generations: int = 20  # at most: with the population, the budget of a push
    policy: str = "two-stage"  # that is corrected, by name

    def __post_init__(self) -> None:
        if self.policy not in VARIANTS:
            raise UnknownNameError("policy", self.policy, VARIANTS)
        super().__post_init__()

    @property
    def budget(self) -> int:
        """Attempts at most, for one push."""
        return self.population * self.generations


def require_bipeds(episodes: object) -> BipedEpisodes:
    """The same episodes; raises InvalidValueError where their robots can't be put back."""
    if not isinstance(episodes, BipedEpisodes):
        raise InvalidValueError(
            "a ceiling is searched for on bipeds under plain gait actions, such as PushRecovery/Biped-v0"
        )
    return episodes


def moment_of_push(
    episodes: BipedEpisodes, rule: SequenceRule, scenario: Scenario
) -> tuple[RobotSnapshot, int] | None:
    """Walk to the first push with robot 0 under the planner alone.

    Returns:
        Snapshot at the begin of the planning period in which the push begins, and the number of periods
        before it; None where no push begins before the end.
    """
    episodes.begin(0, scenario)
    progress, starts = begun(NO_CORRECTIONS), episodes.core.pushes
    for period in count():
        snapshot = episodes.state_snapshot(0)
        actions, progress = rule.act(episodes.core.observation[:1], progress)
        ends = episodes.step(actions)
        if starts.start[0].min() < episodes.core.gait.time[0]:
            return snapshot, period
        if ends.failed[0] or ends.truncated[0]:
            return None
    return None


FORCES = (-0.02, -0.01, 0.0, 0.01, 0.02)  # change of the force, as a share of it
TURNS = (-2.0, -1.0, 0.0, 1.0, 2.0)  # of its direction about the vertical, counter-clockwise [deg]
NEIGHBOURS = len(FORCES) * len(TURNS) - 1


def neighbours(scenario: Scenario) -> list[Scenario]:
    """The scenario with all its pushes changed alike, for each change of force and direction but none."""
    changes = [change for change in product(FORCES, TURNS) if change != (0.0, 0.0)]
    return [
        replace(
            scenario,
            id=f"{scenario.id}/{force:+.0%}{turn:+.0f}deg",
            pushes=tuple(changed(push, 1.0 + force, math.radians(turn)) for push in scenario.pushes),
        )
        for force, turn in changes
    ]


def changed(push: Push, factor: float, turn: float) -> Push:
    """A push whose force is `factor` times as large and turned by `turn` [rad]."""
    (x, y, z), cos, sin = push.force, math.cos(turn), math.sin(turn)
    return replace(push, force=(factor * (cos * x - sin * y), factor * (sin * x + cos * y), factor * z))


LONGEST = 10**9  # planning periods before a sequence
NO_CORRECTIONS = np.zeros((1, 0, GAIT_SIZE), np.float32)


@dataclass(frozen=True)
class Sequence:
    """An answer to one push."""

    period: int  # number of planning periods before the first correction
    corrections: list[list[float]]  # (steps, 7) in [-1, 1]

    def __post_init__(self) -> None:
        require_integer("the period of a sequence", self.period, 0, LONGEST)
        try:
            values = np.array(self.corrections, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):  # ragged, or no numbers
            values = np.empty(0)
        if values.ndim != 2 or values.shape[-1] != GAIT_SIZE or not (np.abs(values) <= 1.0).all():
            raise InvalidValueError(
                f"a sequence has rows of {GAIT_SIZE} numbers in [-1, 1], got {shown(self.corrections)}"
            )


class SequencePolicy:
    """Replays sequences by scenario id, for one robot in the ordinary rollout; a planner where it has none.

    A rollout hands it the scenario that begins (`begin_scenario`).

    Args:
        rule: adds corrections to the planner.
        sequences: by scenario id.
    """

    def __init__(self, rule: SequenceRule, sequences: Mapping[str, Sequence]):
        self._rule, self.sequences = rule, dict(sequences)
        self._sequence: Sequence | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return SequencePolicy, (self._rule, self.sequences)

    def begin_scenario(self, scenario: Scenario) -> None:
        """Take the sequence of the episode to come."""
        self._sequence = self.sequences.get(scenario.id)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Progress]:
        """Action (7,) for one observation (36,), and the progress to hand in next time."""
        if state is not None and not (episode_start is not None and np.any(episode_start)):
            progress = Progress(*state)
        elif self._sequence is None:
            progress = begun(NO_CORRECTIONS)
        else:
            progress = begun(np.array([self._sequence.corrections], np.float32), self._sequence.period)
        actions, progress = self._rule.act(np.asarray(observation, np.float64)[None], progress)
        return actions[0], progress


RECOVERED = 1e3  # value of a recovery: above that of everything else


class Attempts(NamedTuple):
    """Results of n attempts, in their order."""

    outcomes: list[Outcome]  # times since reset; steps and reward since the snapshot
    values: np.ndarray  # (n,) see `run_attempts`


class _Standing(Observer):
    """Value of each robot's attempt so far: the integral of `worth` over the time that it stands [m s]."""

    def __init__(self, n: int):
        self.values = np.zeros(n)

    def begin(self, robots: Slots, k: int, scenario: Scenario) -> None:
        pass  # nothing is worth anything yet

    def after_step(self, robots: Slots, rows: Ints) -> None:
        episodes = robots.episodes
        standing = rows[episodes.failure()[rows] == 0]
        self.values[standing] += worth(episodes.core.margin[standing]) / episodes.control_hz


@dataclass(frozen=True)
class _Attempt:
    """Policy of robots that begin at the moment of a push: corrections (n, steps, 7) in their order."""

    rule: SequenceRule
    corrections: Actions

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Progress]:
        progress = begun(self.corrections) if state is None else Progress(*state)
        return self.rule.act(observation, progress)


def run_attempts(
    episodes: BipedEpisodes,
    rule: SequenceRule,
    snapshot: RobotSnapshot,
    scenarios: list[Scenario],
    corrections: Actions,
) -> Attempts:
    """Run attempts to their ends, each on a robot that begins where another one was when it was pushed.

    The value of an attempt is  int worth(m) dt  over the time that the robot stands, m its capture margin:
    the longer it stands and the nearer it stays to what can be captured, the more [m s]; RECOVERED more where
    it has recovered.

    Args:
        episodes: of as many robots as there are attempts, or more; what they held before is lost.
        rule: how corrections are added.
        snapshot: where all begin.
        scenarios: of each attempt, which goes on from there.
        corrections: (n, steps, 7) in [-1, 1].
    """
    slots = Slots(episodes, enter=lambda k, scenario: episodes.restore(k, snapshot, scenario))
    standing = _Standing(episodes.n)
    found = dict(run_episodes(slots, _Attempt(rule, corrections), scenarios, "attempt", standing))
    outcomes = [found[number] for number in range(len(scenarios))]
    recovered = np.array([outcome.recovered for outcome in outcomes])
    return Attempts(outcomes, standing.values[: len(scenarios)] + RECOVERED * recovered)


CEILING = "ceiling"  # label of the rows
Row = dict[str, Any]


class Searcher:
    """Robots and planner of one single environment, for one search after the other."""

    def __init__(self, env: gym.Env, settings: CeilingSettings):
        self.env, self.settings = env, settings
        self.rule = SequenceRule.of(env, settings.policy, settings.scale)
        self._walker, self._robots = (
            require_bipeds(batch_episodes(env, n)) for n in (1, max(settings.population, NEIGHBOURS))
        )

    def row(self, scenario: Scenario) -> Row:
        """The row of replaying the best attempt at a scenario; its sequence, and how fragile it is."""
        moment = moment_of_push(self._walker, self.rule, scenario)
        attempts, period, rows, robust, sequences = 0, None, None, None, {}
        if moment is not None:
            snapshot, period = moment
            best, recovered, attempts = self.search(snapshot, scenario)
            rows = as_text(best)
            robust = self.neighbours_recovered(snapshot, scenario, best) if recovered else None
            sequences = {scenario.id: Sequence(period, rows)}
        found = {"attempts": attempts, "period": period, "corrections": rows, "neighbours": robust}
        replay = SequencePolicy(self.rule, sequences)
        return {**rollout(self.env, replay, scenario, CEILING).to_dict(), **found}

    def search(self, snapshot: RobotSnapshot, scenario: Scenario) -> tuple[Actions, bool, int]:
        """Search until a generation has recovered, or the budget is spent.

        Of several attempts that recover, the answer is the one with the least corrections. The first attempt
        of all is none at all.

        Returns:
            Corrections (steps, 7) of the best attempt, whether it recovered, and the number of attempts.
        """
        s, shape = self.settings, (self.settings.steps, GAIT_SIZE)
        method = CrossEntropy(generator_of(s.seed, scenario), np.zeros(s.size), np.full(s.size, s.spread), s)
        best, most = np.zeros(shape, np.float32), -np.inf
        for generation in range(s.generations):
            candidates = method.ask()
            if generation == 0:
                candidates[0] = 0.0
            tried = candidates.reshape(-1, *shape)
            found = run_attempts(self._robots, self.rule, snapshot, [scenario] * s.population, tried)
            recovered = np.flatnonzero([outcome.recovered for outcome in found.outcomes])
            if len(recovered):
                effort = np.square(candidates[recovered], dtype=np.float64).sum(axis=1)
                return tried[recovered[effort.argmin()]], True, (generation + 1) * s.population
            if found.values.max() > most:
                best, most = tried[found.values.argmax()].copy(), found.values.max()
            method.tell(candidates, found.values)
        return best, False, s.budget

    def neighbours_recovered(self, snapshot: RobotSnapshot, scenario: Scenario, corrections: Actions) -> int:
        """How many of NEIGHBOURS the same corrections (steps, 7) recover."""
        beside = neighbours(scenario)
        same = np.repeat(corrections[None], len(beside), axis=0)
        found = run_attempts(self._robots, self.rule, snapshot, beside, same)
        return sum(outcome.recovered for outcome in found.outcomes)


def generator_of(seed: int, scenario: Scenario) -> np.random.Generator:
    """Random numbers of a scenario's content and a seed alone."""
    content = hashlib.sha256(scenario.to_json().encode()).digest()
    return np.random.default_rng(np.random.SeedSequence([seed, int.from_bytes(content[:16], "big")]))


_searcher = lru_cache(maxsize=1)(Searcher)


def search_row(runner: Runner, job: tuple[CeilingSettings, Scenario]) -> Row:
    """The task of `parallel`: the row of one push."""
    settings, scenario = job
    return _searcher(runner.acting(settings.policy).env, settings).row(scenario)
