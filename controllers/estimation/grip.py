"""The friction that a robot believes in: less after a slide, more where the floor has held; compiled.

A sole slides where it has moved faster than SLIDES in SLIDING periods in a row, and further than noise
explains. With p the sole's place, seen at the end of each planning period with white noise of the deviation
sigma along each axis,

    |p - p_start| > SLIDES t + DOUBT sqrt(2) sigma    it slides, unless it rested in the last SLIDING periods,
    |p - p_start| < SLIDES t                          it rests: the next period is the first,

which is Page's test of a change of the mean (Biometrika 1954): the sum of the periods' displacements is one
difference of two places, so noise does not add up over it. A second difference of three places has the
variance 6 sigma^2 along each axis whatever the sole's steady speed, which tells sigma; a sole that shakes for
a while in a fall adds little to it. Up to NO_NOISE it counts as none, and each period's displacement tells
by itself.

While a sole slides, the horizontal share of the floor's force is the friction. What was believed in noise is
tried again: while the sole rests although that share is as large as the belief, there is more friction, and
the belief rises at a steady rate, up to that of the beginning.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit

Array = NDArray[np.float64]

SLIDES = 0.3  # speed from which a sole slides [m/s]
SLIDING = 3  # periods of sliding that tell the friction: one alone may be a blow
DOUBT = 6.0  # deviations of noise that a slide must rise above
GRIP_MIN = 0.4  # the least friction that is believed
NOISE_PERIODS = 50.0  # over which the noise is averaged
NOISE_KNOWN = 10.0  # periods after which it is known
NOISE_JUMP = 3.0  # the most that one period counts of what it has been: sliding and shaking are no noise
NOISE_LEAST = 1e-9  # and on top of that: noise that begins is found [m^2]
NO_NOISE = 4e-8  # variance that counts as none [m^2]
TRIED = 0.95  # share of the belief that a floor has to hold, to be believed more of
RISE = 0.5  # of the belief then [1/s]

# Columns of a robot's row; of a pair (x, y) the first one
PLACE = 0  # pair, of the stance sole at the last observation [m]
MOVED = 2  # pair, in the period before it [m]
START = 4  # pair, where a slide may have begun [m]
TIME = 6  # since then [s]
PERIODS = 7  # since then
SHARE = 8  # largest horizontal share of the floor's force since then
STANDS = 9  # for how many periods this sole has stood
ITS_STEP = 10  # number of the step in which it stood there
NOISE = 11  # variance of the place along each axis [m^2]
NOISES = 12  # how many periods that was found from
MOST = 13  # friction believed in at the beginning
SIZE = 14


@njit(cache=True, forceinline=True)
def _keep_place(stood: Array, first: int, x: float, y: float) -> None:
    stood[first], stood[first + 1] = x, y


@njit(cache=True, forceinline=True)
def _count_noise(stood: Array, x: float, y: float) -> None:
    """Take how the displacement (x, y) of a period differs from that of the one before it."""
    squared = ((x - stood[MOVED]) ** 2 + (y - stood[MOVED + 1]) ** 2) / 12.0
    if stood[NOISES] >= NOISE_KNOWN:
        squared = min(squared, NOISE_JUMP * stood[NOISE] + NOISE_LEAST)
    stood[NOISES] = min(stood[NOISES] + 1.0, NOISE_PERIODS)
    stood[NOISE] += (squared - stood[NOISE]) / stood[NOISES]


@njit(cache=True, forceinline=True)
def _restart(stood: Array, x: float, y: float) -> None:
    """A slide may begin here."""
    _keep_place(stood, START, x, y)
    stood[TIME] = stood[PERIODS] = stood[SHARE] = 0.0


@njit(cache=True)
def feel_grip(
    stood: Array, grip: float, x: float, y: float, step: int, landed: bool, share: float, span: float
) -> float:
    """Friction believed in after a period in which a stance sole has stood, or slid.

    Args:
        stood: row (SIZE,) of the robot, written.
        grip: friction believed in until now.
        x: place of the stance sole [m].
        y: place of the stance sole [m].
        step: its number.
        landed: whether the sole no longer slides from its landing.
        share: of the floor's force that is horizontal over the vertical one; negative: there is no force.
        span: of the period [s].
    """
    stands = landed and stood[ITS_STEP] == step
    moved_x, moved_y = x - stood[PLACE], y - stood[PLACE + 1]
    stood[ITS_STEP] = step
    _keep_place(stood, PLACE, x, y)
    if not stands or share < 0.0:
        stood[STANDS] = 0.0
        _restart(stood, x, y)
        return grip
    if stood[STANDS] > 0.0:
        _count_noise(stood, moved_x, moved_y)
    stood[STANDS] += 1.0
    _keep_place(stood, MOVED, moved_x, moved_y)
    stood[TIME] += span
    noisy, doubt = stood[NOISE] > NO_NOISE, DOUBT * math.sqrt(2.0 * stood[NOISE])
    far = math.hypot(x - stood[START], y - stood[START + 1]) - SLIDES * stood[TIME]
    least = SLIDES * span - (doubt if noisy else 0.0)
    if math.hypot(moved_x, moved_y) <= least or (noisy and far <= 0.0):
        _restart(stood, x, y)
        return min(grip + RISE * span, stood[MOST]) if noisy and share >= TRIED * grip else grip
    stood[PERIODS] += 1.0
    stood[SHARE] = max(stood[SHARE], share)
    sure = not noisy or (far > doubt and stood[NOISES] >= NOISE_KNOWN)
    return min(grip, max(stood[SHARE], GRIP_MIN)) if sure and stood[PERIODS] >= SLIDING else grip
