"""Share of F*_stand that robots are caught in place by, by direction: `benchmarks/standing.py [ID ...]`.

A push of 0.1 s at the pelvis of a robot at rest on both feet; the largest one before the first step is found
by bisection to 1 % of F*_stand, whose soles and flywheel are the robot's own (docs/standing.md).
"""

import math
import sys

import gymnasium as gym
import numpy as np
from push_recovery.controllers.model.standing import max_standing_force

from push_recovery import Command, Push, Scenario, make_policy

ROBOTS = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0"
VARIANTS = {"two-stage": (True, True), "stage-1+cop": (True, False), "stage-1+momentum": (False, True)}


def stays(env: gym.Env, policy: object, psi: float, force: float) -> bool:
    """Whether a push is survived without a step."""
    push = Push((force * math.cos(psi), force * math.sin(psi), 0.0), 0.1, 0.5)
    scenario = Scenario("standing", (push,), Command(stand=True), duration=4.0)
    seen, _ = env.reset(options={"scenario": scenario})
    over = fell = False
    while not over:
        seen, _, fell, late, _ = env.step(policy.predict(seen)[0])
        if seen[0] >= 0.0:
            return False
        over = fell or late
    return not fell


def share(env: gym.Env, policy: object, psi: float, soles: bool, flywheel: bool) -> float:
    """Of F*_stand, the largest push that is survived without a step."""
    episodes = env.unwrapped.episodes
    limit = max_standing_force(episodes.robot, psi, soles=soles, flywheel=flywheel, limits=episodes.limits)
    low, high = 0.0, 1.05
    while high - low > 0.01:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stays(env, policy, psi, middle * limit) else (low, middle)
    return low


for name in sys.argv[1:] or ROBOTS:
    env = gym.make(name)
    for variant, (soles, flywheel) in VARIANTS.items():
        policy = make_policy(variant, env)
        shares = [share(env, policy, psi, soles, flywheel) for psi in np.arange(16) * math.pi / 8]
        print(
            f"{name} {variant}: mean {np.mean(shares):.3f}, worst {min(shares):.3f}",
            np.round(shares, 3),
            flush=True,
        )
