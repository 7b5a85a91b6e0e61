"""Walks without a push, and pushes of half the largest, on slopes, tiles and stairs.

python benchmarks/terrain.py [--robots biped g1] [--kinds slope tiles known] [--runs 20] [--seconds S]
                             [--frontier FILE]

Slopes rise by 5 degrees in a drawn direction, tiles are up to 2 cm apart in height; control knows neither.
Stairs have three steps of 10 cm up and down, which it knows, scaled to the robot as all lengths are; the walk
begins with another foot, at another speed and at another distance from the first step. Pushes are half of F*
of the robot's own box in a drawn direction, for 0.1 s, at the start of a left stance. With `--frontier` they
are half of what 0.8 of the replicas recover from on the level floor, by the frontier.json of `push-recovery
frontier` of this one robot.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from push_recovery.controllers.model.robot import Similarity
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.envs.scenario.terrain import Stairs
from push_recovery.eval.rollout.episodes import rollout_batch
from push_recovery.eval.score.limits import own_limit_force

from push_recovery import describe  # noqa: F401  registers the robots

SEED = 20_261_126
STEEP = math.radians(5.0)
PUSHED_FOR = 0.1  # [s]


def floors(rng: np.random.Generator, tall: float) -> dict[str, tuple[ModelErrors, Command]]:
    """One floor of each kind and a command to walk on it, for a robot whose CoM is 0.8 m high."""
    way, speed = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.1, 0.3)
    command = Command(speed, rng.uniform(-0.1, 0.1))
    slope = ModelErrors(slope_forward=STEEP * math.cos(way), slope_left=STEEP * math.sin(way))
    stairs = Stairs(tall, 3, start=rng.uniform(0.5, 0.8), tread=0.35, landing=0.8)
    return {
        "slope of 5 degrees": (slope, command),
        "tiles up to 2 cm": (ModelErrors(floor_step=0.02), command),
        "known steps of 10 cm": (ModelErrors(terrain=stairs, floor_known=True), Command(speed)),
        "known steps of 10 cm, down first": (
            ModelErrors(terrain=replace(stairs, rise=-tall), floor_known=True), Command(speed)
        ),
    }  # fmt: skip


def walks(runs: int, seconds: float) -> Iterator[tuple[str, Scenario]]:
    """Kind of floor and walk over it, in turn."""
    for run, seed in enumerate(np.random.SeedSequence(SEED).spawn(runs)):
        rng = np.random.default_rng(seed)
        for kind, (errors, command) in floors(rng, 0.1).items():
            stairs = errors.terrain
            time = seconds if not isinstance(stairs, Stairs) else (stairs.end + 0.6) / command.vx
            side = "left" if run % 2 else "right"
            yield (
                kind,
                Scenario(f"{kind} {run}", (), command, side, duration=time, errors=errors, noise_seed=run),
            )  # type: ignore[arg-type]


def main() -> None:
    """Print for each robot and kind of floor how many walks stay up and end at their speed, and recoveries.

    A robot that steps in place before a step that it does not climb stays up, but not at its speed.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=["biped", "g1"])
    parser.add_argument("--kinds", nargs="+", default=[""], help="those that begin so (default: all)")
    parser.add_argument("--runs", type=int, default=20, help="of each kind (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=300.0, help="of walks (default: %(default)s)")
    parser.add_argument("--frontier", type=Path, help="frontier.json of the robot (default: half of F*)")
    options = parser.parse_args()
    if options.frontier and len(options.robots) > 1:
        parser.error("--frontier is of one robot: name it with --robots")
    frontier = json.loads(options.frontier.read_text())["directions"] if options.frontier else []
    for name in options.robots:
        own = {} if name == "biped" else {"robot": name, "preset": name}
        episodes = BipedEpisodes(options.runs, threads=2, **own)
        planner = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
        size = Similarity.of(episodes.robot)
        found = [(kind, one.scaled(size)) for kind, one in walks(options.runs, options.seconds)]
        kinds = dict.fromkeys(kind for kind, _ in found if kind.startswith(tuple(options.kinds)))
        for kind in kinds:
            unpushed = [one for own_kind, one in found if own_kind == kind]
            walked = list(rollout_batch(episodes, planner, unpushed, "two-stage"))
            up, kept = (sum(getattr(one, name) for one in walked) for name in ("survived", "recovered"))
            pushed = [with_push(episodes, one, run, frontier) for run, one in enumerate(unpushed)]
            back = sum(one.recovered for one in rollout_batch(episodes, planner, pushed, "two-stage"))
            runs = len(unpushed)
            print(f"| {name} | {kind} | {up} of {runs} | {kept} of {runs} | {back} of {runs} |", flush=True)


def with_push(
    episodes: BipedEpisodes, walk: Scenario, run: int, frontier: Sequence[Mapping[str, float]]
) -> Scenario:
    """The same walk under a push of half the largest, at a drawn step, judged as in suites.

    The largest is that of the frontier, where its directions are given, and otherwise F*.
    """
    rng = np.random.default_rng(np.random.SeedSequence([SEED, run]))
    psi = rng.uniform(0.0, 2.0 * math.pi)
    if frontier:
        angles, forces = ([one[key] for one in frontier] for key in ("psi_deg", "threshold_N"))
        largest = float(np.interp(math.degrees(psi), angles, forces, period=360.0))
    else:
        largest = own_limit_force(SimpleNamespace(unwrapped=episodes), psi, PUSHED_FOR, walk.command)  # type: ignore[arg-type]
    start = GaitEvent(int(rng.integers(4, 12)), "left", 0.0)
    push = polar_push(0.5 * largest, psi, PUSHED_FOR, start)
    return replace(walk, id=f"{walk.id} pushed", pushes=(push,), duration=None)


if __name__ == "__main__":
    main()
