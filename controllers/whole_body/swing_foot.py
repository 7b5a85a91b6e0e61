"""Swing-foot trajectory, re-generated every cycle towards the adapted place and time.

Each axis follows a fifth-order polynomial from its present position, velocity and acceleration to the
target at the planned time, and is re-planned every cycle (Khadiv et al. 2016, section IV). Position,
velocity and acceleration are therefore continuous however place and time change: what jumps is the jerk.
Horizontally the foot arrives at rest shortly before touchdown; vertically it rises to an apex in mid-step
and then comes down to meet the floor at T. A foot that is late keeps descending at constant speed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..errors import InvalidValueError

VELOCITY, ACCELERATION = (
    3,
    6,
)  # where they begin in a state: position, velocity, acceleration, three axes each
ARRIVAL_LEAD = 0.010  # the foot is over its target this long before T [s]
SHORTEST = 0.030  # horizontal horizon is never shorter: a late change of target stays smooth [s]
APEX_PHASE = 0.45  # of T at which the foot is highest
LANDING_SPEED = 0.1  # downwards at T [m/s]
FASTEST_DESCENT = 2.0  # peak speed of the way down; where T asks for more, the foot is late [m/s]
DESCENT_LAG = 0.010  # time constant of the late descent [s]
_PEAK = 1.875  # peak speed of a rest-to-rest quintic over its mean speed


@njit(cache=True)
def quintic_step(p, v, a, target, velocity, horizon, dt):  # pragma: no cover
    """Position, velocity, acceleration after dt on the quintic to `target`, `velocity`, zero acceleration.

    p(s) = p + v s + a s^2/2 + c3 s^3 + c4 s^4 + c5 s^5, with c3..c5 from the three conditions at s = horizon.
    """
    r = horizon
    d0 = target - p - v * r - 0.5 * a * r * r
    d1 = (velocity - v - a * r) * r
    d2 = -a * r * r
    c3 = (10.0 * d0 - 4.0 * d1 + 0.5 * d2) / r**3
    c4 = (-15.0 * d0 + 7.0 * d1 - d2) / r**4
    c5 = (6.0 * d0 - 3.0 * d1 + 0.5 * d2) / r**5
    s = dt
    return (
        p + s * (v + s * (0.5 * a + s * (c3 + s * (c4 + s * c5)))),
        v + s * (a + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5))),
        a + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5)),
    )


@njit(cache=True)
def quintic_advance(state, axis, target, velocity, horizon, dt):  # pragma: no cover
    """`quintic_step` for one axis of `state` (9,), in place."""
    state[axis], state[VELOCITY + axis], state[ACCELERATION + axis] = quintic_step(
        state[axis], state[VELOCITY + axis], state[ACCELERATION + axis], target, velocity, horizon, dt
    )


@njit(cache=True)
def _descend(state, speed, dt):  # pragma: no cover
    """Vertical axis: velocity settles at -speed, critically damped, so that acceleration stays continuous.

    With e = v + speed: e(s) = (e + (a + e / lag) s) exp(-s / lag); position by its integral.
    """
    error, acceleration = state[VELOCITY + 2] + speed, state[ACCELERATION + 2]
    slope = acceleration + error / DESCENT_LAG
    decay = math.exp(-dt / DESCENT_LAG)
    lag = DESCENT_LAG
    travel = error * lag * (1.0 - decay) + slope * lag * (lag - (lag + dt) * decay)
    state[2] += travel - speed * dt
    state[VELOCITY + 2] = (error + slope * dt) * decay - speed
    state[ACCELERATION + 2] = (slope - (error + slope * dt) / lag) * decay


@njit(cache=True)
def swing_update(
    state: NDArray[np.float64],
    target_x: float,
    target_y: float,
    elapsed: float,
    duration: float,
    dt: float,
    apex: float,
    descent: float,
) -> None:
    """Advance the reference of one swing sole by dt, in place.

    Args:
        state: (9,) position x, y, z [m], velocity [m/s], acceleration [m/s^2]; z above the floor.
        target_x: where to land [m], in the axes of `state`.
        target_y: likewise [m].
        elapsed: time since the step began [s].
        duration: planned T, when the sole is to meet the floor [s].
        dt: cycle [s].
        apex: height in mid-step [m].
        descent: speed of a late foot [m/s].
    """
    remaining = duration - elapsed
    horizon = max(remaining - ARRIVAL_LEAD, SHORTEST, dt)
    quintic_advance(state, 0, target_x, 0.0, horizon, dt)
    quintic_advance(state, 1, target_y, 0.0, horizon, dt)
    top = APEX_PHASE * duration - elapsed
    if top > 0.5 * dt:
        quintic_advance(state, 2, apex, 0.0, max(top, SHORTEST, dt), dt)
    elif remaining > 0.5 * dt:
        slowest = _PEAK * max(state[2], 0.0) / FASTEST_DESCENT
        quintic_advance(state, 2, 0.0, -LANDING_SPEED, max(remaining, slowest, dt), dt)
    else:
        _descend(state, descent, dt)


@njit(cache=True)
def _swing_rows(states, targets, elapsed, duration, dt, apex, descent):  # pragma: no cover
    for i in range(states.shape[0]):
        swing_update(states[i], targets[i, 0], targets[i, 1], elapsed[i], duration[i], dt, apex, descent)


def swing_update_batch(
    states: NDArray[np.float64],
    targets: NDArray[np.float64],
    elapsed: NDArray[np.float64],
    duration: NDArray[np.float64],
    dt: float,
    apex: float = 0.06,
    descent: float = 0.3,
) -> None:
    """`swing_update` for n robots, in place: states (n, 9), targets (n, 2) [m], times (n,) [s]."""
    n = len(states)
    if states.shape != (n, 9) or targets.shape != (n, 2) or elapsed.shape != (n,) or duration.shape != (n,):
        raise InvalidValueError(
            "swing_update_batch needs states (n, 9), targets (n, 2), elapsed (n,), duration (n,), "
            f"got {states.shape}, {targets.shape}, {elapsed.shape}, {duration.shape}"
        )
    _swing_rows(states, targets, elapsed, duration, dt, apex, descent)
