"""Reward terms of the gait environments: named, pure, one number each per planning period."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from ..controllers.double_support import transfer_weight
from ..controllers.nominal_gait import NominalGait
from ..controllers.observation import (
    DCM,
    ELAPSED,
    PREVIOUS_ACTION,
    SWING_POSITION,
    TRUNK_ANGLE,
    TRUNK_RATE,
)


class RewardInput(NamedTuple):
    """What the terms may look at, after the period."""

    observation: list[float]  # (36,)
    previous_action: list[
        float
    ]  # (7,) of the period before; PREVIOUS_ACTION of `observation` is this period's
    nominal: NominalGait
    start_dcm: tuple[float, float]  # of the nominal step, less the CoP's transfer [m]
    duration: float  # planned T [s]
    omega: float  # [1/s]
    capture_margin: float  # [m]
    failed: bool
    double_support: float = 0.0  # [s]


def alive(x: RewardInput) -> float:
    """1 while standing."""
    return 0.0 if x.failed else 1.0


def fall(x: RewardInput) -> float:
    """-50 once, at a fall."""
    return -50.0 if x.failed else 0.0


def dcm(x: RewardInput) -> float:
    """exp(-|e|^2 / (0.1 m)^2), e the DCM's error against the nominal gait at the start of the step.

    In double support what the CoP's transfer will take off the DCM counts in both.
    """
    elapsed = x.observation[ELAPSED]
    back = math.exp(-x.omega * elapsed)
    dcm_x, dcm_y = x.observation[DCM]
    if elapsed < x.double_support:
        share = transfer_weight(elapsed, x.double_support, x.omega)
        other_x, other_y, _ = x.observation[SWING_POSITION]
        dcm_x, dcm_y = dcm_x - share * other_x, dcm_y - share * other_y
    squared = (dcm_x * back - x.start_dcm[0]) ** 2 + (dcm_y * back - x.start_dcm[1]) ** 2
    return 0.0 if x.failed else math.exp(-squared / 0.01)


def margin(x: RewardInput) -> float:
    """-1 at a capture margin of zero or below, 0 from 0.1 m on."""
    return -min(max(1.0 - x.capture_margin / 0.1, 0.0), 1.0)


def duration(x: RewardInput) -> float:
    """-0.5 ((T - T_nom) / T_nom)^2."""
    return -0.5 * (x.duration / x.nominal.duration - 1.0) ** 2


def trunk(x: RewardInput) -> float:
    """-0.3 |lean|^2 - 0.01 |rate|^2, at least -2."""
    (pitch, roll), (pitch_rate, roll_rate) = x.observation[TRUNK_ANGLE], x.observation[TRUNK_RATE]
    return max(-0.3 * (pitch**2 + roll**2) - 0.01 * (pitch_rate**2 + roll_rate**2), -2.0)


def smoothness(x: RewardInput) -> float:
    """-0.02 |a - a_previous|^2."""
    action = x.observation[PREVIOUS_ACTION]
    return -0.02 * sum((new - old) ** 2 for new, old in zip(action, x.previous_action, strict=True))


REWARD_TERMS: dict[str, Callable[[RewardInput], float]] = {
    term.__name__: term for term in (alive, fall, dcm, margin, duration, trunk, smoothness)
}
