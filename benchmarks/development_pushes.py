"""Draw pushes like those of `hard` that no suite has: python benchmarks/development_pushes.py FILE [SEED].

For figures that are looked at while something is being built; the shipped suites stay for what is final.
"""

from __future__ import annotations

import sys
from pathlib import Path

from push_recovery.envs.scenario.push_distribution import PushDistribution
from push_recovery.eval.score.stratified import BLOCK, stratified_scenario, stratified_uniforms
from push_recovery.eval.score.suites import Suite

RANGES = PushDistribution(impulse_min=80.0, impulse_max=200.0)
SEED = 20270115
BLOCKS = 4  # of which the first is taken


def force_of(share: float, _psi: float, _side: str) -> float:
    """Force [N] at a share in [0, 1] of the range of impulses."""
    return (RANGES.impulse_min + share * (RANGES.impulse_max - RANGES.impulse_min)) / RANGES.push_duration


def main() -> None:
    """Write the suite."""
    path, seed = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else SEED
    points = stratified_uniforms(blocks=BLOCKS, factors=5, seed=seed)[:BLOCK]
    drawn = [stratified_scenario(f"dev-{i:04d}", RANGES, force_of, u, i) for i, u in enumerate(points)]
    suite = Suite(f"dev-{BLOCK}", "1" if seed == SEED else f"seed {seed}", tuple(drawn))
    suite.save(path)
    print(f"{path}: {len(drawn)} pushes, sha256 {suite.sha256[:12]}")


if __name__ == "__main__":
    main()
