"""A floor that tilts and comes back: from how many of its tilts does a policy recover?

python benchmarks/tilting_platform.py [--policies two-stage herdt] [--degrees 8 16] [--rate 0.5] [--stand]

The floor goes down towards directions spread evenly, from the start and the middle of a left stance in place,
or under a robot that stands. It stays so for half a second and tilts back.
"""

from __future__ import annotations

import argparse
import math
import tempfile

from push_recovery.envs.scenario.disturbances import TiltingPlatform
from push_recovery.eval.output.tables import markdown_table
from push_recovery.eval.score.suites import Suite

from push_recovery import Command, GaitEvent, Scenario, evaluate


def tilts(degrees: float, rate: float, directions: int, stand: bool) -> list[Scenario]:
    """One for each direction and phase; rate [rad/s]."""
    moments = (1.0, 1.25) if stand else (GaitEvent(4, "left", 0.0), GaitEvent(4, "left", 0.5))
    found = []
    for i in range(directions):
        towards = 2.0 * math.pi * i / directions
        for phase, start in enumerate(moments):
            tilt = TiltingPlatform(math.radians(degrees), rate, start, towards)
            name = f"{degrees:g}-{i}-{phase}"
            found.append(Scenario(name, command=Command(stand=stand), disturbances=(tilt,)))
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--env", default="PushRecovery/Biped-v0", help="id (default: %(default)s)")
    parser.add_argument("--policies", nargs="+", default=["two-stage"], help="names (default: two-stage)")
    parser.add_argument("--degrees", type=float, nargs="+", default=[8.0, 12.0, 16.0], help="angles")
    parser.add_argument("--rate", type=float, default=0.5, help="at most [rad/s] (default: %(default)s)")
    parser.add_argument("--directions", type=int, default=16, help="spread evenly (default: %(default)s)")
    parser.add_argument("--stand", action="store_true", help="robots stand on both feet")
    parser.add_argument("--profile", default="exact", help="of the robots (default: %(default)s)")
    options = parser.parse_args()
    how = options.rate, options.directions, options.stand
    scenarios = [scenario for angle in options.degrees for scenario in tilts(angle, *how)]
    suite = Suite("tilts", "1", tuple(scenarios))
    with tempfile.TemporaryDirectory() as directory:
        found = evaluate(
            options.policies, suite, options.env, profile=options.profile, workers=2, out=directory
        )
    table = []
    for policy, rows in found.rows.items():
        cells = [policy]
        for angle in options.degrees:
            own = [row for row in rows if row["scenario_id"].startswith(f"{angle:g}-")]
            recovered, survived = (sum(row[name] for row in own) for name in ("recovered", "survived"))
            cells.append(f"{recovered} / {survived} of {len(own)}")
        table.append(cells)
    print(markdown_table(["policy", *(f"{angle:g} degrees" for angle in options.degrees)], table))


if __name__ == "__main__":
    main()
