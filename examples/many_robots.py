"""Sixteen robots in one process, each with a push of its own, under one planner."""

import gymnasium as gym
import numpy as np

from push_recovery import make_policy

ROBOTS = 16
robots = gym.make_vec(
    "push_recovery:PushRecovery/Biped-v0", num_envs=ROBOTS, vectorization_mode="vector_entry_point", threads=2
)
policy = make_policy("two-stage", gym.make("push_recovery:PushRecovery/Biped-v0"))

observations, _ = robots.reset(seed=0)
recovered, fell, running = 0, 0, np.full(ROBOTS, True)
while running.any():
    actions, _ = policy.predict(observations)  # one call for all
    observations, _, terminated, truncated, info = robots.step(actions)
    ended = running & (terminated | truncated)
    fell += int((ended & terminated).sum())
    if ended.any():
        last = info.get("final_info", info)
        recovered += int((ended & ~terminated & last["_recovered_at"]).sum())
    running &= ~ended
print(f"{ROBOTS} pushes: {recovered} recovered, {fell} fell, {ROBOTS - recovered - fell} otherwise")
