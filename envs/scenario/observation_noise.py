"""Noise of the observed motion of the CoM, the same for every gait environment; compiled.

In planning period p the CoM and its velocity are seen off by

    n_x = s / sqrt(2) z,    n_v = omega s / sqrt(2) z',    so that n_x + n_v / omega has the deviation s,

z and z' normal, independent, white, of the counter p. Axis 1 points from the stance foot of step 0 towards
its swing side, so that the mirrored scenario sees the mirrored noise.
"""

from __future__ import annotations

import math

from ...controllers.compiled.kernels import njit
from .noise import normal_pair

COM_CHANNEL, VELOCITY_CHANNEL, JOINT_CHANNEL = 0, 1, 2  # joints take 2, 3, ...


@njit(cache=True)
def motion_noise(seed, period, deviation, omega, steps, out):  # pragma: no cover
    """Write the errors of CoM (2) [m] and velocity (2) [m/s] in the canonical frame of step `steps`, (4,)."""
    share, side = deviation / math.sqrt(2.0), 1.0 if steps % 2 == 0 else -1.0
    x, y = normal_pair(seed, period, COM_CHANNEL)
    u, v = normal_pair(seed, period, VELOCITY_CHANNEL)
    out[0], out[1] = share * x, side * share * y
    out[2], out[3] = omega * share * u, side * omega * share * v


@njit(cache=True)
def add_motion_noise(noise, omega, o):  # pragma: no cover
    """Add errors (4,) to CoM, velocity and DCM (1-6) of an observation (36,); xi = com + v / omega holds."""
    for axis in range(2):
        o[3 + axis] += noise[axis]
        o[5 + axis] += noise[2 + axis]
        o[1 + axis] = o[3 + axis] + o[5 + axis] / omega
