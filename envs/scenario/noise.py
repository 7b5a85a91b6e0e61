"""White noise from counters, and the noise of the observed motion of the CoM that is made of it; compiled.

A number depends on (seed, index, channel) and on nothing that was drawn before. Its bits are those of
SplitMix64's output function (Steele, Lea, Flood 2014), applied once for each of the three; normal numbers
follow by Box and Muller (1958). So neither the order of robots, nor threads, nor what else is drawn changes
any of them.

The noise of the observed motion is the same for every gait environment. In planning period p the CoM and its
velocity are seen off by

    n_x = s / sqrt(2) z,    n_v = omega s / sqrt(2) z',    so that n_x + n_v / omega has the deviation s,

z and z' normal, independent, white, of the counter p. Axis 1 points from the stance foot of step 0 towards
its swing side, so that the mirrored scenario sees the mirrored noise.
"""

from __future__ import annotations

import math

import numpy as np

from ...controllers.jit import njit
from ...controllers.model.observation import COM, COM_VELOCITY, DCM

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)
_ULP = 2.0**-53


def counter_seed(seed: int) -> int:
    """A non-negative integer of any size as the int64 that compiled loops take: its lowest 64 bits."""
    low = seed & (2**64 - 1)
    return low - 2**64 if low >= 2**63 else low


@njit(cache=True)
def scrambled(bits):  # pragma: no cover
    """SplitMix64's bijection of 64 bits."""
    bits = (bits ^ (bits >> _S30)) * _FIRST
    bits = (bits ^ (bits >> _S27)) * _SECOND
    return bits ^ (bits >> _S31)


@njit(cache=True)
def _key(seed: int, index: int, channel: int):  # pragma: no cover
    """64 bits of a seed, an index and a channel."""
    bits = scrambled(np.uint64(seed) + _GOLDEN)
    bits = scrambled(bits + _GOLDEN * np.uint64(index))
    return scrambled(bits + _GOLDEN * np.uint64(channel))


@njit(cache=True)
def uniform(seed: int, index: int, channel: int) -> float:  # pragma: no cover
    """A number in [0, 1), independent of `normal_pair` of the same arguments (each within int64)."""
    bits = _key(seed, index, channel)
    return np.float64(scrambled(bits + _GOLDEN + _GOLDEN + _GOLDEN) >> _S11) * _ULP


@njit(cache=True)
def grid_origin(seed: int) -> tuple[float, float]:  # pragma: no cover
    """A corner of a grid that lies anywhere, in its cells, in [0, 1)."""
    return uniform(seed, 1 << 40, 0), uniform(seed, 1 << 40, 1)


@njit(cache=True)
def normal_pair(seed: int, index: int, channel: int) -> tuple[float, float]:  # pragma: no cover
    """Two independent standard normal numbers of a seed, a moment and a channel (each within int64).

    r = sqrt(-2 ln u), u in (0, 1], at the angle 2 pi v, v in [0, 1); |r| is at most 8.6.
    """
    bits = _key(seed, index, channel)
    first, second = scrambled(bits + _GOLDEN), scrambled(bits + _GOLDEN + _GOLDEN)
    radius = math.sqrt(-2.0 * math.log((np.float64(first >> _S11) + 1.0) * _ULP))
    angle = 2.0 * math.pi * np.float64(second >> _S11) * _ULP
    return radius * math.cos(angle), radius * math.sin(angle)


COM_CHANNEL, VELOCITY_CHANNEL, JOINT_CHANNEL = 0, 1, 2  # joints take 2, 3, ...
# Columns of the errors of one period; of a pair (x, y) the first one
COM_NOISE = 0  # pair [m]
VELOCITY_NOISE = 2  # pair [m/s]
MOTION_NOISES = 4

_COM, _VELOCITY, _DCM = COM.start, COM_VELOCITY.start, DCM.start


@njit(cache=True)
def motion_noise(seed, period, deviation, omega, steps, out):  # pragma: no cover
    """Write the errors of CoM (2) [m] and velocity (2) [m/s] in the canonical frame of step `steps`, (4,)."""
    share, side = deviation / math.sqrt(2.0), 1.0 if steps % 2 == 0 else -1.0
    x, y = normal_pair(seed, period, COM_CHANNEL)
    u, v = normal_pair(seed, period, VELOCITY_CHANNEL)
    out[COM_NOISE], out[COM_NOISE + 1] = share * x, side * share * y
    out[VELOCITY_NOISE], out[VELOCITY_NOISE + 1] = omega * share * u, side * omega * share * v


@njit(cache=True)
def add_motion_noise(noise, omega, o):  # pragma: no cover
    """Add errors (4,) to CoM, velocity and DCM of an observation (36,); xi = com + v / omega holds."""
    for axis in range(2):
        o[_COM + axis] += noise[COM_NOISE + axis]
        o[_VELOCITY + axis] += noise[VELOCITY_NOISE + axis]
        o[_DCM + axis] = o[_COM + axis] + o[_VELOCITY + axis] / omega
