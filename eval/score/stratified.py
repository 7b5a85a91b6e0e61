"""Scenarios from points that fill a unit cube evenly: every pair of factors has every pair of levels once."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...envs.scenario.push import GaitEvent, Push
from ...envs.scenario.push_distribution import COMMAND_KINDS, PushDistribution
from ...envs.scenario.scenario import Scenario

LEVELS = 16  # of each factor
BLOCK = LEVELS**2  # scenarios in which every pair of factors has every pair of levels once
ForceOf = Callable[[float, float, str], float]  # [N], of a share in [0, 1], psi and the stance side


def gf16_multiply(a: int, b: int) -> int:
    """Product in the field of 16 elements, modulo x^4 + x + 1."""
    product = 0
    while b:
        if b & 1:
            product ^= a
        a, b = a << 1, b >> 1
        if a & 16:
            a ^= 0b10011
    return product


def orthogonal_array(factors: int) -> NDArray[np.int64]:
    """Strength-2 orthogonal array (256, factors) of 16 levels (Bush 1952), up to 17 factors.

    Row (a, b) holds a, b, a + b, a + 2 b, ... in the field of 16 elements: any two columns take each of the
    256 pairs of levels exactly once.
    """
    rows = [
        [a, *(b if k == 0 else a ^ gf16_multiply(k, b) for k in range(factors - 1))]
        for a in range(LEVELS)
        for b in range(LEVELS)
    ]
    return np.array(rows, dtype=np.int64)


def _uniforms(generator: np.random.PCG64, *shape: int) -> NDArray[np.float64]:
    """Uniforms in [0, 1) from raw bits, whose stream numpy guarantees across versions."""
    raw = np.asarray(generator.random_raw(math.prod(shape)), dtype=np.uint64)
    return ((raw >> np.uint64(11)).astype(np.float64) * 2.0**-53).reshape(shape)


def stratified_uniforms(blocks: int, factors: int, seed: int) -> NDArray[np.float64]:
    """Points (256 blocks, factors) in the unit cube, stratified in every block of 256.

    In each block every pair of factors falls once into each of 16 x 16 cells, and each factor once into each
    of 256 intervals; over all blocks each factor falls once into each of 256 x blocks intervals.
    """
    generator = np.random.PCG64(np.random.SeedSequence(seed))
    array = orthogonal_array(factors)
    quarter = np.argsort(_uniforms(generator, factors, blocks), axis=1)  # of the finest interval, by block
    points = np.empty((blocks, BLOCK, factors))
    for block in range(blocks):
        order = np.argsort(_uniforms(generator, BLOCK))
        for factor in range(factors):
            level = np.argsort(_uniforms(generator, LEVELS))[array[:, factor]]
            rank = np.empty(BLOCK, dtype=np.int64)
            for value in range(LEVELS):
                rank[level == value] = np.argsort(_uniforms(generator, LEVELS))
            inner = (quarter[factor, block] + _uniforms(generator, BLOCK)) / blocks
            points[block, :, factor] = ((level + (rank + inner) / LEVELS) / LEVELS)[order]
    return points.reshape(-1, factors)


def uniform_force(ranges: PushDistribution) -> ForceOf:
    """Forces whose impulse is uniform in the range of a distribution, all round."""

    def force_of(share: float, _psi: float, _side: str) -> float:
        return (ranges.impulse_min + share * (ranges.impulse_max - ranges.impulse_min)) / ranges.push_duration

    return force_of


def stratified_scenario(
    scenario_id: str, ranges: PushDistribution, force_of: ForceOf, u: NDArray[np.float64], noise_seed: int
) -> Scenario:
    """Scenario of one stratified point: direction, force, phase, command speed, kind and sides.

    Values are rounded far below what matters so that the content does not hang on a platform's libm.
    """
    category = int(u[4] * LEVELS)  # 4 kinds of command x side of the push x first stance side
    side = "left" if category & 4 else "right"
    psi = (2 * u[0] - 1) * math.pi
    force = force_of(u[1], psi, side)
    vector = (round(force * math.cos(psi), 3), round(force * math.sin(psi), 3), 0.0)
    event = GaitEvent(ranges.first_step, side, round(u[2] * ranges.phase_max, 4))
    signed = 2 * u[3] - 1
    speed = abs(signed) if COMMAND_KINDS[category & 3] == "sideways" else u[3]
    return Scenario(
        id=scenario_id,
        pushes=(Push(vector, ranges.push_duration, event),),
        command=ranges.command(category & 3, round(speed, 4), bool(signed > 0)),
        stance_side="left" if category & 8 else "right",
        settle_time=ranges.settle_time,
        noise_seed=noise_seed,
    )


def pelvis_scenarios(name: str, ranges: PushDistribution, blocks: int, seed: int) -> tuple[Scenario, ...]:
    """256 scenarios a block with one push each from `ranges`, every pair of factors stratified in each."""
    points, force = stratified_uniforms(blocks, 5, seed), uniform_force(ranges)
    drawn = (stratified_scenario(f"{name}-{i:04d}", ranges, force, u, i) for i, u in enumerate(points))
    return tuple(drawn)
