"""Impactors against constant forces of the same impulse and contact time: are as many recovered from?

python benchmarks/impactors.py [--policy two-stage] [--momenta 60 90 120 150] [--mass 15] [--directions 16]
python benchmarks/impactors.py --momenta 35.2 --directions 1     the impactor on Digit, by mass

In place, at the start and in the middle of either stance, in directions spread evenly. Each impactor is run
first; its impulse and the time of its contact are measured. Then the same robot at the same moment gets a
constant force of that impulse for that time.
"""

from __future__ import annotations

import argparse
import math
from statistics import fmean

import numpy as np
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.disturbances import Impactor, towards
from push_recovery.envs.scenario.model_errors import CONTROL_STEP
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.output.statistics import PairedCounts, wilson_interval
from push_recovery.eval.rollout.episodes import rollout_batch

MOMENTS = [GaitEvent(4, side, phase) for side in ("left", "right") for phase in (0.0, 0.5)]
SLOTS = 64


def contacts(episodes: BipedEpisodes, planner, scenarios: list[Scenario]) -> list[tuple[float, float]]:
    """Impulse [N s] and time of contact [s] of the impactor of each scenario."""
    found = []
    for first in range(0, len(scenarios), episodes.n):
        batch, steps = scenarios[first : first + episodes.n], np.zeros(episodes.n)
        for k in range(episodes.n):
            episodes.begin(k, batch[min(k, len(batch) - 1)])
        core = episodes.core

        def look(core=core, steps=steps) -> None:
            steps += core.physics.xfrc.any(axis=(1, 2))

        core.after_physics_step = look
        while not np.all(core.gait.time > core.pushes.start[:, 0] + core.pushes.duration[:, 0]):
            episodes.step(planner.predict(core.observation)[0])
        core.after_physics_step = None
        impulses = np.linalg.norm(core.pushes.delivered[:, 0], axis=1)
        found += [(impulses[k], steps[k] * CONTROL_STEP) for k in range(len(batch))]
    return found


def rows_of(episodes: BipedEpisodes, planner, scenarios: list[Scenario], policy: str) -> list[dict]:
    """Rows of scenarios in their order."""
    outcomes = rollout_batch(episodes, planner, scenarios, policy)
    rows = {outcome.scenario_id: outcome.to_dict() for outcome in outcomes}
    return [rows[scenario.id] for scenario in scenarios]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--policy", default="two-stage", help="name (default: %(default)s)")
    parser.add_argument("--momenta", type=float, nargs="+", default=[60.0, 90.0, 120.0, 150.0], help="[N s]")
    parser.add_argument("--mass", type=float, default=15.0, help="of the impactor [kg]")
    parser.add_argument("--directions", type=int, default=16, help="spread evenly (default: %(default)s)")
    options = parser.parse_args()
    episodes = BipedEpisodes(SLOTS)
    planner = make_policy(options.policy, episodes.robot, episodes.limits, episodes.preset)
    columns = "momentum [N s]", "impulse [N s]", "contact [ms]", "hits", "impactor", "force", "difference"
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}")
    for momentum in options.momenta:
        angles = [2.0 * math.pi * i / options.directions for i in range(options.directions)]
        cases = [(psi, moment) for psi in angles for moment in MOMENTS]
        hits = [Impactor(options.mass, momentum / options.mass, moment, psi) for psi, moment in cases]
        struck = [Scenario(f"hit-{i}", disturbances=(hit,)) for i, hit in enumerate(hits)]
        felt = contacts(episodes, planner, struck)
        pushed = [
            Scenario(f"hit-{i}", (Push(towards(psi, impulse / time), time, moment, frame="heading"),))
            for i, ((psi, moment), (impulse, time)) in enumerate(zip(cases, felt, strict=True))
        ]
        a, b = (rows_of(episodes, planner, some, options.policy) for some in (struck, pushed))
        counts = PairedCounts.of_rows(a, b)
        low, high = counts.interval
        shares = []
        for rows in (a, b):
            recovered = sum(row["recovered"] for row in rows)
            ends = wilson_interval(recovered, len(rows))
            shares.append(f"{recovered} ({100 * ends[0]:.0f}-{100 * ends[1]:.0f} %)")
        impulse, time = fmean(j for j, _ in felt), 1e3 * fmean(t for _, t in felt)
        difference = f"{100 * counts.rate_difference:+.1f} ({100 * low:+.1f} to {100 * high:+.1f})"
        cells = f"{momentum:g}", f"{impulse:.1f}", f"{time:.0f}", str(len(hits)), *shares, difference
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
