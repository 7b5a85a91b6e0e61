"""Minutes of walking under random commands and pushes: how often does the robot fall?

python benchmarks/endurance.py [--policy two-stage] [--runs 20] [--minutes 10] [--frontier FILE.json] [--json]

Every 5 s a new random command; every 3 s a push of 0.1 s, half of what the frontier survives in its
direction (`frontier --json`; measured first without a file), at any phase of the step, on pelvis or trunk.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from push_recovery.controllers.policies import make_policy
from push_recovery.envs.biped_env import BipedEpisodes
from push_recovery.envs.push import BODIES, Push, polar_push
from push_recovery.envs.scenario import Command, CommandChange, Scenario
from push_recovery.eval.frontier import FrontierSettings, frontier
from push_recovery.eval.outcome import Outcome
from push_recovery.eval.rollout_batch import rollout_batch

COMMAND_EVERY, PUSH_EVERY = 5.0, 3.0  # [s]
PHASE = 0.6  # a push comes up to this much later: longer than a step [s]
PUSH_DURATION = 0.1  # [s]
SLOWEST, FASTEST, SIDEWAYS = -0.25, 0.5, 0.2  # [m/s]
TURN = 0.3  # [rad/s]
Table = NDArray[np.float64]  # (directions, 2): psi [deg], force [N]


def measured_frontier(policy: str) -> Table:
    """Survived force by direction, in place."""
    with tempfile.TemporaryDirectory() as folder:
        found = frontier(
            FrontierSettings("PushRecovery/Biped-v0"), [policy], 16, 2, Path(folder) / "frontier"
        )
    return np.array([[row["psi_deg"], row["survived_N"]] for row in found.rows[policy]])


def read_frontier(path: Path) -> Table:
    """The same of a file that `frontier --json` has printed."""
    rows = json.loads(path.read_text())["directions"]
    return np.array([[row["psi_deg"], row["survived_N"]] for row in rows])


def random_command(rng: np.random.Generator) -> Command:
    """Uniform within the limits."""
    return Command(rng.uniform(SLOWEST, FASTEST), rng.uniform(-SIDEWAYS, SIDEWAYS), rng.uniform(-TURN, TURN))


def random_push(rng: np.random.Generator, time: float, table: Table, share: float) -> Push:
    """A push at `time` [s] or up to PHASE later, `share` of the frontier in its direction."""
    psi = rng.uniform(0.0, 360.0)
    force = share * float(np.interp(psi, table[:, 0], table[:, 1], period=360.0))
    body = BODIES[int(rng.integers(len(BODIES)))]
    return polar_push(force, math.radians(psi), PUSH_DURATION, time + rng.uniform(0.0, PHASE), body)  # type: ignore[arg-type]


def random_walk(seed: int, seconds: float, table: Table, share: float) -> Scenario:
    """One run."""
    rng = np.random.default_rng(seed)
    changes = [
        CommandChange(float(t), random_command(rng)) for t in np.arange(COMMAND_EVERY, seconds, COMMAND_EVERY)
    ]
    pushes = [
        random_push(rng, float(t), table, share) for t in np.arange(PUSH_EVERY, seconds - 1.0, PUSH_EVERY)
    ]
    return Scenario(
        f"run-{seed}",
        tuple(pushes),
        random_command(rng),
        duration=seconds,
        noise_seed=seed,
        changes=tuple(changes),
    )


def report(outcomes: list[Outcome], seconds: float) -> str:
    """Falls and their times."""
    falls = [out for out in outcomes if not out.survived]
    walked = sum(out.end_time for out in outcomes)
    lines = [
        f"{len(falls)} of {len(outcomes)} runs of {seconds / 60:g} min fell; {walked / 60:.1f} min walked"
    ]
    lines += [f"  {out.scenario_id}: {out.failure_reason} at {out.end_time:.2f} s" for out in falls]
    return "\n".join(lines)


def main() -> None:
    """Walk, and say who fell when."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--policy", default="two-stage", help="name (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=20, help="side by side (default: %(default)s)")
    parser.add_argument("--minutes", type=float, default=10.0, help="each (default: %(default)s)")
    parser.add_argument("--share", type=float, default=0.5, help="of the frontier (default: %(default)s)")
    parser.add_argument(
        "--frontier", type=Path, help="what frontier --json has printed (measured if not given)"
    )
    parser.add_argument("--threads", type=int, default=1, help="of the physics (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of text")
    options = parser.parse_args()
    table = measured_frontier(options.policy) if options.frontier is None else read_frontier(options.frontier)
    episodes, seconds = BipedEpisodes(options.runs, threads=options.threads), 60.0 * options.minutes
    policy = make_policy(options.policy, episodes.robot, episodes.limits, episodes.preset)
    runs = [random_walk(seed, seconds, table, options.share) for seed in range(options.runs)]
    found = {out.scenario_id: out for out in rollout_batch(episodes, policy, runs, options.policy)}
    outcomes = [found[run.id] for run in runs]
    if options.json:
        json.dump({"seconds": seconds, "outcomes": [asdict(out) for out in outcomes]}, sys.stdout)
    else:
        print(report(outcomes, seconds))


if __name__ == "__main__":
    main()
