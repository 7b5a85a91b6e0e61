"""The swing foot: its trajectory towards the adapted place and time, re-generated every cycle; turning.

Each axis follows a fifth-order polynomial from its present position, velocity and acceleration to the
target at the planned time, and is re-planned every cycle (Khadiv et al. 2016, section IV). Position,
velocity and acceleration are therefore continuous however place and time change: what jumps is the jerk.
Horizontally the foot arrives at rest shortly before touchdown; vertically it rises to an apex in mid-step
and then comes down to meet the floor at T. A foot that is late keeps descending at constant speed.

The swing sole lands turned by the commanded rate times T, and the pelvis goes along. Within a step the
heading, the canonical frame's x axis, stays: it is the stance sole's. The references are yaws beyond it. At
touchdown the heading advances by the yaw of the sole that lands; the pelvis, half-way between the soles by
then, turns on at the commanded rate. No reference jumps. A pelvis that has been twisted off its yaw turns the
next sole, too, where a robot gives way to it: a sole has little friction against yaw. While no turn is
commanded the steps after that turn back, by a bounded yaw each.
"""

from __future__ import annotations

import cmath
import math

from numpy.typing import NDArray

from ..jit import njit

VELOCITY, ACCELERATION = 3, 6  # where they begin in a state of position, velocity, acceleration
ARRIVAL_LEAD = 0.010  # the foot is over its target this long before T [s]
SHORTEST = 0.030  # horizontal horizon is never shorter: a late change of target stays smooth [s]
APEX_PHASE = 0.45  # of T at which the foot is highest
STEEP = 0.1  # rise of the floor [m] from which on the apex comes so much of T earlier, and a fall later
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
    error, lag = state[VELOCITY + 2] + speed, DESCENT_LAG
    slope = state[ACCELERATION + 2] + error / lag
    decay = math.exp(-dt / lag)
    travel = error * lag * (1.0 - decay) + slope * lag * (lag - (lag + dt) * decay)
    state[2] += travel - speed * dt
    state[VELOCITY + 2] = (error + slope * dt) * decay - speed
    state[ACCELERATION + 2] = (slope - (error + slope * dt) / lag) * decay


@njit(cache=True, forceinline=True)
def apex_phase_of(rise: float) -> float:
    """Share of T at which a foot is highest whose foothold is `rise` [m] higher than the floor it leaves.

    Up a step the toe has to be over the edge soon, and down a step the heel stays over it for long.
    """
    return APEX_PHASE - min(max(rise, -STEEP), STEEP)


@njit(cache=True)
def swing_update(
    state: NDArray, target_x: float, target_y: float, elapsed: float, duration: float, dt: float, apex: float,
    descent: float, apex_phase: float = APEX_PHASE,
) -> None:  # fmt: skip
    """Advance the reference of one swing sole by dt [s], in place.

    `state` (9,) is position x, y, z [m], velocity [m/s] and acceleration [m/s^2], z above the floor, and the
    target to land on is in its axes [m]. `elapsed` time since the step began and `duration` T, when the sole
    is to meet the floor [s]; `apex`, the greatest height, at `apex_phase` of T [m]; `descent`, the speed of a
    late foot [m/s].
    """
    remaining = duration - elapsed
    horizon = max(remaining - ARRIVAL_LEAD, SHORTEST, dt)
    quintic_advance(state, 0, target_x, 0.0, horizon, dt)
    quintic_advance(state, 1, target_y, 0.0, horizon, dt)
    top = apex_phase * duration - elapsed
    if top > 0.5 * dt:
        quintic_advance(state, 2, apex, 0.0, max(top, SHORTEST, dt), dt)
    elif remaining > 0.5 * dt:
        slowest = _PEAK * max(state[2], 0.0) / FASTEST_DESCENT
        quintic_advance(state, 2, 0.0, -LANDING_SPEED, max(remaining, slowest, dt), dt)
    else:
        _descend(state, descent, dt)


SIZE = 7  # swing sole: yaw, rate, acceleration; pelvis: the same; yaw at which the sole is to land
SWING, PELVIS_YAW, LANDING = 0, 3, 6
COMMAND_X, COMMAND_Y, TURN, STAND = range(4)  # columns of a command [m/s], [m/s], [rad/s], 1: stand
COMMAND_SIZE = 4
LARGEST_GIVEN = 0.8  # yaw by which a sole lands turned for a twisted pelvis [rad]


@njit(cache=True, forceinline=True)
def given_yaw(twist: float, most: float) -> float:
    """Yaw by which the next sole lands turned [rad] where the pelvis is `twist` off its yaw.

    sign(twist) min(max(|twist| - most, 0), LARGEST_GIVEN)
    """
    return math.copysign(min(max(abs(twist) - most, 0.0), LARGEST_GIVEN), twist)


@njit(cache=True, forceinline=True)
def yaw_back(astray: float, most: float) -> float:
    """Yaw by which the next sole turns back [rad] from being `astray`: -min(max(astray, -most), most)."""
    return -min(max(astray, -most), most)


@njit(cache=True, forceinline=True)
def turn_references(
    yaw: NDArray, rate: float, duration: float, remaining: float, final: float, given: float, dt: float
) -> None:
    """Advance the yaw references (7,) of one robot, beyond the heading, by dt [s], in place.

    `rate` is commanded [rad/s]; the sole lands after `duration`, and `remaining` is left until T [s]. From
    `final` before T on [s] the yaw at landing stays. `given` comes on top: `given_yaw` and `yaw_back` [rad].
    """
    if remaining >= final:
        yaw[LANDING] = rate * duration + given
    goal = yaw[LANDING]
    horizon = max(remaining - ARRIVAL_LEAD, SHORTEST)
    yaw[0], yaw[1], yaw[2] = quintic_step(yaw[0], yaw[1], yaw[2], goal, 0.0, horizon, dt)
    horizon, pace = max(remaining, SHORTEST), goal / duration
    goal = 0.5 * goal + pace * (horizon - remaining)  # it turns on beyond T
    yaw[3], yaw[4], yaw[5] = quintic_step(yaw[3], yaw[4], yaw[5], goal, pace, horizon, dt)


@njit(cache=True)
def turned_command(vx: float, vy: float, rate: float, period: float, omega: float) -> tuple[float, float]:
    """Velocity to give a planner of straight steps for (vx, vy) along the turning heading [m/s].

    The DCM at touchdown is the sum of all steps to come, b = sum over j >= 1 of u_j lambda^-j. Of steps
    u_j = L exp(i theta (j + 1/2)) that turn by theta = rate * period each, seen from the stance sole,

        b = L exp(3 i theta / 2) / (lambda - exp(i theta)),    lambda = exp(omega period),

    which straight ones give where L is larger by the factor (lambda - 1) exp(3 i theta / 2) / (lambda -
    exp(i theta)).
    """
    theta, growth = rate * period, math.exp(omega * period)
    straight = complex(vx, vy) * (growth - 1.0) * cmath.exp(1.5j * theta) / (growth - cmath.exp(1j * theta))
    return straight.real, straight.imag


@njit(cache=True, forceinline=True)
def exchange_soles(yaw: NDArray) -> float:
    """See the references (7,) from the sole that has landed; returns the heading's advance [rad]."""
    turned = yaw[SWING]
    yaw[0], yaw[1], yaw[2] = -turned, 0.0, 0.0
    yaw[PELVIS_YAW] -= turned
    yaw[LANDING] = 0.0
    return turned
