"""What a pendulum shows of itself: its observation, its capture margin, and whether it has fallen."""

from __future__ import annotations

import math

import numpy as np

from ...controllers.compiled.kernels import njit
from ...controllers.model.capturability import offset_bounds_kernel
from ...controllers.model.double_support import both_stand
from ...controllers.model.frame import side_sign

BEYOND = 0.1  # a fall is certain this far outside what can be recovered from [m]
APEX = 0.06  # height of the swing foot in mid-step [m]


@njit(cache=True)
def observe(s, command, previous, p, out, first, end):  # pragma: no cover
    """Observations (n, 36) of pendulums first..end-1, canonical frame.

    The swing foot moves on a quintic of single support's phase.
    """
    for k in range(first, end):
        o = out[k]
        o[:] = 0.0
        elapsed = s.time[k] - s.step_start[k]
        swing = s.plan[k, 2] - p.double_support
        phase = min(max(elapsed - p.double_support, 0.0) / swing, 1.0)
        blend = phase**3 * (10.0 - 15.0 * phase + 6.0 * phase * phase)
        pace = 30.0 * (phase * (1.0 - phase)) ** 2 / swing
        o[0] = elapsed
        for axis in range(2):
            sign = side_sign(s.side[k]) if axis == 1 else 1.0
            o[3 + axis] = sign * (s.com[k, axis] - s.stance[k, axis])
            o[5 + axis] = sign * s.velocity[k, axis]
            o[1 + axis] = o[3 + axis] + o[5 + axis] / p.omega
            lift = sign * (s.lift[k, axis] - s.stance[k, axis])
            o[9 + axis] = lift + blend * (s.plan[k, axis] - lift)
            o[12 + axis] = pace * (s.plan[k, axis] - lift)
            o[15 + axis] = sign * s.angle[k, axis]
            o[17 + axis] = sign * s.rate[k, axis]
            o[25 + axis] = sign * command[k, axis]
            o[34 + axis] = sign * s.push[k, axis]
        o[11] = APEX * 16.0 * (phase * (1.0 - phase)) ** 2
        o[14] = APEX * 32.0 * phase * (1.0 - phase) * (1.0 - 2.0 * phase) / swing
        o[23] = 1.0
        o[24] = 1.0 if elapsed == 0.0 or both_stand(elapsed, p.double_support) else 0.0
        o[27:34] = previous[k]


@njit(cache=True)
def margin_of(o, elapsed, double_support, constants):  # pragma: no cover
    """Capture margin of an observation (36,) as if `elapsed` had passed since the step began [m].

    What is left of double support lets the CoP stand as far as the other foot, which moves the bounds by
    p (1 - exp(-omega (d - t))).
    """
    bounds, margin, reach = np.empty(4), np.inf, 0.0
    offset_bounds_kernel(elapsed, o[15:17], o[17:19], constants, bounds)
    if both_stand(o[0], double_support):
        reach = -math.expm1(-constants[0] * (double_support - o[0]))
    for axis in range(2):
        low = bounds[axis] + reach * min(o[9 + axis], 0.0)
        high = bounds[2 + axis] + reach * max(o[9 + axis], 0.0)
        margin = min(margin, o[1 + axis] - low, high - o[1 + axis])
    return margin


@njit(cache=True)
def check_failures(s, observation, double_support, constants, margins, first, end):  # pragma: no cover
    """Capture margins (n,) [m] of pendulums first..end-1, and those that not even a step now could save."""
    for k in range(first, end):
        o = observation[k]
        margins[k] = margin_of(o, o[0], double_support, constants)
        if s.failure[k] != 0:
            continue
        if not (math.isfinite(o[1]) and math.isfinite(o[2])):
            s.failure[k] = 2
        elif margin_of(o, 1e3, double_support, constants) < -BEYOND:
            s.failure[k] = 1
