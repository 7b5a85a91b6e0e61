"""Pushes to tune on: drawn like `standard`, from seeds of their own, about the limit in every direction."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from ...controllers.model.capturability import max_recoverable_force
from ...controllers.model.robot import RobotModel
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ...envs.scenario.push_distribution import PushDistribution
from ..score.stratified import BLOCK, stratified_scenario, stratified_uniforms
from ..score.suites import Suite

VERSION = "1"
TUNING, HELD_OUT = "tuning", "tuning-held-out"
SEEDS = {TUNING: 20260401, HELD_OUT: 20260402}
BLOCKS = 4
SHARE = (0.4, 2.0)  # of F*, whose step box is the paper's: on the biped about half is lost
RANGES = PushDistribution(first_step=2, settle_time=3.0)  # falls come within 2 s of the push


def _force_of(share: float, psi: float, side: str) -> float:
    """Force [N] at a share in [0, 1] of SHARE, on a left or right stance."""
    # F* is that of a left stance in place; a right stance is its mirror image
    limit = max_recoverable_force(RobotModel(), psi if side == "left" else -psi, RANGES.push_duration)
    return (SHARE[0] + share * (SHARE[1] - SHARE[0])) * limit


@cache
def tuning_suite(name: str, scenarios: int, errors: ModelErrors = EXACT_MODEL) -> Suite:
    """The first `scenarios` of a suite of SEEDS; every whole block of 256 is stratified.

    With `errors`, every second robot is off by them, half of these with the mass error negated.

    The share of F* is uniform, so the rate recovered is the mean share survived, over directions, phases and
    commands, of those from SHARE[0] to SHARE[1].
    """
    seed = SEEDS[name]
    points = stratified_uniforms(BLOCKS, 5, seed)[:scenarios]
    drawn = [
        stratified_scenario(f"{name}-{i:04d}", RANGES, _force_of, u, seed + 4096 * i)
        for i, u in enumerate(points)
    ]
    if errors == EXACT_MODEL:
        return Suite(name, VERSION, tuple(drawn))
    both = errors, replace(errors, mass=-errors.mass)
    spoilt = [replace(s, errors=both[i // 2 % 2]) if i % 2 else s for i, s in enumerate(drawn)]
    return Suite(f"{name}-half-{'-'.join(errors.names)}", VERSION, tuple(spoilt))


MOST = BLOCKS * BLOCK  # scenarios of a suite
