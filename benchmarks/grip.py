"""What a robot believes of its floor's friction: not too little on a good one, soon enough on a slippery one.

python benchmarks/grip.py [--minutes 10] [--robots 8] [--noise 0.002]

First a walk under random commands on a floor of 0.9, whose believed friction must stay above 0.8; then pushes
on a floor of 0.4: how long one that slides for 0.1 s or more has truly slid until it knows.
Both with exact and with onboard sensing, all with noisy joints. Exits with 1 where a bar is not met.
"""

from __future__ import annotations

import argparse
import math
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from push_recovery.controllers.estimation.self_model import GRIP_MIN, SLIDES
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import base_angular_velocity, sole_motion
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import SENSING, Command, CommandChange, Scenario

GOOD, SLIPPERY = 0.9, GRIP_MIN  # friction of the two floors
KEPT, FOUND = 0.8, 2.0  # the bars: belief on the good floor, time of sliding on the slippery one [s]
SLIDE = 10  # periods that a slide lasts to count
LOADED = 60.0  # a sole with less load does not slide, it flies [N]
PERIOD = 0.01  # [s]
PUSH, PUSH_TIME, SECONDS = 500.0, 1.0, 6.0  # on the slippery floor [N], [s], [s]


class Course(NamedTuple):
    """Courses of n robots over the periods, (periods, n)."""

    grip: NDArray[np.float64]  # believed
    slides: NDArray[np.bool_]  # whether the loaded stance sole does, as the physics has it
    up: NDArray[np.bool_]


def walked(scenarios: list[Scenario], sensing: str, seconds: float) -> Course:
    """Walk side by side."""
    episodes, rows = BipedEpisodes(len(scenarios), sensing=sensing), []
    policy = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    for k, scenario in enumerate(scenarios):
        episodes.begin(k, scenario)
    core, n = episodes.core, len(scenarios)
    for _ in range(round(seconds / PERIOD)):
        episodes.step(policy.predict(core.observation)[0])
        rows.append((core.known.grip.copy(), [slides(core, k) for k in range(n)], core.gait.failure == 0))
    return Course(*(np.array(part) for part in zip(*rows, strict=True)))


def slides(core, k: int) -> bool:
    """Whether the stance sole of robot k truly does."""
    phys, stance = core.senses.last.judged, core.gait.stance[k]
    velocity = sole_motion(phys, k, stance, base_angular_velocity(phys, k)).velocity
    return bool(phys.load[k, stance] > LOADED and math.hypot(velocity[0], velocity[1]) > SLIDES)


def good_floor(robots: int, noise: float, minutes: float) -> list[Scenario]:
    """Walks under a random command every 5 s."""
    rng, errors = np.random.default_rng(0), ModelErrors(friction=GOOD, joint_noise=noise)

    def command() -> Command:
        return Command(rng.uniform(-0.25, 0.5), rng.uniform(-0.2, 0.2), rng.uniform(-0.3, 0.3))

    seconds = 60.0 * minutes
    return [
        Scenario(
            f"walk-{k}", (), command(), duration=seconds, errors=errors, noise_seed=k,
            changes=tuple(CommandChange(float(t), command()) for t in np.arange(5.0, seconds, 5.0)),
        )
        for k in range(robots)
    ]  # fmt: skip


def slippery_floor(robots: int, noise: float) -> list[Scenario]:
    """A push each, all around."""
    errors, angles = ModelErrors(friction=SLIPPERY, joint_noise=noise), 2.0 * math.pi / robots
    pushes = [polar_push(PUSH, angles * (k + 0.5), 0.1, PUSH_TIME) for k in range(robots)]
    return [
        Scenario(f"slide-{k}", (push,), Command(0.2), duration=SECONDS, errors=errors, noise_seed=k)
        for k, push in enumerate(pushes)
    ]


def slid_before(course: Course, k: int) -> tuple[float, bool] | None:
    """How long a robot has slid until it believed in the friction [s], and whether it did; None: no slide."""
    slides = course.slides[:, k] & course.up[:, k]
    if not (np.convolve(slides, np.ones(SLIDE, dtype=int), "valid") == SLIDE).any():
        return None
    found = np.flatnonzero(course.grip[:, k] <= 1.1 * SLIPPERY)
    end = int(found[0]) if len(found) else len(slides)
    return PERIOD * int(slides[:end].sum()), bool(len(found))


def main() -> int:
    """Measure, print and say whether the bars are met."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="of walking (default: %(default)s)")
    parser.add_argument("--robots", type=int, default=8, help="side by side (default: %(default)s)")
    parser.add_argument(
        "--noise", type=float, default=0.002, help="of the joints [rad] (default: %(default)s)"
    )
    options, good = parser.parse_args(), True
    for sensing in SENSING:
        course = walked(
            good_floor(options.robots, options.noise, options.minutes), sensing, 60 * options.minutes
        )
        least, fell = course.grip.min(), int((~course.up[-1]).sum())
        course = walked(slippery_floor(4 * options.robots, options.noise), sensing, SECONDS)
        found = [f for k in range(4 * options.robots) if (f := slid_before(course, k)) is not None]
        longest, knew = max(time for time, _ in found), sum(known for _, known in found)
        good &= bool(least > KEPT and longest < FOUND)
        print(
            f"{sensing}: floor {GOOD}, {options.minutes:g} min: believed at least {least:.3f}, {fell} fell;"
        )
        print(f"  floor {SLIPPERY}: {knew} of {len(found)} that slid know it, {longest:.2f} s slid at most")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
