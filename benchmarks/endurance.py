"""Minutes of walking under random commands and pushes: how often does the robot fall?

python benchmarks/endurance.py [--profile hardware] [--share 0.333] [--runs 20] [--minutes 10] [--out DIR]

Every 5 s a new random command; every 3 s a push of 0.1 s on pelvis or trunk, at any phase of the step, a
share of what the frontier of this body survives in its direction, seen from the robot. Unless `--frontier`
gives both (`frontier --body pelvis --json` and the same with trunk), the frontier is measured first, on the
same robot: it is that of the start of a left stance in place, and the robot may stand on either foot, so half
of the one may be up to 0.8 of the other. What `--out` holds already is not done again.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from push_recovery.controllers.files import write_text
from push_recovery.controllers.policies.interface import Policy
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import Push, polar_push
from push_recovery.envs.scenario.scenario import Command, CommandChange, Scenario, get_profile
from push_recovery.eval.output.rows import RowFile
from push_recovery.eval.rollout.environments import code_digest
from push_recovery.eval.rollout.episodes import rollout_batch
from push_recovery.eval.score.frontier import FrontierSettings
from push_recovery.eval.score.threshold import BEYOND, Scanned, directions_deg, multiples, scan_upwards

COMMAND_EVERY, PUSH_EVERY = 5.0, 3.0  # [s]
PHASE = 0.6  # a push comes up to this much later: longer than a step [s]
PUSH_DURATION = 0.1  # [s]
SLOWEST, FASTEST, SIDEWAYS = -0.25, 0.5, 0.2  # [m/s]
TURN = 0.3  # [rad/s]
PUSHED = ("pelvis", "trunk")  # bodies
SIDE_BY_SIDE = 8  # forces of a scan
Tables = dict[str, NDArray[np.float64]]  # by body, (directions, 2): psi [deg], force [N]
Row = dict[str, Any]


def largest_survived(options: argparse.Namespace, policy: Policy, episodes: BipedEpisodes, body: Any) -> Row:
    """Survived forces by direction, in place, of a robot of the profile; keys as `frontier --json` has."""
    settings = FrontierSettings("PushRecovery/Biped-v0", body=body, profile=options.profile)
    rows = []
    for psi in directions_deg(options.directions):

        def run(forces: Iterator[float], psi: float = psi) -> Iterator[tuple[float, bool]]:
            force_of: dict[str, float] = {}

            def scenarios() -> Iterator[Scenario]:
                for force in forces:
                    scenario = settings.scenario(psi, force)
                    force_of[scenario.id] = force
                    yield scenario

            for out in rollout_batch(episodes, policy, scenarios(), options.policy):
                yield force_of[out.scenario_id], out.survived

        found = Scanned.of(scan_upwards(run, multiples(options.grid), BEYOND, bool))
        rows.append({"psi_deg": psi, "survived_N": found.survived})
        print(f"{body} {psi:5.1f} deg: {found.survived:g} N", file=sys.stderr, flush=True)
    return {"push": {"body": body, "duration": PUSH_DURATION}, "directions": rows}


def measured_frontiers(options: argparse.Namespace) -> list[Row]:
    """The frontiers of pelvis and trunk; kept in `--out`."""
    path = options.out / "frontier.json"
    if not path.exists():
        episodes = BipedEpisodes(SIDE_BY_SIDE, threads=options.threads, sensing=options.sensing)
        policy = make_policy(options.policy, episodes.robot, episodes.limits, episodes.preset)
        found = [largest_survived(options, policy, episodes, body) for body in PUSHED]
        write_text(path, json.dumps(found, indent=1) + "\n")
    return json.loads(path.read_text())


def tables_of(frontiers: list[Row]) -> Tables:
    """Survived force by direction for each body."""
    tables = {
        found["push"]["body"]: np.array([[row["psi_deg"], row["survived_N"]] for row in found["directions"]])
        for found in frontiers
    }
    if missing := [body for body in PUSHED if body not in tables]:
        raise SystemExit(f"--frontier needs a file of each body, missing: {', '.join(missing)}")
    return tables


def random_command(rng: np.random.Generator) -> Command:
    """Uniform within the limits."""
    return Command(rng.uniform(SLOWEST, FASTEST), rng.uniform(-SIDEWAYS, SIDEWAYS), rng.uniform(-TURN, TURN))


def random_push(rng: np.random.Generator, time: float, tables: Tables, share: float) -> Push:
    """A push at `time` [s] or up to PHASE later, `share` of the frontier in its direction."""
    psi, body = rng.uniform(0.0, 360.0), PUSHED[int(rng.integers(len(PUSHED)))]
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


def walk(options: argparse.Namespace, tables: Tables) -> list[Row]:
    """Rows of all runs, kept in `--out` as they finish."""
    seconds, profile = 60.0 * options.minutes, get_profile(options.profile)
    told = {name: getattr(options, name) for name in ("policy", "profile", "sensing", "share", "minutes")}
    pushes = {body: table.tolist() for body, table in tables.items()}
    rows = RowFile(options.out, {**told, "frontier": pushes, "code": code_digest()}, ("scenario_id",))
    runs = [random_walk(seed, seconds, tables, options.share) for seed in range(options.runs)]
    left = [profile.applied(run) for run in runs if (run.id,) not in rows.rows]
    if left:
        episodes = BipedEpisodes(
            min(len(left), options.together), threads=options.threads, sensing=options.sensing
        )
        policy = make_policy(options.policy, episodes.robot, episodes.limits, episodes.preset)
        for out in rollout_batch(episodes, policy, left, options.policy):
            rows.append(asdict(out))
    rows.close()
    return [rows.rows[run.id,] for run in runs]


def report(rows: list[Row], seconds: float) -> str:
    """Falls: when, why, and what bound the robot met first since its first push."""
    falls = [row for row in rows if not row["survived"]]
    walked = sum(row["end_time"] for row in rows) / 60.0
    lines = [f"{len(falls)} of {len(rows)} runs of {seconds / 60:g} min fell; {walked:.1f} min walked"]
    lines += [f"  {row['scenario_id']}: {row['failure_reason']} at {row['end_time']:.2f} s" for row in falls]
    return "\n".join(lines)


def options_of() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--policy", default="two-stage", help="name (default: %(default)s)")
    parser.add_argument("--profile", default="exact", help="of the robot (default: %(default)s)")
    parser.add_argument("--sensing", help="exact or onboard, whatever the profile says")
    parser.add_argument("--runs", type=int, default=20, help="(default: %(default)s)")
    parser.add_argument("--together", type=int, default=20, help="runs side by side (default: %(default)s)")
    parser.add_argument("--minutes", type=float, default=10.0, help="each (default: %(default)s)")
    parser.add_argument("--share", type=float, default=0.5, help="of the frontier (default: %(default)s)")
    parser.add_argument("--directions", type=int, default=16, help="of the frontier (default: %(default)s)")
    parser.add_argument("--grid", type=float, default=20.0, help="of its force [N] (default: %(default)s)")
    parser.add_argument(
        "--frontier", type=Path, nargs=2, help="what frontier --json has printed for pelvis and trunk"
    )
    parser.add_argument("--out", type=Path, help="keeps frontier and rows (default: nothing is kept)")
    parser.add_argument("--threads", type=int, default=1, help="of the physics (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of text")
    return parser.parse_args()


def main() -> None:
    """Walk, and say who fell when."""
    options = options_of()
    with tempfile.TemporaryDirectory() as folder:
        options.out = options.out or Path(folder)
        options.out.mkdir(parents=True, exist_ok=True)
        files = [json.loads(path.read_text()) for path in options.frontier or ()]
        rows = walk(options, tables_of(files or measured_frontiers(options)))
    if options.json:
        print(json.dumps({"seconds": 60.0 * options.minutes, "outcomes": rows}))
    else:
        print(report(rows, 60.0 * options.minutes))


if __name__ == "__main__":
    main()
