"""What a pendulum shows of itself: its observation, its capture margin, and whether it has fallen."""

from __future__ import annotations

import math

import numpy as np

from ...controllers.compiled.kernels import njit
from ...controllers.model.capturability import BOUNDS, HIGH, LOW, constants_of, offset_bounds_kernel
from ...controllers.model.double_support import both_stand
from ...controllers.model.frame import side_sign
from ...controllers.model.gait_box import DURATION, STEP
from ...controllers.model.observation import (
    COM,
    COM_VELOCITY,
    COMMAND,
    DCM,
    ELAPSED,
    PREVIOUS_ACTION,
    PUSH_ESTIMATE,
    STANCE_CONTACT,
    SWING_CONTACT,
    SWING_POSITION,
    SWING_VELOCITY,
    TRUNK_ANGLE,
    TRUNK_RATE,
    WORLD_CMP,
    WORLD_COP,
    WORLD_DCM,
)
from .dynamics import DIVERGED, NOT_FINITE

_DCM, _COM, _VELOCITY, _COMMAND = DCM.start, COM.start, COM_VELOCITY.start, COMMAND.start
_SWING, _SWING_VELOCITY, _PUSH = SWING_POSITION.start, SWING_VELOCITY.start, PUSH_ESTIMATE.start
_ANGLE, _RATE, _PREVIOUS = TRUNK_ANGLE.start, TRUNK_RATE.start, PREVIOUS_ACTION.start

BEYOND = 0.1  # a fall is certain this far outside what can be recovered from [m]
APEX = 0.06  # height of the swing foot in mid-step [m]


@njit(cache=True)
def observe(s, command, previous, p, out, world, first, end):  # pragma: no cover
    """Observations (n, 36) of pendulums first..end-1, canonical frame.

    Writes DCM, CoP and CMP in the world (n, 6) [m], too. The swing foot moves on a quintic of single
    support's phase.
    """
    for k in range(first, end):
        o = out[k]
        o[:] = 0.0
        elapsed = s.time[k] - s.step_start[k]
        swing = s.plan[k, DURATION] - p.double_support
        phase = min(max(elapsed - p.double_support, 0.0) / swing, 1.0)
        blend = phase**3 * (10.0 - 15.0 * phase + 6.0 * phase * phase)
        pace = 30.0 * (phase * (1.0 - phase)) ** 2 / swing
        o[ELAPSED] = elapsed
        for axis in range(2):
            sign = side_sign(s.side[k]) if axis == 1 else 1.0
            o[_COM + axis] = sign * (s.com[k, axis] - s.stance[k, axis])
            o[_VELOCITY + axis] = sign * s.velocity[k, axis]
            o[_DCM + axis] = o[_COM + axis] + o[_VELOCITY + axis] / p.omega
            lift = sign * (s.lift[k, axis] - s.stance[k, axis])
            o[_SWING + axis] = lift + blend * (s.plan[k, STEP + axis] - lift)
            o[_SWING_VELOCITY + axis] = pace * (s.plan[k, STEP + axis] - lift)
            o[_ANGLE + axis] = sign * s.angle[k, axis]
            o[_RATE + axis] = sign * s.rate[k, axis]
            o[_COMMAND + axis] = sign * command[k, axis]
            o[_PUSH + axis] = sign * s.push[k, axis]
            world[k, WORLD_DCM + axis] = s.com[k, axis] + s.velocity[k, axis] / p.omega
            world[k, WORLD_COP + axis], world[k, WORLD_CMP + axis] = s.cop[k, axis], s.cmp[k, axis]
        o[_SWING + 2] = APEX * 16.0 * (phase * (1.0 - phase)) ** 2
        o[_SWING_VELOCITY + 2] = APEX * 32.0 * phase * (1.0 - phase) * (1.0 - 2.0 * phase) / swing
        o[STANCE_CONTACT] = 1.0
        o[SWING_CONTACT] = 1.0 if elapsed == 0.0 or both_stand(elapsed, p.double_support) else 0.0
        for i in range(previous.shape[1]):
            o[_PREVIOUS + i] = previous[k, i]


@njit(cache=True)
def margin_of(o, elapsed, double_support, constants):  # pragma: no cover
    """Capture margin of an observation (36,) as if `elapsed` had passed since the step began [m].

    What is left of double support lets the CoP stand as far as the other foot, which moves the bounds by
    p (1 - exp(-omega (d - t))).
    """
    bounds, margin, reach = np.empty(BOUNDS), np.inf, 0.0
    angle, rate = o[_ANGLE : _ANGLE + 2], o[_RATE : _RATE + 2]
    offset_bounds_kernel(elapsed, angle, rate, constants, bounds)
    if both_stand(o[ELAPSED], double_support):
        reach = -math.expm1(-constants_of(constants).omega * (double_support - o[ELAPSED]))
    for axis in range(2):
        low = bounds[LOW + axis] + reach * min(o[_SWING + axis], 0.0)
        high = bounds[HIGH + axis] + reach * max(o[_SWING + axis], 0.0)
        margin = min(margin, o[_DCM + axis] - low, high - o[_DCM + axis])
    return margin


@njit(cache=True)
def check_failures(s, observation, double_support, constants, margins, first, end):  # pragma: no cover
    """Capture margins (n,) [m] of pendulums first..end-1, and those that not even a step now could save."""
    for k in range(first, end):
        o = observation[k]
        margins[k] = margin_of(o, o[ELAPSED], double_support, constants)
        if s.failure[k] != 0:
            continue
        if not (math.isfinite(o[_DCM]) and math.isfinite(o[_DCM + 1])):
            s.failure[k] = NOT_FINITE
        elif margin_of(o, 1e3, double_support, constants) < -BEYOND:
            s.failure[k] = DIVERGED
