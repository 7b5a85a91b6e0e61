"""Noise of the observed motion of the CoM, the same for every gait environment; compiled.

In planning period p the CoM and its velocity are seen off by

    n_x = s / sqrt(2) z,    n_v = omega s / sqrt(2) z',    so that n_x + n_v / omega has the deviation s,

z and z' normal, independent, white, of the counter p. Axis 1 points from the stance foot of step 0 towards
its swing side, so that the mirrored scenario sees the mirrored noise.
"""

from __future__ import annotations

import math

from ...controllers.compiled.kernels import njit
from ...controllers.model.observation import COM, COM_VELOCITY, DCM
from .noise import normal_pair

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
