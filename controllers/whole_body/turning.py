"""Turning: the swing sole lands turned by the commanded rate times T, and the pelvis goes along.

Within a step the heading, the canonical frame's x axis, stays: it is the stance sole's. The references below
are yaws beyond it. At touchdown the heading advances by the yaw of the sole that lands; the pelvis, half-way
between the soles by then, turns on at the commanded rate. No reference jumps. A pelvis that has been twisted
off its yaw turns the next sole, too, where a robot gives way to it: a sole has little friction against yaw.
"""

from __future__ import annotations

import cmath
import math

from numpy.typing import NDArray

from ..compiled.kernels import njit
from .swing_foot import ARRIVAL_LEAD, SHORTEST, quintic_step

SIZE = 7  # swing sole: yaw, rate, acceleration; pelvis: the same; yaw at which the sole is to land
SWING, PELVIS_YAW, LANDING = 0, 3, 6
TURN = 2  # column of a command: velocity x, y [m/s], turn [rad/s]
LARGEST_GIVEN = 0.8  # yaw by which a sole lands turned for a twisted pelvis [rad]


@njit(cache=True, forceinline=True)
def given_yaw(twist: float, most: float) -> float:
    """Yaw by which the next sole lands turned [rad] where the pelvis is `twist` off its yaw.

    sign(twist) min(max(|twist| - most, 0), LARGEST_GIVEN)
    """
    return math.copysign(min(max(abs(twist) - most, 0.0), LARGEST_GIVEN), twist)


@njit(cache=True, forceinline=True)
def turn_references(
    yaw: NDArray, rate: float, duration: float, remaining: float, final: float, given: float, dt: float
) -> None:
    """Advance the yaw references (7,) of one robot by dt, in place.

    Args:
        yaw: beyond the heading [rad], [rad/s], [rad/s^2], in the order of SIZE.
        rate: commanded [rad/s].
        duration: of the step until its sole lands [s].
        remaining: until T [s].
        final: from this long before T on, the yaw at landing stays [s].
        given: see `given_yaw` [rad].
        dt: physics step [s].
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
    """Velocity that a planner of straight steps has to be told for (vx, vy) along the turning heading [m/s].

    The DCM at touchdown is the sum of all steps to come, b = sum over j >= 1 of u_j lambda^-j. Of steps
    u_j = L exp(i theta (j + 1/2)) that turn by theta = rate * period each, seen from the stance sole,

        b = L exp(3 i theta / 2) / (lambda - exp(i theta)),    lambda = exp(omega period),

    which straight ones give where L is larger by the factor (lambda - 1) exp(3 i theta / 2) / (lambda -
    exp(i theta)).
    """
    theta, growth = rate * period, math.exp(omega * period)
    told = complex(vx, vy) * (growth - 1.0) * cmath.exp(1.5j * theta) / (growth - cmath.exp(1j * theta))
    return told.real, told.imag


@njit(cache=True, forceinline=True)
def exchange_soles(yaw: NDArray) -> float:
    """See the references (7,) from the sole that has landed; returns the heading's advance [rad]."""
    turned = yaw[SWING]
    yaw[0], yaw[1], yaw[2] = -turned, 0.0, 0.0
    yaw[PELVIS_YAW] -= turned
    yaw[LANDING] = 0.0
    return turned
