"""Walk for 60 s under seven commands: mean speed in the robot's frame, largest heading error, falls."""

import math

import gymnasium as gym
import numpy as np
from push_recovery.controllers.model.observation import HEADING_ERROR
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.scenario.scenario import Command, Scenario

SECONDS, SETTLE = 60.0, 5.0  # the mean speed leaves out the first steps
COMMANDS = [(0.0, 0.0), (0.5, 0.0), (-0.25, 0.0), (0.0, 0.2), (0.0, -0.2), (0.5, 0.2), (0.5, -0.2)]

env = gym.make("push_recovery:PushRecovery/Biped-v0")
biped = env.unwrapped
policy = make_policy("two-stage", biped.robot, biped.limits, biped.preset)

print("| command x, y [m/s] | mean speed x, y [m/s] | heading: largest error, last [deg] | steps | end |")
print("|---|---|---|---|---|")
for vx, vy in COMMANDS:
    scenario = Scenario("walk", command=Command(vx, vy), duration=SECONDS)
    observation, info = env.reset(options={"scenario": scenario})
    times, places, headings, over = [], [], [], False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy.predict(observation)[0])
        times.append(info["time"])
        places.append(biped.core.physics.com[0, 0, :2].copy())
        headings.append(abs(math.degrees(observation[HEADING_ERROR])))
        over = terminated or truncated
    walked = np.array(times) >= SETTLE
    first, last = np.flatnonzero(walked)[[0, -1]]
    speed = (places[last] - places[first]) / (times[last] - times[first])
    steps = int(biped.core.gait.steps[0])
    end = info["failure_reason"] or "upright"
    print(
        f"| {vx:g}, {vy:g} | {speed[0]:.3f}, {speed[1]:.3f} | {max(headings):.2f}, {headings[-1]:.2f} "
        f"| {steps} | {end} after {times[-1]:.1f} s |"
    )
