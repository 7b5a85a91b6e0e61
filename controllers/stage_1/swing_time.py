"""How long the swing foot needs to a place, under a bound of its acceleration."""

from __future__ import annotations

import math

from ..compiled.kernels import njit
from ..model.observation import SWING_POSITION, SWING_VELOCITY

_SWING, _SPEED = SWING_POSITION.start, SWING_VELOCITY.start


@njit(cache=True)
def swing_time(distance, speed, acceleration):  # pragma: no cover
    """Time [s] in which a foot with a speed [m/s] towards its target can come to rest there.

    Accelerating and braking with a: (2 sqrt(a d + v^2 / 2) - v) / a. With a = 4 sqrt(3) / 10 of the bound
    it is the time of the rest-to-rest quintic whose peak acceleration, 10 d / (sqrt(3) t^2), is that bound,
    and half-way along it, too, to 0.1 %.
    """
    a = 0.4 * math.sqrt(3.0) * acceleration
    return max((2.0 * math.sqrt(a * distance + 0.5 * speed * speed) - speed) / a, 0.0)


@njit(cache=True)
def time_to_place(obs, x, y, acceleration):  # pragma: no cover
    """`swing_time` [s] of the observed swing foot to (x, y), canonical frame [m]."""
    dx, dy = x - obs[_SWING], y - obs[_SWING + 1]
    distance = math.hypot(dx, dy)
    speed = (dx * obs[_SPEED] + dy * obs[_SPEED + 1]) / max(distance, 1e-9)
    return swing_time(distance, speed, acceleration)
