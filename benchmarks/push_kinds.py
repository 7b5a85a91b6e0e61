"""Pushes of equal impulse: off-centre, high, short, long, repeated. How many does a policy recover?

python benchmarks/push_kinds.py [--policy two-stage] [--impulses 60 80 100] [--directions 16] [--json]

In place, at the start and in the middle of a stance, in directions spread evenly. Every kind brings the same
impulse; the shares of a repeated one come two steps apart.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass

from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import Body, GaitEvent, Push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.episodes import rollout_batch

FIRST_STEP = 4
PHASES = (0.0, 0.5)
SLOTS = 32


@dataclass(frozen=True)
class Kind:
    """How an impulse is brought."""

    name: str
    duration: float = 0.1  # of each push [s]
    body: Body = "pelvis"
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # from the body's CoM [m]
    count: int = 1  # pushes that share it


KINDS = (
    Kind("pelvis, 0.1 s"),
    Kind("pelvis, 0.02 s", 0.02),
    Kind("pelvis, 0.5 s", 0.5),
    Kind("pelvis, 0.1 m to the left of its CoM", offset=(0.0, 0.1, 0.0)),
    Kind("pelvis, 0.1 m before its CoM", offset=(0.1, 0.0, 0.0)),
    Kind("trunk", body="trunk"),
    Kind("trunk, 0.25 m above its CoM", body="trunk", offset=(0.0, 0.0, 0.25)),
    Kind("pelvis, in 2 shares", count=2),
    Kind("pelvis, in 4 shares", count=4),
)


def scenarios(kind: Kind, impulse: float, directions: int) -> list[Scenario]:
    """One for each direction and phase of a left stance."""
    found = []
    for i in range(directions):
        for phase in PHASES:
            psi, force = 2.0 * math.pi * i / directions, impulse / (kind.count * kind.duration)
            pushes = tuple(
                Push(
                    (force * math.cos(psi), force * math.sin(psi), 0.0), kind.duration,
                    GaitEvent(FIRST_STEP + 2 * share, "left", phase), kind.body, kind.offset,
                )
                for share in range(kind.count)
            )  # fmt: skip
            found.append(Scenario(f"{kind.name}-{impulse:g}-{i}-{phase:g}", pushes))
    return found


def count(policy: str, kind: Kind, impulse: float, directions: int) -> dict[str, object]:
    """Recovered and survived pushes of one kind."""
    episodes = BipedEpisodes(SLOTS)
    planner = make_policy(policy, episodes.robot, episodes.limits, episodes.preset)
    out = list(rollout_batch(episodes, planner, scenarios(kind, impulse, directions), policy))
    return {
        "kind": kind.name, "impulse": impulse, "pushes": len(out),
        "recovered": sum(o.recovered for o in out), "survived": sum(o.survived for o in out),
    }  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--policy", default="two-stage", help="name (default: %(default)s)")
    parser.add_argument("--impulses", type=float, nargs="+", default=[60.0, 80.0, 100.0], help="[N s]")
    parser.add_argument("--directions", type=int, default=16, help="spread evenly (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    options = parser.parse_args()
    rows = [
        [count(options.policy, kind, impulse, options.directions) for impulse in options.impulses]
        for kind in KINDS
    ]
    if options.json:
        json.dump([entry for row in rows for entry in row], sys.stdout)
        return
    print("| push | " + " | ".join(f"{impulse:g} N s" for impulse in options.impulses) + " |")
    print("|---|" + "---|" * len(options.impulses))
    for row in rows:
        cells = " | ".join(f"{e['recovered']} / {e['survived']}" for e in row)
        print(f"| {row[0]['kind']} | {cells} |")


if __name__ == "__main__":
    main()
