"""Rewards of training, by name.

To add one, write a class like these and give it a name in `REWARDS`. Where it is a worth of every planning
period, a subclass of `EnvironmentReward` with its own `worth` is all.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..envs.episode.episodes import GaitEpisodes, Period
from ..envs.episode.recovery import OFFSET_TOLERANCE, SPEED_TOLERANCE

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

FALL, RECOVERED, STANDING = -1.0, 1.0, 0.3  # worth of an end
MARGINS = (-0.3, 0.05)  # capture margins beyond which less or more is worth the same [m]
PER_METRE = 2.0  # of capture margin
STEP = 20.0  # worth of a step as it should be, about a fifth of what its periods are worth


class Reward(Protocol):
    """Sum of what a learned action is worth to each of n robots."""

    bootstraps: bool  # whether what would follow counts where the time is up

    def begin(self, rows: Ints) -> None:
        """The robots `rows` begin an episode where they are."""
        ...

    def period(self, period: Period, live: Mask, gate_closed: Mask) -> Mask:
        """Count a planning period of the robots `live` (n,); returns those whose episode ends with it.

        Args:
            period: its result.
            live: (n,) that are in their episode.
            gate_closed: (n,) on which nothing that is learned acts.
        """
        ...

    def collect(self, over: Mask) -> Array:
        """Worth of the action (n,); the episodes `over` (n,) have ended with it."""
        ...


class EnvironmentReward:
    """The worth of each planning period, summed over those of an action: the environment's own reward.

    Args:
        episodes: of n robots.
        gamma: discount per learned action.
    """

    bootstraps = True

    def __init__(self, episodes: GaitEpisodes, gamma: float):
        self.episodes, self._sum = episodes, np.zeros(episodes.n)

    def worth(self, period: Period) -> Array:
        """Worth of a period (n,)."""
        return period.reward.total

    def begin(self, rows: Ints) -> None:
        """Nothing is remembered of before."""

    def period(self, period: Period, live: Mask, gate_closed: Mask) -> Mask:
        """Add it; the episode ends where the environment says so."""
        self._sum[live] += self.worth(period)[live]
        return live & (period.failed | period.truncated)

    def collect(self, over: Mask) -> Array:
        """The sum."""
        total = self._sum.copy()
        self._sum[:] = 0.0
        return total


class StepReward(EnvironmentReward):
    """The environment's own reward, and each touchdown by the two errors that recovery is judged by.

    A touchdown earns  20 exp(-(e / 0.05 m)^2 - (w / 0.15 m/s)^2)  besides, where e is the error of the DCM at
    the start of the step, w that of the mean velocity over two steps, and the lengths are the tolerances of
    `envs/episode/recovery.py`.
    """

    def __init__(self, episodes: GaitEpisodes, gamma: float):
        super().__init__(episodes, gamma)
        self._touchdowns = np.zeros(episodes.n, np.int64)

    def begin(self, rows: Ints) -> None:
        """Touchdowns of before count no more."""
        self._touchdowns[rows] = self.episodes.monitor.state.touchdowns[rows]

    def worth(self, period: Period) -> Array:
        """Worth of a period (n,)."""
        state = self.episodes.monitor.state
        landed, self._touchdowns = state.touchdowns > self._touchdowns, state.touchdowns.copy()
        errors = state.error[:, 0] / OFFSET_TOLERANCE, state.speed_error / SPEED_TOLERANCE
        return period.reward.total + np.where(landed, STEP * np.exp(-np.square(errors).sum(axis=0)), 0.0)


class RecoveryReward:
    """-1 for a fall, 1 for a recovery, 0.3 for standing at the end, and the capture margin as a potential.

    With m the margin and  phi = 2 clip(m, -0.3 m, 0.05 m),  0 at an end, an action earns
    gamma phi' - phi  besides, gamma the discount per learned action, which leaves the best policy what it is
    (Ng, Harada & Russell 1999). An episode is over as soon as the robot has recovered, judged at a touchdown
    since its begin, and its gate is closed.
    """

    bootstraps = False

    def __init__(self, episodes: GaitEpisodes, gamma: float):
        self._episodes, self._gamma = episodes, gamma
        self._sum, self._potential = np.zeros(episodes.n), np.zeros(episodes.n)
        self._begun = np.zeros(episodes.n)  # since reset [s]

    def begin(self, rows: Ints) -> None:
        """Remember the time and the potentials."""
        self._begun[rows] = self._episodes.motion().time[rows]
        self._potential[rows] = self._now()[rows]

    def period(self, period: Period, live: Mask, gate_closed: Mask) -> Mask:
        """Reward the ends."""
        recovered = self._episodes.monitor.state.recovered_at > self._begun  # NaN: it has not
        over = live & (period.failed | period.truncated | (recovered & gate_closed))
        worth = np.where(period.failed, FALL, np.where(recovered, RECOVERED, STANDING))
        self._sum[over] += worth[over]
        return over

    def collect(self, over: Mask) -> Array:
        """The ends, and the change of the potential."""
        potential = np.where(over, 0.0, self._now())
        total = self._sum + self._gamma * potential - self._potential
        self._sum[:], self._potential = 0.0, potential
        return total

    def _now(self) -> Array:
        return PER_METRE * np.clip(self._episodes.core.margin, *MARGINS)


REWARDS: dict[str, Callable[[GaitEpisodes, float], Reward]] = {
    "recovery": RecoveryReward,
    "environment": EnvironmentReward,
    "steps": StepReward,
}
