"""Reward terms of the gait environments: named, pure, one number each per planning period."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.kernels import njit
from ...controllers.model.observation import PREVIOUS_ACTION, TRUNK_ANGLE, TRUNK_RATE

_ANGLE, _RATE, _ACTION = TRUNK_ANGLE.start, TRUNK_RATE.start, PREVIOUS_ACTION.start


@njit(cache=True)
def alive(failed):  # pragma: no cover
    """1 while standing."""
    return 0.0 if failed else 1.0


@njit(cache=True)
def fall(failed):  # pragma: no cover
    """-50 once, at a fall."""
    return -50.0 if failed else 0.0


@njit(cache=True)
def dcm(started, nominal, failed):  # pragma: no cover
    """exp(-|e|^2 / (0.1 m)^2), e the DCM's error against the nominal gait at the start of the step.

    Both are (2,) [m]; in double support what the CoP's transfer will take off the DCM counts in both.
    """
    squared = (started[0] - nominal[0]) ** 2 + (started[1] - nominal[1]) ** 2
    return 0.0 if failed else math.exp(-squared / 0.01)


@njit(cache=True)
def margin(capture_margin):  # pragma: no cover
    """-1 at a capture margin [m] of zero or below, 0 from 0.1 m on."""
    return -min(max(1.0 - capture_margin / 0.1, 0.0), 1.0)


@njit(cache=True)
def duration(planned, nominal):  # pragma: no cover
    """-0.5 ((T - T_nom) / T_nom)^2, both [s]."""
    return -0.5 * (planned / nominal - 1.0) ** 2


@njit(cache=True)
def trunk(obs):  # pragma: no cover
    """-0.3 |lean|^2 - 0.01 |rate|^2, at least -2."""
    lean = obs[_ANGLE] ** 2 + obs[_ANGLE + 1] ** 2
    rate = obs[_RATE] ** 2 + obs[_RATE + 1] ** 2
    return max(-0.3 * lean - 0.01 * rate, -2.0)


@njit(cache=True)
def smoothness(obs, before):  # pragma: no cover
    """-0.02 |a - a_before|^2; `before` (7,) was in force in the period before the observation's."""
    total = 0.0
    for i in range(before.shape[0]):
        total += (obs[_ACTION + i] - before[i]) ** 2
    return -0.02 * total


REWARD_TERMS = ("alive", "fall", "dcm", "margin", "duration", "trunk", "smoothness")


@njit(cache=True)
def write_reward(
    obs, before, planned, capture_margin, failed, started, start, nominal_duration, terms
):  # pragma: no cover
    """Write the terms (7,) of one robot in the order of REWARD_TERMS; returns their sum.

    Args:
        obs: observation (36,) after the period; its previous action is this period's.
        before: action (7,) in force in the period before.
        planned: step duration T asked for [s].
        capture_margin: [m].
        failed: whether the robot has fallen.
        started: DCM (2,) at the start of the step [m].
        start: the nominal gait's (2,) [m].
        nominal_duration: T_nom [s].
        terms: written.
    """
    terms[0] = alive(failed)
    terms[1] = fall(failed)
    terms[2] = dcm(started, start, failed)
    terms[3] = margin(capture_margin)
    terms[4] = duration(planned, nominal_duration)
    terms[5] = trunk(obs)
    terms[6] = smoothness(obs, before)
    total = 0.0
    for i in range(terms.shape[0]):
        total += terms[i]
    return total


class Reward(NamedTuple):
    """What one planning period was worth to n robots."""

    total: NDArray[np.float64]  # (n,)
    terms: NDArray[np.float64]  # (n, 7) in the order of REWARD_TERMS
