"""Push the biped to the left with 300 N for 0.1 s and let the two-stage planner answer."""

import gymnasium as gym
from push_recovery.controllers.policies.arms import make_policy
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Scenario

env = gym.make("push_recovery:PushRecovery/Biped-v0")
biped = env.unwrapped
policy = make_policy("two-stage", biped.robot, biped.limits, biped.preset)

push = Push(force=(0.0, 300.0, 0.0), duration=0.1, start=GaitEvent(step=4, side="left"))
observation, info = env.reset(options={"scenario": Scenario("left shove", (push,))})
total, over = 0.0, False
while not over:
    action, _ = policy.predict(observation)
    observation, reward, terminated, truncated, info = env.step(action)
    total += float(reward)
    over = terminated or truncated

print(f"pushed with {info['push']['impulse_per_kg']:.2f} N s/kg at {info['push']['start']:.2f} s")
if terminated:
    print(f"fell at {info['time']:.2f} s: {info['failure_reason']}")
elif info["recovered_at"] is None:
    print(f"upright after {info['time']:.2f} s, gait not settled")
else:
    print(f"walks as commanded again from {info['recovered_at']:.2f} s")
print(f"reward {total:.0f} over {info['time']:.1f} s")
