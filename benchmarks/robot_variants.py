"""Walk variants of the biped for 60 s and scan their largest pushes beside the biped's and their own F*.

    python benchmarks/robot_variants.py [--only held] [--directions 8] [--grid 100] [--seconds 60]

A push of 0.1 s acts on the pelvis at the start of a left stance after four nominal steps, in place, as in
`push-recovery frontier --replicas 1`; the largest force that is survived before the first fall counts. The
bar is half of the biped's own in every direction. Exits with 1 where a variant falls while it walks or stays
below the bar.
"""

import argparse
import math
import sys

import numpy as np
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.biped import HELD_VARIANTS, ROBOT, VARIANTS
from push_recovery.envs.robots.description import RobotDescription
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario

WALKS = (Command(0.0), Command(0.3), Command(0.0, 0.1))  # [m/s]
DURATION = 0.1  # of a push [s]
SECONDS = 8.0  # of an episode with a push: four steps, the push and 4 s after it
LARGEST = 2400.0  # force tried [N]
BAR = 0.5  # share of the biped's force


def falls(description: RobotDescription, scenarios: list[Scenario], seconds: float) -> np.ndarray:
    """Which scenarios end in a fall within their time, side by side, (n,)."""
    episodes = BipedEpisodes(len(scenarios), robot=description)
    policy = make_policy("two-stage", episodes.robot, episodes.limits, description.preset)
    for k, scenario in enumerate(scenarios):
        episodes.begin(k, scenario)
    for _ in range(round(seconds * episodes.control_hz)):
        action = policy.predict(episodes.core.observation)[0]
        episodes.step(action.astype(np.float32))
    return episodes.failure() > 0


def survived(description: RobotDescription, directions: int, grid: float) -> np.ndarray:
    """Largest force before the first fall by direction, (directions,) [N]."""
    forces = np.arange(grid, LARGEST + 0.5 * grid, grid)
    event = GaitEvent(4, "left", 0.0)
    pushes = [
        polar_push(float(force), 2.0 * math.pi * k / directions, DURATION, event)
        for k in range(directions)
        for force in forces
    ]
    fell = falls(description, [Scenario(f"push-{i}", (push,)) for i, push in enumerate(pushes)], SECONDS)
    first = [int(row.argmax()) if row.any() else len(forces) for row in fell.reshape(directions, len(forces))]
    return grid * np.array(first)


def limits_of(description: RobotDescription, directions: int) -> np.ndarray:
    """F* of a robot's own box of steps by direction, (directions,) [N]."""
    episodes = BipedEpisodes(1, robot=description)
    angles = 2.0 * math.pi / directions * np.arange(directions)
    robot, limits = episodes.robot, episodes.limits
    return np.array([max_recoverable_force(robot, psi, DURATION, limits=limits) for psi in angles])


def main() -> int:
    """Measure, print a table and say whether the bar is met."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--directions", type=int, default=8, help="of the pushes (default: 8)")
    parser.add_argument("--grid", type=float, default=100.0, help="of their force [N] (default: 100)")
    parser.add_argument("--seconds", type=float, default=60.0, help="of walking [s] (default: 60)")
    parser.add_argument("--only", default="", help="variants whose name has this in it (default: all)")
    options = parser.parse_args()
    biped, good = survived(ROBOT, options.directions, options.grid), True
    print(f"{'robot':34} walks   largest force [N] by direction, counter-clockwise from forward; "
          "least share of the biped's, of its own F*")  # fmt: skip
    print(f"{'biped':34}         {' '.join(f'{force:5.0f}' for force in biped)}")
    for description in (one for one in (*VARIANTS, *HELD_VARIANTS) if options.only in one.name):
        walks = [Scenario(f"walk-{i}", (), command) for i, command in enumerate(WALKS)]
        fell = falls(description, walks, options.seconds)
        forces = survived(description, options.directions, options.grid)
        share = float((forces / biped).min())
        good &= not fell.any() and share >= BAR
        steady = f"{len(walks) - int(fell.sum())} of {len(walks)}"
        own = float((forces / limits_of(description, options.directions)).min())
        shown = " ".join(f"{force:5.0f}" for force in forces)
        print(f"{description.name:34} {steady}  {shown}  {share:.2f}  {own:.2f}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
