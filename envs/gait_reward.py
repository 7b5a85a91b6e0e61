"""Reward terms of the gait environments: named, pure, one number each per planning period, for n robots."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..controllers.limits import GaitLimits
from ..controllers.nominal_gait import nominal_gait_kernel
from ..controllers.observation import COMMAND, PREVIOUS_ACTION, TRUNK_ANGLE, TRUNK_RATE
from ..controllers.robot import RobotModel
from .gait_monitor import nominal_dcm_kernel, started_dcm_kernel

Array = NDArray[np.float64]

_COMMAND, _ANGLE, _RATE, _ACTION = COMMAND.start, TRUNK_ANGLE.start, TRUNK_RATE.start, PREVIOUS_ACTION.start


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
def _reward(observations, before, planned, margins, failed, c, low, high, terms, total):  # pragma: no cover
    nominal, start, here = np.empty(5), np.empty(2), np.empty(2)
    for k in range(total.shape[0]):
        obs, fell = observations[k], failed[k]
        vx, vy = obs[_COMMAND], obs[_COMMAND + 1]
        nominal_gait_kernel(vx, vy, c[1], low, high, c[0], c[2], nominal, c[3])
        nominal_dcm_kernel(vx, vy, c[1], low, high, c[0], c[2], c[3], start)
        started_dcm_kernel(obs, c[3], c[0], here)
        terms[k, 0] = alive(fell)
        terms[k, 1] = fall(fell)
        terms[k, 2] = dcm(here, start, fell)
        terms[k, 3] = margin(margins[k])
        terms[k, 4] = duration(planned[k], nominal[2])
        terms[k, 5] = trunk(obs)
        terms[k, 6] = smoothness(obs, before[k])
        total[k] = 0.0
        for i in range(terms.shape[1]):
            total[k] += terms[k, i]


class Reward(NamedTuple):
    """What one planning period was worth to n robots."""

    total: Array  # (n,)
    terms: Array  # (n, 7) in the order of REWARD_TERMS


class GaitReward:
    """The terms of n robots of one kind; those of a robot do not depend on the others."""

    def __init__(self, robot: RobotModel, limits: GaitLimits, delay: float, double_support: float):
        self._constants = np.array([robot.omega, robot.pelvis_width, delay, double_support])
        self._low, self._high = limits.low, limits.high

    def __call__(
        self,
        observations: Array,
        before: Array,
        planned: Array,
        margins: Array,
        failed: NDArray[np.bool_],
    ) -> Reward:
        """Look at n robots after a period.

        Args:
            observations: (n, 36); their previous action is this period's.
            before: actions (n, 7) in force in the period before.
            planned: step durations T (n,) asked for [s].
            margins: capture margins (n,) [m].
            failed: (n,) which have fallen.
        """
        n = len(observations)
        reward = Reward(np.empty(n), np.empty((n, len(REWARD_TERMS))))
        _reward(
            observations, before, planned, margins, failed, self._constants, self._low, self._high,
            reward.terms, reward.total,
        )  # fmt: skip
        return reward
