"""Minutes of walking under random commands and pushes: how often does the robot fall?

python benchmarks/endurance.py [--policy two-stage] [--runs 20] [--minutes 10] [--frontier FILE FILE] [--json]

Every 5 s a new random command; every 3 s a push of 0.1 s on pelvis or trunk, at any phase of the step, half
of what the frontier of this body survives in its direction, seen from the robot (`frontier --body pelvis
--json` and the same with trunk; measured first without the files). The frontier is that of the start of a
left stance in place, the robot may stand on either foot: half of the one may be up to 0.8 of the other.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from push_recovery.controllers.policies.arms import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import BODIES, Push, polar_push
from push_recovery.envs.scenario.scenario import Command, CommandChange, Scenario
from push_recovery.eval.frontier.scan import FrontierSettings, frontier
from push_recovery.eval.rollout.batch import rollout_batch
from push_recovery.eval.rollout.outcome import Outcome

COMMAND_EVERY, PUSH_EVERY = 5.0, 3.0  # [s]
PHASE = 0.6  # a push comes up to this much later: longer than a step [s]
PUSH_DURATION = 0.1  # [s]
SLOWEST, FASTEST, SIDEWAYS = -0.25, 0.5, 0.2  # [m/s]
TURN = 0.3  # [rad/s]
Tables = dict[str, NDArray[np.float64]]  # by body, (directions, 2): psi [deg], force [N]


def measured_frontiers(policy: str, workers: int) -> list[dict[str, Any]]:
    """Survived forces by direction, in place, as `frontier --json` prints them."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for body in BODIES:
            settings = FrontierSettings("PushRecovery/Biped-v0", body=body)
            found.append(frontier(settings, [policy], 16, workers, Path(folder) / body).to_dict(policy))
    return found


def tables_of(frontiers: list[dict[str, Any]]) -> Tables:
    """Survived force by direction for each body."""
    tables = {
        found["push"]["body"]: np.array([[row["psi_deg"], row["survived_N"]] for row in found["directions"]])
        for found in frontiers
    }
    if missing := [body for body in BODIES if body not in tables]:
        raise SystemExit(f"--frontier needs a file of each body, missing: {', '.join(missing)}")
    return tables


def random_command(rng: np.random.Generator) -> Command:
    """Uniform within the limits."""
    return Command(rng.uniform(SLOWEST, FASTEST), rng.uniform(-SIDEWAYS, SIDEWAYS), rng.uniform(-TURN, TURN))


def random_push(rng: np.random.Generator, time: float, tables: Tables, share: float) -> Push:
    """A push at `time` [s] or up to PHASE later, `share` of the frontier in its direction."""
    psi, body = rng.uniform(0.0, 360.0), BODIES[int(rng.integers(len(BODIES)))]
    psis, survived = tables[body].T
    force = share * float(np.interp(psi, psis, survived, period=360.0))
    start = time + rng.uniform(0.0, PHASE)
    return polar_push(force, math.radians(psi), PUSH_DURATION, start, body, "heading")


def random_walk(seed: int, seconds: float, tables: Tables, share: float) -> Scenario:
    """One run."""
    rng = np.random.default_rng(seed)
    changes = [
        CommandChange(float(t), random_command(rng)) for t in np.arange(COMMAND_EVERY, seconds, COMMAND_EVERY)
    ]
    pushes = [
        random_push(rng, float(t), tables, share) for t in np.arange(PUSH_EVERY, seconds - 1.0, PUSH_EVERY)
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
        "--frontier", type=Path, nargs=2, help="what frontier --json has printed for pelvis and trunk"
    )
    parser.add_argument("--threads", type=int, default=1, help="of the physics (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of text")
    options = parser.parse_args()
    files = [json.loads(path.read_text()) for path in options.frontier or ()]
    tables = tables_of(files or measured_frontiers(options.policy, options.threads))
    episodes, seconds = BipedEpisodes(options.runs, threads=options.threads), 60.0 * options.minutes
    policy = make_policy(options.policy, episodes.robot, episodes.limits, episodes.preset)
    runs = [random_walk(seed, seconds, tables, options.share) for seed in range(options.runs)]
    found = {out.scenario_id: out for out in rollout_batch(episodes, policy, runs, options.policy)}
    outcomes = [found[run.id] for run in runs]
    if options.json:
        json.dump({"seconds": seconds, "outcomes": [asdict(out) for out in outcomes]}, sys.stdout)
    else:
        print(report(outcomes, seconds))


if __name__ == "__main__":
    main()
