"""Put the variants and the learned policies of the package on the leaderboard of the documentation.

python benchmarks/leaderboard.py [--suite hard] [--board docs/leaderboard] [--sample 32]

Rows that are in runs/ already, as those of `tables.py`, are kept; the others are evaluated. Then a sample of
all rows is run again, and entries and page are written. The exit code is that of `submit`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from push_recovery.eval.cli.main import main as push_recovery
from push_recovery.eval.rollout import default_workers
from tables import compared

from push_recovery import evaluate

BOARD = Path(__file__).parents[1] / "docs" / "leaderboard"


def main(argv: Sequence[str] | None = None) -> int:
    """Evaluate and submit."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--suite", default="hard", help="name or file")
    parser.add_argument("--board", type=Path, default=BOARD)
    parser.add_argument("--sample", type=int, default=32, help="rows of each policy that are run again")
    parser.add_argument("--workers", type=int, default=default_workers())
    options = parser.parse_args(argv)
    found = evaluate(compared(), options.suite, workers=options.workers)
    words = {"--suite": options.suite, "--board": options.board, "--sample": options.sample}
    words["--workers"] = options.workers
    said = [str(word) for option in words.items() for word in option]
    return push_recovery(["submit", str(found.directory), *said])


if __name__ == "__main__":
    raise SystemExit(main())
