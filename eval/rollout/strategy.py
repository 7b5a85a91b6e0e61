"""How a robot answers a push: its margin of stability; by ankles, hips or a step where it stands.

The margin of stability (Hof, Gazendam and Sinke 2005, The condition for dynamic stability, J. of Biomechanics
38, 1-8) is the distance of the extrapolated CoM, which is the DCM xi, from the border of the base of support:
one sole, or the hull of both. It is negative outside, where no CoP can hold the robot and a step has to come.

While both feet stand, xi' = omega (xi - z - (j / (m g)) theta''), so that with what the trunk has taken over

    eta = xi + (j / (m g)) (omega theta' + omega^2 theta) = int_0^inf omega exp(-omega s) (z + r) ds,

r = (j / (m g)) omega^2 theta, which is gone once the trunk is upright again. As long as eta lies in the hull
of both soles, the CoP alone can catch the robot: the ankle strategy. Beyond it the trunk was needed: the hip
strategy. Beyond what both catch together (`model/standing.py`) a step has to come; a sooner one is needless.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...controllers.array_table import Floats1
from ...controllers.jit import njit
from ...controllers.model.capturability import capture_constants, constants_of
from ...controllers.model.observation import (
    DCM,
    ELAPSED,
    STANCE_CONTACT,
    SWING_CONTACT,
    SWING_POSITION,
    TRUNK_ANGLE,
    TRUNK_RATE,
)
from ...controllers.model.standing import (
    CORNERS,
    HULL_COLUMNS,
    HULL_ROWS,
    NORMAL,
    OFFSET,
    standing_margin_kernel,
    write_hull,
)
from ...controllers.whole_body.swing import STAND
from ...envs.episode.episodes import GaitEpisodes

STRATEGIES = "ankle", "hip", "step"


@njit(cache=True)
def distance_to_segment(x, y, ax, ay, bx, by):  # pragma: no cover
    """Distance of a point (x, y) from the segment between (ax, ay) and (bx, by) [m]."""
    along_x, along_y = bx - ax, by - ay
    square = along_x * along_x + along_y * along_y
    share = ((x - ax) * along_x + (y - ay) * along_y) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(x - ax - share * along_x, y - ay - share * along_y)


@njit(cache=True)
def margin_of_stability(x, y, other_x, other_y, half_x, half_y, hull):  # pragma: no cover
    """Distance of a point from the border of the hull of two equal soles [m]; negative outside.

    Within, the nearest edge counts. Outside, the nearest point of the hull lies on the border, which is made
    of segments between corners, and no other such segment is nearer.

    Args:
        x: point, from the centre of one sole along its axes [m].
        y: likewise [m].
        other_x: centre of the other sole; 0, 0 where there is none [m].
        other_y: likewise [m].
        half_x: half the length of a sole [m].
        half_y: half its width [m].
        hull: (HULL_ROWS, HULL_COLUMNS), written.
    """
    write_hull(other_x, other_y, 0.0, half_x, half_y, hull)
    within, outside = np.inf, np.inf
    for e in range(HULL_ROWS):
        within = min(within, hull[e, OFFSET] - hull[e, NORMAL] * x - hull[e, NORMAL + 1] * y)
    if within >= 0.0:
        return within
    for i in range(CORNERS):
        for j in range(i):
            ax, ay = _corner(i, other_x, other_y, half_x, half_y)
            bx, by = _corner(j, other_x, other_y, half_x, half_y)
            outside = min(outside, distance_to_segment(x, y, ax, ay, bx, by))
    return -outside


@njit(cache=True)
def _corner(i, other_x, other_y, half_x, half_y):  # pragma: no cover
    """Corner i of two soles [m], the first four of that at the origin."""
    x, y = half_x if i % 4 < 2 else -half_x, half_y if i % 2 == 0 else -half_y
    return (x, y) if i < 4 else (other_x + x, other_y + y)


@njit(cache=True)
def take_in_stability(truth, half_x, half_y, smallest):  # pragma: no cover
    """Lower the smallest margins of stability (n,) to those of observations (n, 36) without noise [m].

    A robot in flight has no base of support and keeps its margin. The other sole counts as turned like the
    stance sole.
    """
    hull = np.empty((HULL_ROWS, HULL_COLUMNS))
    for k in range(len(truth)):
        seen = truth[k]
        if seen[STANCE_CONTACT] < 0.5 and seen[SWING_CONTACT] < 0.5:
            continue
        both = seen[STANCE_CONTACT] >= 0.5 and seen[SWING_CONTACT] >= 0.5
        on_other = seen[STANCE_CONTACT] < 0.5
        x, y = seen[DCM.start], seen[DCM.start + 1]
        other_x, other_y = seen[SWING_POSITION.start], seen[SWING_POSITION.start + 1]
        if on_other:
            x, y = x - other_x, y - other_y
        if not both:
            other_x, other_y = 0.0, 0.0
        margin = margin_of_stability(x, y, other_x, other_y, half_x, half_y, hull)
        if margin < smallest[k]:  # it may be no number
            smallest[k] = margin


class Stance(NamedTuple):
    """What n robots that are told to stand have done so far in their episodes."""

    soles: Floats1  # (n,) how far within the hull of both soles eta was, the least [m]; inf: never stood
    catchable: Floats1  # (n,) margin of what can be caught in place, when last seen standing [m], or NaN
    lift_off: Floats1  # (n,) the largest of these from which a step began [m]; -inf: none did


@njit(cache=True)
def _look(truth: Any, command: Any, s: Stance, first: int, end: int, constants: Any) -> None:
    """Take in robots first..end-1 from their observations (n, 36) without noise and commands (n, 4)."""
    c, hull = constants_of(constants), np.empty((HULL_ROWS, HULL_COLUMNS))
    for k in range(first, end):
        seen = truth[k]
        if command[k, STAND] == 0.0:
            s.catchable[k] = np.nan
        elif seen[ELAPSED] >= 0.0:
            if not math.isnan(s.catchable[k]):
                s.lift_off[k] = max(s.lift_off[k], s.catchable[k])
            s.catchable[k] = np.nan
        else:
            x, y = seen[DCM.start], seen[DCM.start + 1]
            other, lean, rate = SWING_POSITION.start, seen[TRUNK_ANGLE], seen[TRUNK_RATE]
            write_hull(seen[other], seen[other + 1], 0.0, c.cop_x_max, c.cop_y_max, hull)
            taken, within = c.trunk_gain * c.omega, np.inf
            eta_x = x + taken * (rate[0] + c.omega * lean[0])
            eta_y = y + taken * (rate[1] + c.omega * lean[1])
            for e in range(HULL_ROWS):
                within = min(within, hull[e, OFFSET] - hull[e, NORMAL] * eta_x - hull[e, NORMAL + 1] * eta_y)
            s.soles[k] = min(s.soles[k], within)
            s.catchable[k] = standing_margin_kernel(x, y, lean, rate, hull, constants)


class StrategyMeter:
    """Watches n robots that share a core, over the planning periods of their episodes, at the true state.

    Args:
        episodes: of the robots.
    """

    def __init__(self, episodes: GaitEpisodes):
        n = episodes.n
        self.stance = Stance(np.full(n, np.inf), np.full(n, np.nan), np.full(n, -np.inf))
        self._core: Any = episodes.core
        self._constants = capture_constants(episodes.robot, episodes.limits)

    def begin(self, k: int) -> None:
        """Forget robot k, which begins an episode."""
        self.stance.soles[k], self.stance.catchable[k], self.stance.lift_off[k] = np.inf, np.nan, -np.inf
        self._see(k, k + 1)

    def look(self) -> None:
        """Take in the period that has ended, for all robots."""
        self._see(0, len(self.stance.soles))

    def strategy(self, k: int) -> str | None:
        """The strategy of robot k so far, one of STRATEGIES; None where it has never stood when told to."""
        soles, lift_off = self.stance.soles.item(k), self.stance.lift_off.item(k)
        return strategy_of(None if math.isinf(soles) else soles, None if math.isinf(lift_off) else lift_off)

    def _see(self, first: int, end: int) -> None:
        _look(self._core.truth, self._core.command, self.stance, first, end, self._constants)


def strategy_of(soles_margin: float | None, lift_off_margin: float | None) -> str | None:
    """The strategy that an episode's measures mean.

    Args:
        soles_margin: how far within the hull of both soles eta was, the least [m]; None: never stood.
        lift_off_margin: what was left of the margin in place when a foot lifted [m]; None: none did.
    """
    if soles_margin is None:
        return None
    return "step" if lift_off_margin is not None else "ankle" if soles_margin >= 0.0 else "hip"
