"""Pushes of a suite on a robot's own sensors: recoveries, errors of the estimate, how honest it is of them.

python benchmarks/onboard.py [--suite hard] [--every 8] [--profile exact] [--policy two-stage] [--walk 20]

Errors are those at the end of every planning period until the episode ends or the robot falls. `stated` is
the root mean square of error over the standard deviation that the estimate states: 1 where it is honest, more
where it is too sure of itself. How well a metre of walking is known comes from walks without a push.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from push_recovery.controllers.estimation.base_estimate import deviations
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import PELVIS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.scenario import Command, Scenario, get_profile
from push_recovery.eval.rollout.episodes import rollout_batch
from push_recovery.eval.score.suites import get_suite

METRE = 1.0  # of walking [m]
COMMANDS = (Command(0.5), Command(0.3, 0.1), Command(0.4, turn=0.3), Command(-0.25))


class Errors(NamedTuple):
    """What n robots that are up believe wrongly, and how sure they are."""

    velocity: NDArray[np.float64]  # (n, 3) of the base, world axes [m/s]
    tilt: NDArray[np.float64]  # (n, 2) of the pelvis' vertical axis [rad]
    velocity_stated: NDArray[np.float64]  # (n, 3) [m/s]
    tilt_stated: NDArray[np.float64]  # (n, 2) [rad]
    heading: NDArray[np.float64]  # (n,) of the pelvis [rad]


def errors_of(core) -> Errors:
    """At this moment."""
    up, sensing = core.gait.failure == 0, core.senses.last
    velocity = core.physics.qvel[up, :3] - sensing.judged.qvel[up, :3]
    tilt = core.physics.xmat[up, PELVIS, 2:6:3] - sensing.judged.xmat[up, PELVIS, 2:6:3]
    headings = [p.xmat[up, PELVIS, 0] + 1j * p.xmat[up, PELVIS, 3] for p in (core.physics, sensing.judged)]
    stated = deviations(core.estimate)
    velocities = np.column_stack([stated.velocity, stated.velocity, stated.climb])[up]
    tilts = np.column_stack([stated.tilt, stated.tilt])[up]
    return Errors(velocity, tilt, velocities, tilts, np.angle(headings[0] * headings[1].conj()))


def watched(episodes: BipedEpisodes, found: list[Errors]) -> None:
    """Append the errors after every planning period to `found`."""
    core, step = episodes.core, episodes.core.step

    def step_and_look(gaits, actions) -> None:
        step(gaits, actions)
        found.append(errors_of(core))

    core.step = step_and_look


def pushed(options: argparse.Namespace, sensing: str) -> None:
    """Run the suite's pushes, and print what came out."""
    profile = get_profile(options.profile)
    scenarios = [profile.applied(s) for s in get_suite(options.suite).scenarios[:: options.every]]
    episodes, found = BipedEpisodes(32, sensing=sensing), list[Errors]()
    if sensing == "onboard":
        watched(episodes, found)
    policy = make_policy(options.policy, episodes.robot, episodes.limits, episodes.preset)
    outcomes = list(rollout_batch(episodes, policy, scenarios, options.policy))
    recovered, survived = (sum(getattr(o, name) for o in outcomes) for name in ("recovered", "survived"))
    print(f"{options.suite} {options.profile} {sensing}: ", end="")
    print(f"recovered {recovered}, survived {survived} of {len(outcomes)}")
    if found:
        report(Errors(*(np.concatenate(part) for part in zip(*found, strict=True))))


def report(errors: Errors) -> None:
    """Root mean squares, and how they stand to what was stated."""
    rms = np.sqrt((errors.velocity**2).mean(axis=0))
    tilt = np.degrees(np.sqrt((errors.tilt**2).sum(axis=1).mean()))
    ratios = np.square(errors.velocity / errors.velocity_stated), np.square(errors.tilt / errors.tilt_stated)
    level, climb, lean = (np.sqrt(r.mean()) for r in (ratios[0][:, :2], ratios[0][:, 2], ratios[1]))
    heading = np.degrees(np.sqrt((errors.heading**2).mean()))
    print(f"  base velocity rms {rms.round(4)} m/s, tilt {tilt:.2f}, heading {heading:.2f} degrees")
    print(f"  stated: horizontal velocity {level:.2f}, vertical {climb:.2f}, tilt {lean:.2f}")


def walked(options: argparse.Namespace) -> float:
    """Root mean square of how far the robot is off after each metre that it has truly walked [m]."""
    profile, episodes = get_profile(options.profile), BipedEpisodes(len(COMMANDS), sensing="onboard")
    policy = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    for k, command in enumerate(COMMANDS):
        scenario = Scenario(f"walk-{k}", (), command, duration=options.walk, noise_seed=k)
        episodes.begin(k, profile.applied(scenario))
    core, last, off = episodes.core, None, []
    for _ in range(round(options.walk * episodes.control_hz)):
        episodes.step(policy.predict(core.observation)[0])
        places = np.stack([core.physics.qpos[:, :2], core.senses.last.judged.qpos[:, :2]])
        last = places.copy() if last is None else last
        moved = places - last
        for k in np.flatnonzero(np.linalg.norm(moved[1], axis=1) >= METRE):
            off.append(np.linalg.norm(moved[0, k] - moved[1, k]))
            last[:, k] = places[:, k]
    return float(np.sqrt(np.mean(np.square(off))))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--suite", default="hard", help="(default: %(default)s)")
    parser.add_argument("--every", type=int, default=8, help="one scenario in so many (default: %(default)s)")
    parser.add_argument("--profile", default="exact", help="of the robot (default: %(default)s)")
    parser.add_argument("--policy", default="two-stage", help="(default: %(default)s)")
    parser.add_argument("--walk", type=float, default=20.0, help="seconds of walking (default: %(default)s)")
    options = parser.parse_args()
    for sensing in ("exact", "onboard"):
        pushed(options, sensing)
    print(f"  a metre of walking is known to {walked(options):.4f} m (rms)")


if __name__ == "__main__":
    main()
