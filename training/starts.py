"""Where episodes of training begin: at a reset, or at the moment of a push in an undisturbed walk.

Which pushes are worth training on: those that are neither always nor never recovered from.

Robots in the middle of undisturbed walks, which training puts back at the moment of a push.

Where episodes of training begin: at a reset, or at the moment of a push.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..controllers.model.observation import side_sign
from ..controllers.model.robot import Similarity
from ..controllers.policies.interface import Policy
from ..envs.episode.episodes import GaitEpisodes
from ..envs.scenario.distribution import PushDistribution
from ..envs.scenario.push import polar_push
from ..envs.scenario.scenario import Scenario
from ..envs.snapshot import RobotSnapshot

DIRECTIONS = 8  # bins of the angle
WIDTH = 20.0  # of a bin of impulses, of the biped [N s]
RATE = 0.05  # of the running mean of a bin
UNKNOWN = 0.5  # share that a bin begins with


class SuccessTable:
    """Running share p of recoveries by direction and impulse, and what follows for the pushes to come.

    A push is accepted with probability  floor + (1 - floor) 4 p (1 - p):  1 where half of its kind are
    recovered from, `floor` where all or none are.

    Args:
        largest: impulse [N s].
        floor: least probability, in (0, 1].
        width: of a bin of impulses [N s].
    """

    def __init__(self, largest: float, floor: float, width: float = WIDTH):
        self.floor, self.width = floor, width
        self.shares = np.full((DIRECTIONS, max(1, math.ceil(largest / width))), UNKNOWN)

    def bin_of(self, psi: float, impulse: float) -> tuple[int, int]:
        """Bin of a direction [rad], counter-clockwise from forward, and an impulse [N s]."""
        turned = psi / math.tau % 1.0
        return min(int(turned * DIRECTIONS), DIRECTIONS - 1), min(
            int(impulse / self.width), self.shares.shape[1] - 1
        )

    def probability(self, place: tuple[int, int]) -> float:
        """Of accepting a push of a bin."""
        share = float(self.shares[place])
        return self.floor + (1.0 - self.floor) * 4.0 * share * (1.0 - share)

    def tell(self, place: tuple[int, int], recovered: bool) -> None:
        """What came of a push of a bin."""
        self.shares[place] += RATE * (float(recovered) - self.shares[place])


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


STANCE, HEADING, STEPS = "gait.stance", "gait.heading", "gait.steps"  # rows of a snapshot


class Starts(Protocol):
    """Begins episodes, and is told of their ends."""

    def begin(self, k: int) -> None:
        """Begin an episode with robot k."""
        ...

    def ended(self, k: int, recovered: bool) -> None:
        """The episode of robot k has ended."""
        ...


class ChosenStarts:
    """Episodes whose pushes are chosen by the success on their kind, one `SuccessTable` for each body.

    A share of them is drawn from other, easy pushes instead, so that nothing that is easy is forgotten.

    Args:
        episodes: of n robots.
        pushes: of most episodes.
        easy: of the others.
        easy_share: in [0, 1].
        floor: least probability of taking a push.
        rng: of the draws.
    """

    def __init__(
        self,
        episodes: GaitEpisodes,
        pushes: PushDistribution,
        easy: PushDistribution,
        easy_share: float,
        floor: float,
        rng: np.random.Generator,
    ):
        self._episodes, self._rng = episodes, rng
        self._pushes, self._easy, self._easy_share = pushes, easy, easy_share
        width = WIDTH * Similarity.of(episodes.robot).impulse
        self.tables = {body: SuccessTable(pushes.impulse_max, floor, width) for body in pushes.bodies}
        self._bins: list[tuple[str, tuple[int, int]] | None] = [None] * episodes.n  # body, bin of its table

    def ended(self, k: int, recovered: bool) -> None:
        """Count the end of a push that is not an easy one."""
        if (found := self._bins[k]) is not None:
            body, place = found
            self.tables[body].tell(place, recovered)

    def _is_easy(self, k: int) -> bool:
        """Whether robot k gets an easy push, whose end does not count."""
        self._bins[k] = None
        return self._rng.random() < self._easy_share

    def _takes(self, k: int, body: str, psi: float, impulse: float) -> bool:
        """Whether robot k gets this push, direction [rad] and impulse [N s]; its end counts then."""
        place = self.tables[body].bin_of(psi, impulse)
        self._bins[k] = body, place
        return self._rng.random() < self.tables[body].probability(place)


class ResetStarts(ChosenStarts):
    """Episodes from the beginning of a nominal step on, with a push to come; arguments of `ChosenStarts`.

    The direction of a kind is that in the world, since nobody knows yet which step will be pushed in.
    """

    def begin(self, k: int) -> None:
        """Begin a scenario that is drawn."""
        if self._is_easy(k):
            self._episodes.begin(k, self._episodes.drawn(self._easy, self._rng))
            return
        while True:
            scenario = self._episodes.drawn(self._pushes, self._rng)
            first, impulse = scenario.pushes[0], math.hypot(*(p.impulse_magnitude for p in scenario.pushes))
            if self._takes(k, first.body, first.direction, impulse):
                break
        self._episodes.begin(k, scenario)


class PushStarts(ChosenStarts):
    """Episodes from the moment of a push on: a walk is put back, and pushed within the period to come.

    Args:
        episodes: of n robots.
        walks: that are put back.
        chosen: the other arguments of `ChosenStarts`; of pushes impulse, direction, body, duration,
            number and settling time are drawn.
    """

    def __init__(self, episodes: GaitEpisodes, walks: list[RobotSnapshot], *chosen: Any):
        super().__init__(episodes, *chosen)
        self._walks = walks

    def begin(self, k: int) -> None:
        """Put robot k into a walk that is pushed."""
        walk = self._walk()
        if self._is_easy(k):
            self._put(k, walk, self._easy, *self._draw(self._easy))
            return
        while True:
            impulse, psi, body = self._draw(self._pushes)
            if self._takes(k, body, relative(psi, walk), impulse):
                break
            walk = self._walk()
        self._put(k, walk, self._pushes, impulse, psi, body)

    def _walk(self) -> RobotSnapshot:
        return self._walks[self._rng.integers(len(self._walks))]

    def _draw(self, pushes: PushDistribution) -> tuple[float, float, str]:
        """Impulse [N s], direction [rad] and body."""
        impulse = float(self._rng.uniform(pushes.impulse_min, pushes.impulse_max))
        psi = float(self._rng.uniform(pushes.direction_min, pushes.direction_max))
        return impulse, psi, pushes.body(self._rng)

    def _put(
        self, k: int, walk: RobotSnapshot, pushes: PushDistribution, impulse: float, psi: float, body: str
    ) -> None:
        start = walk.time + float(self._rng.random()) / self._episodes.control_hz
        duration, step = pushes.duration(self._rng), int(walk.rows[STEPS].item())
        first = polar_push(impulse / duration, psi, duration, start, body)
        drawn = pushes.with_later(first, walk.scenario, step, self._rng)
        scenario = replace(walk.scenario, pushes=drawn, duration=None, settle_time=pushes.settle_time)
        self._episodes.restore(k, walk, scenario)


def relative(psi: float, walk: RobotSnapshot) -> float:
    """A direction in the canonical frame of a walk, the right stance mirrored to the left one [rad]."""
    turned = side_sign(walk.rows[STANCE].item()) * (psi - walk.rows[HEADING].item())
    return math.remainder(turned, math.tau)
