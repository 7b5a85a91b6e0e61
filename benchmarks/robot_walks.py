"""Let robots walk at five commands and print by how much they miss them.

    python benchmarks/robot_walks.py [--robots g1 t1 FILE.json] [--seconds 60]

Commands are those of the biped, scaled by the square root of the CoM's height; the mean speed is that of the
last three quarters of the time. Exits with 1 where a robot falls.
"""

import argparse
import sys

import numpy as np
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.scenario import Command, Scenario

COMMANDS = np.array([(0.0, 0.0), (0.3, 0.0), (0.5, 0.0), (-0.25, 0.0), (0.0, 0.15)])  # the biped's [m/s]


def walk(robot: str, seconds: float) -> tuple[np.ndarray, np.ndarray, bool]:
    """Commands and errors of the mean speed, (5, 2) [m/s], and whether one of the robots fell."""
    episodes = BipedEpisodes(len(COMMANDS), robot=robot)
    commands = COMMANDS * (episodes.robot.com_height / BIPED.com_height) ** 0.5
    policy = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    for k, command in enumerate(commands):
        episodes.begin(k, Scenario(f"walk-{k}", (), Command(*command)))
    periods, start = round(seconds * episodes.control_hz), episodes.core.com.copy()
    for period in range(periods):
        if period == periods // 4:
            start = episodes.core.com.copy()
        episodes.step(policy.predict(episodes.core.observation)[0].astype(np.float32))
    speed = (episodes.core.com - start) / ((periods - periods // 4) / episodes.control_hz)
    return commands, speed - commands, bool(episodes.failure().any())


def main() -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=["g1", "t1"], help="names or robot files")
    parser.add_argument("--seconds", type=float, default=60.0, help="of walking [s] (default: 60)")
    options, fell = parser.parse_args(), False
    for robot in options.robots:
        commands, errors, down = walk(robot, options.seconds)
        shown = [f"{x:.2f}, {y:.2f}: {1000 * ex:.0f}, {1000 * ey:.0f}"
                 for (x, y), (ex, ey) in zip(commands, errors, strict=True)]  # fmt: skip
        print(f"{robot}: command x, y [m/s]: error [mm/s]; {'; '.join(shown)}{'; fell' if down else ''}")
        fell |= down
    return int(fell)


if __name__ == "__main__":
    sys.exit(main())
