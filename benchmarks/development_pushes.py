"""Draw pushes like those of `hard` that no suite has: python benchmarks/development_pushes.py FILE [SEED].

For figures that are looked at while something is being built; the shipped suites stay for what is final.
"""

from __future__ import annotations

import sys
from pathlib import Path

from push_recovery.eval.score.draw import BLOCK
from push_recovery.eval.score.kinds import DRAWS
from push_recovery.eval.score.suites import Suite

SEED = 20270115
BLOCKS = 4  # of which the first is taken


def main() -> None:
    """Write the suite."""
    path, seed = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else SEED
    drawn = DRAWS["hard"].stratified("dev", BLOCKS, seed)[:BLOCK]
    suite = Suite(f"dev-{BLOCK}", "1" if seed == SEED else f"seed {seed}", drawn)
    suite.save(path)
    print(f"{path}: {len(drawn)} pushes, sha256 {suite.sha256[:12]}")


if __name__ == "__main__":
    main()
