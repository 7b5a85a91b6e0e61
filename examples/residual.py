"""Correct a policy's action with one of your own: here a wider step, on top of the two-stage planner."""

import gymnasium as gym
import numpy as np
from push_recovery.controllers.policies.arms import make_policy
from push_recovery.envs.residual.wrapper import ResidualAction
from push_recovery.envs.scenario.push_distribution import PushDistribution

env = gym.make("push_recovery:PushRecovery/Biped-v0")
biped = env.unwrapped
planner = make_policy("two-stage", biped.robot, biped.limits, biped.preset)
# one scale per entry, in action units: a residual of 1 moves the step width by 0.3 of half its range
env = ResidualAction(env, planner, scale=[0.3, 0.3, 0.2, 0, 0, 0, 0])

rng = np.random.default_rng(0)
scenarios = [PushDistribution(impulse_max=60.0).sample(rng) for _ in range(20)]
for name, residual in (("no correction", np.zeros(7)), ("steps 5 cm wider", np.eye(7)[1])):
    recovered = 0
    for scenario in scenarios:
        _, info = env.reset(options={"scenario": scenario})
        over = False
        while not over:
            _, _, terminated, truncated, info = env.step(residual.astype(np.float32))
            over = terminated or truncated
        recovered += truncated and info["recovered_at"] is not None
    print(f"{name}: {recovered} of {len(scenarios)} pushes recovered")
