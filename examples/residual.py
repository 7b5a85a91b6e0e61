"""Correct the planner with an action of your own, which acts only while the robot is off its course."""

import gymnasium as gym
import numpy as np

from push_recovery import GaitEvent, Push, ResidualAction, Scenario, describe

push = Push(force=(0.0, 900.0, 0.0), duration=0.1, start=GaitEvent(step=4, side="left"))
scenario = Scenario("left shove", (push,))
# one scale per entry, in action units; the gate opens while the DCM is 2 to 6 cm off the nominal gait
env = ResidualAction(
    gym.make("push_recovery:PushRecovery/Biped-v0"),
    "two-stage",
    scale=[0.1, 0.1, 0.1, 0.0, 0.0, 0.0, 0.0],
    gate=[0.02, 0.06],
)

SOONER = -np.eye(7, dtype=np.float32)[2]  # entry 2 is the duration of the step
for name, residual in (("planner alone", 0.0 * SOONER), ("step sooner", SOONER)):
    _, info = env.reset(options={"scenario": scenario})
    opened, over = 0.0, False
    while not over:
        opened += env.opening * env.unwrapped.dt
        _, _, terminated, truncated, info = env.step(residual)
        over = terminated or truncated
    print(f"{name}: {describe(info)}; the gate was open for {opened:.1f} of {info['time']:.1f} s")
