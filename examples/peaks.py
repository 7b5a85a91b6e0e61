"""Largest joint torques and speeds at 500 Hz: walking, and in recovered pushes above 60 N s of `quick`."""

import gymnasium as gym
import numpy as np
from push_recovery.controllers.policies.arms import make_policy
from push_recovery.envs.biped.robots.biped.robot import biped_model
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.score.suites import quick_suite

env = gym.make("push_recovery:PushRecovery/Biped-v0")
biped, model = env.unwrapped, biped_model()
policy = make_policy("two-stage", biped.robot, biped.limits, biped.preset)
core = biped.core
limit = model.actuator_forcerange[:, 1]
peaks = np.zeros((2, model.nu))  # torque [N m], speed [rad/s]


def keep_peaks() -> None:
    """Look at the physics step just made."""
    torque = np.minimum(np.abs(core.physics.ctrl[0]), limit)
    np.maximum(peaks, [torque, np.abs(core.physics.qvel[0, 6:])], out=peaks)


def run(scenario: Scenario) -> tuple[bool, np.ndarray]:
    """Whether the push was recovered, and its peaks (2, 14)."""
    peaks[:] = 0.0
    observation, info = env.reset(options={"scenario": scenario})
    terminated = truncated = False
    while not (terminated or truncated):
        observation, _, terminated, truncated, info = env.step(policy.predict(observation)[0])
    return truncated and info["recovered_at"] is not None, peaks.copy()


core.after_physics_step = keep_peaks
walking = run(Scenario("walk", command=Command(0.5), duration=10.0))[1]
hard = [s for s in quick_suite().scenarios if s.pushes[0].impulse_magnitude > 60.0]
pushed = np.array([peak for recovered, peak in map(run, hard) if recovered])
print(f"{len(pushed)} of {len(hard)} recovered. Torque [N m], speed [rad/s]: walk, median, largest (limit)")
middle, most = np.median(pushed, axis=0), pushed.max(axis=0)
for joint in range(model.nu):
    name = model.actuator(joint).name
    torque = f"{walking[0, joint]:.0f}, {middle[0, joint]:.0f}, {most[0, joint]:.0f} ({limit[joint]:.0f})"
    speed = f"{walking[1, joint]:.1f}, {middle[1, joint]:.1f}, {most[1, joint]:.1f}"
    print(f"| {name} | {torque} | {speed} |")
slow = int(np.sum(pushed[:, 1].max(axis=1) < 20.0))
print(f"no joint faster than 20 rad/s in {slow} of {len(pushed)}")
