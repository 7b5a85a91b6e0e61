"""Where episodes of training begin: at a reset, or at the moment of a push in an undisturbed walk.

Pushes are chosen by the success on their kind: most are neither always nor never recovered from.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import defaultdict, deque
from dataclasses import dataclass, field, replace

import numpy as np

from ..controllers.model.observation import side_sign
from ..controllers.model.robot import Similarity
from ..controllers.policies.interface import Policy
from ..envs.episode.episodes import GaitEpisodes
from ..envs.scenario.distribution import PushDistribution, ScenarioDistribution
from ..envs.scenario.push import GaitEvent, Push, polar_push
from ..envs.scenario.scenario import Scenario
from ..envs.snapshot import RobotSnapshot
from ..eval.score.draw import count_of
from ..eval.score.kinds import SuiteDistribution

DIRECTIONS = 8  # bins of the angle
WIDTH = 20.0  # of a bin of impulses, of the biped [N s]
RATE = 0.05  # of the running mean of a bin
UNKNOWN = 0.5  # share that a bin begins with
EARLIEST, LATEST = 1.2, 3.6  # of a snapshot since reset: at least three steps, and two of them on [s]
LONG = 60.0  # of a scenario without pushes, which no walk reaches the end of [s]
STANCE, HEADING, STEPS = "gait.stance", "gait.heading", "gait.steps"  # rows of a snapshot
Bin = tuple[int, int]  # of direction, of impulse
Start = tuple[RobotSnapshot | None, Scenario]  # a walk that is put back, or none, and what comes then


class SuccessTable:
    """Running share p of recoveries by direction and impulse, and the probability of taking such a push.

    A push is accepted with probability  floor + (1 - floor) 4 p (1 - p):  1 where half of its kind are
    recovered from, `floor` where all or none are. The `largest` impulse and the `width` of a bin are in N s.
    """

    def __init__(self, largest: float, floor: float, width: float = WIDTH):
        self.floor, self.width = floor, width
        self.shares = np.full((DIRECTIONS, max(1, math.ceil(largest / width))), UNKNOWN)

    def bin_of(self, psi: float, impulse: float) -> Bin:
        """Bin of a direction [rad], counter-clockwise from forward, and an impulse [N s]."""
        direction = int(psi / math.tau % 1.0 * DIRECTIONS)
        size = int(impulse / self.width)
        return min(direction, DIRECTIONS - 1), min(size, self.shares.shape[1] - 1)

    def probability(self, kind: Bin) -> float:
        """Probability of accepting a push of a bin."""
        share = float(self.shares[kind])
        return self.floor + (1.0 - self.floor) * 4.0 * share * (1.0 - share)

    def update(self, kind: Bin, recovered: bool) -> None:
        """Count a push of a bin that was recovered from, or was not."""
        self.shares[kind] += RATE * (float(recovered) - self.shares[kind])


def take_walks(
    episodes: GaitEpisodes,
    planner: Policy,
    pushes: ScenarioDistribution,
    count: int,
    rng: np.random.Generator,
) -> list[RobotSnapshot]:
    """Snapshots of `count` walks under a planner, each of another robot and command, at a random moment.

    A walk that falls is not taken, and what the episodes held before is lost. Of `pushes` only commands and
    model errors are drawn. The planner remembers nothing.
    """
    n, due, taken = episodes.n, np.zeros(episodes.n), []

    def begin(k: int) -> None:
        episodes.begin(k, replace(episodes.drawn(pushes, rng), pushes=(), duration=LONG))
        due[k] = rng.uniform(EARLIEST, LATEST)

    for k in range(n):
        begin(k)
    while len(taken) < count:
        failed = episodes.walk(planner).failed
        arrived = ~failed & (episodes.motion().time >= due)
        for k in np.flatnonzero(failed | arrived).tolist():
            if arrived[k]:
                taken.append(episodes.state_snapshot(k))
            begin(k)
    return taken[:count]


@dataclass
class Starts(ABC):
    """Begins episodes whose pushes are chosen by the success on their kind, a `SuccessTable` for each.

    A kind is a body, and where pushes are `like` those of suites a body and how often it is pushed. What is
    lost comes again `retries` times, so that a push that is lost with probability q has 1 + retries q times
    its share of the episodes.

    A share of them is drawn from other, easy pushes instead, so that nothing that is easy is forgotten.
    """

    episodes: GaitEpisodes  # of n robots
    pushes: PushDistribution  # of most episodes
    easy: PushDistribution  # of the others
    easy_share: float  # in [0, 1]
    floor: float  # least probability of taking a push
    rng: np.random.Generator
    like: SuiteDistribution | None = field(default=None, kw_only=True)  # of most, in place of `pushes`
    retries: int = field(default=0, kw_only=True)

    def __post_init__(self) -> None:
        width = WIDTH * Similarity.of(self.episodes.robot).impulse
        largest = self.pushes.impulse_max
        self.tables = defaultdict[str, SuccessTable](lambda: SuccessTable(largest, self.floor, width))
        self._bins: list[tuple[str, Bin] | None] = [None] * self.episodes.n  # kind, bin of its table
        self._begun: list[Start | None] = [None] * self.episodes.n
        self._again: deque[Start] = deque()

    def begin(self, k: int) -> None:
        """Begin an episode with robot k: one that was lost, or a new one."""
        if self._again:
            self._bins[k], (walk, scenario) = None, self._again.popleft()
        else:
            self._begun[k] = walk, scenario = self._new(k)
        if walk is None:
            self.episodes.begin(k, scenario)
        else:
            self.episodes.restore(k, walk, scenario)

    @abstractmethod
    def _new(self, k: int) -> Start:
        """Draw an episode for robot k."""

    def ended(self, k: int, recovered: bool) -> None:
        """Count the end of the episode of robot k where its push is new and not an easy one."""
        if (found := self._bins[k]) is not None:
            kind, place = found
            self.tables[kind].update(place, recovered)
            begun = self._begun[k]
            if not recovered and begun is not None:
                self._again.extend([begun] * self.retries)

    def _is_easy(self, k: int) -> bool:
        """Whether robot k gets an easy push, whose end does not count."""
        self._bins[k] = None
        return self.rng.random() < self.easy_share

    def _takes(self, k: int, kind: str, psi: float, impulse: float) -> bool:
        """Whether robot k gets this push, direction [rad] and impulse [N s]; its end counts then."""
        place = self.tables[kind].bin_of(psi, impulse)
        self._bins[k] = kind, place
        return self.rng.random() < self.tables[kind].probability(place)

    def _kind(self, scenario: Scenario) -> str:
        """The kind of a scenario's pushes."""
        body = scenario.pushes[0].body
        return body if self.like is None else f"{body} {count_of(scenario)}"


@dataclass
class ResetStarts(Starts):
    """Episodes from the beginning of a nominal step on, with a push to come.

    The direction of a kind is that in the world, since nobody knows yet which step will be pushed in.
    """

    def _new(self, k: int) -> Start:
        """Draw a scenario."""
        if self._is_easy(k):
            return None, self.episodes.drawn(self.easy, self.rng)
        while True:
            scenario = self.episodes.drawn(self.like or self.pushes, self.rng)
            if self._takes(k, self._kind(scenario), scenario.pushes[0].direction, total_impulse(scenario)):
                return None, scenario


@dataclass
class PushStarts(Starts):
    """Episodes from the moment of a push on: a walk is put back, and pushed within the period to come.

    Of the pushes impulse, direction, body, duration, number and settling time are drawn.
    """

    walks: list[RobotSnapshot]  # that are put back

    def _new(self, k: int) -> Start:
        """Draw a walk and its pushes."""
        walk = self._walk()
        if self._is_easy(k):
            return self._pushed(walk, self.easy, *self._draw(self.easy))
        if self.like is not None:
            return self._pushed_like(k, walk, self.like)
        while True:
            impulse, psi, body = self._draw(self.pushes)
            if self._takes(k, body, relative(psi, walk), impulse):
                return self._pushed(walk, self.pushes, impulse, psi, body)
            walk = self._walk()

    def _pushed_like(self, k: int, walk: RobotSnapshot, like: SuiteDistribution) -> Start:
        """A walk that is pushed as a scenario says whose first push comes now."""
        while True:
            drawn = like.sample(self.rng)
            if self._takes(k, self._kind(drawn), relative_push(drawn.pushes[0], walk), total_impulse(drawn)):
                break
            walk = self._walk()
        start = self._soon(walk)
        pushes = pushes_from(drawn, walk, start)
        return walk, replace(walk.scenario, pushes=pushes, duration=None, settle_time=drawn.settle_time)

    def _soon(self, walk: RobotSnapshot) -> float:
        """A moment within the period to come [s]."""
        return walk.time + float(self.rng.random()) / self.episodes.control_hz

    def _walk(self) -> RobotSnapshot:
        return self.walks[self.rng.integers(len(self.walks))]

    def _draw(self, pushes: PushDistribution) -> tuple[float, float, str]:
        """Impulse [N s], direction [rad] and body."""
        impulse = float(self.rng.uniform(pushes.impulse_min, pushes.impulse_max))
        psi = float(self.rng.uniform(pushes.direction_min, pushes.direction_max))
        return impulse, psi, pushes.body(self.rng)

    def _pushed(
        self, walk: RobotSnapshot, pushes: PushDistribution, impulse: float, psi: float, body: str
    ) -> Start:
        """A walk that is pushed within the period to come."""
        start = self._soon(walk)
        duration, step = pushes.duration(self.rng), int(walk.rows[STEPS].item())
        first = polar_push(impulse / duration, psi, duration, start, body)
        drawn = pushes.with_later(first, walk.scenario, step, self.rng)
        return walk, replace(walk.scenario, pushes=drawn, duration=None, settle_time=pushes.settle_time)


def relative(psi: float, walk: RobotSnapshot) -> float:
    """A direction [rad] in the canonical frame of a walk: of its heading, and mirrored on the left foot."""
    turned = side_sign(walk.rows[STANCE].item()) * (psi - walk.rows[HEADING].item())
    return math.remainder(turned, math.tau)


def relative_push(push: Push, walk: RobotSnapshot) -> float:
    """Direction [rad] of a push in the canonical frame of a walk."""
    turned = walk.rows[HEADING].item() if push.frame == "heading" else 0.0
    return relative(push.direction + turned, walk)


def total_impulse(scenario: Scenario) -> float:
    """Root of the sum of the pushes' squared impulses [N s]: of the one push that does as much."""
    return math.hypot(*(push.impulse_magnitude for push in scenario.pushes))


def pushes_from(scenario: Scenario, walk: RobotSnapshot, start: float) -> tuple[Push, ...]:
    """The pushes of a scenario in a walk: the first at `start` [s], the others as long after it as there.

    Raises:
        ValueError: some pushes are at times, others at moments of the gait.
    """
    first, *later = scenario.pushes
    pushes = [replace(first, start=start)]
    for push in later:
        then, now = first.start, push.start
        if isinstance(now, GaitEvent) and isinstance(then, GaitEvent):
            passed = now.step_index(scenario.stance_side) - then.step_index(scenario.stance_side)
            index = int(walk.rows[STEPS].item()) + passed
            moved: float | GaitEvent = GaitEvent(index, walk.scenario.side_of_step(index), now.fraction)
        elif isinstance(now, GaitEvent) or isinstance(then, GaitEvent):
            raise ValueError(f"pushes of {scenario.id!r} are at times and at moments of the gait")
        else:
            moved = start + now - then
        pushes.append(replace(push, start=moved))
    return tuple(pushes)
