"""Pushes to tune on: drawn like `standard`, from seeds of their own, about the limit in every direction."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ...controllers.capturability import max_recoverable_force
from ...controllers.robot import RobotModel
from ...envs.model_errors import EXACT_MODEL, ModelErrors
from ...envs.push import GaitEvent, Push
from ...envs.scenario import COMMAND_KINDS, PushDistribution, Scenario
from ..suites import BLOCK, LEVELS, Suite, stratified_uniforms

VERSION = "1"
TUNING, HELD_OUT = "tuning", "tuning-held-out"
SEEDS = {TUNING: 20260401, HELD_OUT: 20260402}
BLOCKS = 4
SHARE = (0.4, 2.0)  # of F*, whose step box is the paper's: on the biped about half is lost
FIRST_STEP = 2
SETTLE_TIME = 3.0  # [s]: falls come within 2 s of the push


def _scenario(name: str, index: int, u: NDArray[np.float64], noise_seed: int) -> Scenario:
    """Scenario of one stratified point: direction, share of F*, phase, command speed, kind and sides."""
    ranges = PushDistribution()
    category = int(u[4] * LEVELS)
    side = "left" if category & 4 else "right"
    psi = (2.0 * u[0] - 1.0) * math.pi
    # F* is that of a left stance in place; a right stance is its mirror image
    limit = max_recoverable_force(RobotModel(), psi if side == "left" else -psi, ranges.push_duration)
    force = (SHARE[0] + u[1] * (SHARE[1] - SHARE[0])) * limit
    vector = (round(force * math.cos(psi), 3), round(force * math.sin(psi), 3), 0.0)
    signed = 2.0 * u[3] - 1.0
    speed = abs(signed) if COMMAND_KINDS[category & 3] == "sideways" else u[3]
    event = GaitEvent(FIRST_STEP, side, round(u[2] * ranges.phase_max, 4))
    return Scenario(
        id=f"{name}-{index:04d}",
        pushes=(Push(vector, ranges.push_duration, event),),
        command=ranges.command(category & 3, round(speed, 4), bool(signed > 0)),
        stance_side="left" if category & 8 else "right",
        settle_time=SETTLE_TIME,
        noise_seed=noise_seed,
    )


@cache
def tuning_suite(name: str, scenarios: int, errors: ModelErrors = EXACT_MODEL) -> Suite:
    """The first `scenarios` of a suite of SEEDS; every whole block of 256 is stratified.

    With `errors`, every second robot is off by them, half of these with the mass error negated.

    The share of F* is uniform, so the rate recovered is the mean share survived, over directions, phases and
    commands, of those from SHARE[0] to SHARE[1].
    """
    seed = SEEDS[name]
    points = stratified_uniforms(BLOCKS, 5, seed)[:scenarios]
    drawn = [_scenario(name, i, u, seed + 4096 * i) for i, u in enumerate(points)]
    if errors == EXACT_MODEL:
        return Suite(name, VERSION, tuple(drawn))
    both = errors, replace(errors, mass=-errors.mass)
    spoilt = [replace(s, errors=both[i // 2 % 2]) if i % 2 else s for i, s in enumerate(drawn)]
    return Suite(f"{name}-half-{'-'.join(errors.names)}", VERSION, tuple(spoilt))


MOST = BLOCKS * BLOCK  # scenarios of a suite
