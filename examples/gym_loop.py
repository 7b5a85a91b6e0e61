"""Push the biped to the left with 300 N for 0.1 s and let the two-stage planner answer."""

import gymnasium as gym

from push_recovery import GaitEvent, Push, Scenario, describe, make_policy

env = gym.make("push_recovery:PushRecovery/Biped-v0")
policy = make_policy("two-stage", env)

push = Push(force=(0.0, 300.0, 0.0), duration=0.1, start=GaitEvent(step=4, side="left"))
observation, info = env.reset(options={"scenario": Scenario("left shove", (push,))})
total, over = 0.0, False
while not over:
    action, _ = policy.predict(observation)
    observation, reward, terminated, truncated, info = env.step(action)
    total += float(reward)
    over = terminated or truncated

print(f"{describe(info)}; {info['push']['impulse_per_kg']:.2f} N s/kg")
print(f"reward {total:.0f} over {info['time']:.1f} s")
