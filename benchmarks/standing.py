"""What robots hold that stand on both feet (docs/standing.md): `benchmarks/standing.py WHAT [ID ...]`.

WHAT is one of

- caught: the share of F*_stand that is caught in place, by direction: a push of 0.1 s at the pelvis of a
  robot at rest, the largest one before the first step, by bisection to 1 % of F*_stand;
- still: ten minutes without a push: steps, and how far the CoM was from where it began;
- changes: 200 changes of the command, from standing into a walk and back, every 3 s.
"""

import math
import sys

import gymnasium as gym
import numpy as np
from push_recovery.controllers.model.standing import max_standing_force
from push_recovery.envs.scenario.scenario import PROFILES
from push_recovery.eval.rollout.environments import profile_on

from push_recovery import Command, CommandChange, Push, Scenario, make_policy

STAND = Command(stand=True)
CAUGHT = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0", "PushRecovery/G1-v0"
ROBOTS = "PushRecovery/Biped-v0", "PushRecovery/G1-v0", "PushRecovery/T1-v0", "PushRecovery/JVRC1-v0"
VARIANTS = {"two-stage": (True, True), "stage-1+cop": (True, False), "stage-1+momentum": (False, True)}
MINUTES, CHANGES, PAUSE = 10.0, 200, 3.0  # [min], how many, [s] between two of them


def stays(env: gym.Env, policy: object, psi: float, force: float) -> bool:
    """Whether a push is survived without a step."""
    push = Push((force * math.cos(psi), force * math.sin(psi), 0.0), 0.1, 0.5)
    scenario = Scenario("standing", (push,), STAND, duration=4.0)
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


def caught(name: str) -> None:
    """Print the shares of a robot by its soles and trunk, by its soles and by its trunk."""
    env = gym.make(name)
    for variant, (soles, flywheel) in VARIANTS.items():
        policy = make_policy(variant, env)
        shares = [share(env, policy, psi, soles, flywheel) for psi in np.arange(16) * math.pi / 8]
        each = np.round(shares, 3)
        print(f"{name} {variant}: mean {np.mean(shares):.3f}, worst {min(shares):.3f}", each, flush=True)


def walked(name: str, profile: str, scenario: Scenario) -> tuple[bool, float, int, float]:
    """Whether a robot fell, when [s], its steps, and how far its CoM was from where it began [m]."""
    env = gym.make(name).unwrapped
    policy = make_policy("two-stage", env)
    seen, _ = env.reset(options={"scenario": profile_on(name, profile).applied(scenario)})
    begin, far, over, fell = env.episodes.motion().com[0].copy(), 0.0, False, False
    while not over:
        seen, _, fell, late, _ = env.step(policy.predict(seen)[0])
        motion = env.episodes.motion()
        far, over = max(far, float(np.linalg.norm(motion.com[0] - begin))), fell or late
    return bool(fell), float(motion.time[0]), int(motion.steps[0]), far


def still(name: str) -> None:
    """Print what became of a robot that nobody pushes."""
    for profile in PROFILES:
        fell, time, steps, far = walked(name, profile, Scenario("still", (), STAND, duration=60.0 * MINUTES))
        print(
            f"{name} {profile}: {time:.0f} s, fell {fell}, {steps} steps, CoM {1e3 * far:.1f} mm", flush=True
        )


def changes(name: str) -> None:
    """Print what became of a robot that is told to walk and to stand in turn."""
    draw = np.random.default_rng(7)
    commands = [
        STAND if i % 2 else Command(*draw.uniform([-0.2, -0.1, -0.3], [0.4, 0.1, 0.3]))
        for i in range(CHANGES)
    ]
    told = tuple(CommandChange(PAUSE * (i + 1), command) for i, command in enumerate(commands))
    for profile in PROFILES:
        fell, time, steps, _ = walked(name, profile, Scenario("changes", (), STAND, changes=told))
        print(f"{name} {profile}: {time:.0f} s of changes, fell {fell}, {steps} steps", flush=True)


if __name__ == "__main__":
    found = {"caught": (caught, CAUGHT), "still": (still, ROBOTS), "changes": (changes, ROBOTS)}
    if len(sys.argv) < 2 or sys.argv[1] not in found:
        raise SystemExit(f"{__doc__}\ngive one of {', '.join(found)}")
    measure, robots = found[sys.argv[1]]
    for robot in sys.argv[2:] or robots:
        measure(robot)
