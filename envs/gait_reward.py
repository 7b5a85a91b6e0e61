"""Reward terms of the gait environments: named, pure, one number each per planning period."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..controllers.nominal_gait import NominalGait
from ..controllers.observation import DCM, ELAPSED, PREVIOUS_ACTION, TRUNK_ANGLE, TRUNK_RATE

Array = NDArray[np.float64]


class RewardInput(NamedTuple):
    """What the terms may look at, after the period."""

    observation: Array  # (34,)
    previous_action: Array  # (7,) of the period before; PREVIOUS_ACTION of `observation` is this period's
    nominal: NominalGait
    start_dcm: tuple[float, float]  # of the nominal step [m]
    duration: float  # planned T [s]
    omega: float  # [1/s]
    capture_margin: float  # [m]
    failed: bool


def alive(x: RewardInput) -> float:
    """1 while standing."""
    return 0.0 if x.failed else 1.0


def fall(x: RewardInput) -> float:
    """-50 once, at a fall."""
    return -50.0 if x.failed else 0.0


def dcm(x: RewardInput) -> float:
    """exp(-|e|^2 / (0.1 m)^2), e the DCM's error against the nominal gait at the start of the step."""
    back = math.exp(-x.omega * float(x.observation[ELAPSED]))
    error = x.observation[DCM] * back - np.array(x.start_dcm)
    return 0.0 if x.failed else math.exp(-float(error @ error) / 0.01)


def margin(x: RewardInput) -> float:
    """-1 at a capture margin of zero or below, 0 from 0.1 m on."""
    return -min(max(1.0 - x.capture_margin / 0.1, 0.0), 1.0)


def duration(x: RewardInput) -> float:
    """-0.5 ((T - T_nom) / T_nom)^2."""
    return -0.5 * (x.duration / x.nominal.duration - 1.0) ** 2


def trunk(x: RewardInput) -> float:
    """-0.3 |lean|^2 - 0.01 |rate|^2, at least -2."""
    lean, rate = x.observation[TRUNK_ANGLE], x.observation[TRUNK_RATE]
    return max(-0.3 * float(lean @ lean) - 0.01 * float(rate @ rate), -2.0)


def smoothness(x: RewardInput) -> float:
    """-0.02 |a - a_previous|^2."""
    change = x.observation[PREVIOUS_ACTION] - x.previous_action
    return -0.02 * float(change @ change)


REWARD_TERMS: dict[str, Callable[[RewardInput], float]] = {
    term.__name__: term for term in (alive, fall, dcm, margin, duration, trunk, smoothness)
}
