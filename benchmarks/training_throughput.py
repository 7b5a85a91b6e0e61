"""What PPO keeps of the throughput: python benchmarks/training_throughput.py [ROUNDS] [RECIPE].

Planning periods a second of (a) robots that the planner leads from the beginning of a walk on, pushed as in
training, (b) robots that the planner leads in the very episodes of training, which begin at the push and end
with the recovery, put back included, and (c) as many robots under PPO with its updates; in turns, so that all
meet the same machine. A period in which a robot is caught costs more than one in which it walks.
RECIPE is that of a residual on the planner's decisions, by default of `residual`.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np
from push_recovery.training.builders import completed, make_env, make_vec_env
from push_recovery.training.ppo import PPOAlgorithm
from push_recovery.training.settings import get_recipe

UPDATES = 4  # of PPO a round; the environment alone steps as often


def main() -> None:
    """Print the rates of each round, and the medians of PPO's shares of the other two."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    settings = replace(get_recipe(sys.argv[2] if len(sys.argv) > 2 else "residual"), walks=128)
    env = make_env(settings)
    settings = completed(settings, env)
    venv = make_vec_env(settings, env, 0)
    model = PPOAlgorithm(settings, venv, 0).model
    model.learn(settings.rollout)  # compiled, warm
    robots = venv.unwrapped
    alone = robots.episodes.clone(settings.n_envs, 2)
    walker = env.env.policy
    rng = np.random.default_rng(0)
    for k in range(alone.n):
        alone.begin(k, alone.drawn(settings.drawn_pushes, rng))
    shares = []
    for number in range(rounds):
        periods = UPDATES * settings.n_steps * settings.periods
        times = [time.perf_counter()]
        for _ in range(periods):
            over = alone.step(walker.predict(alone.core.observation)[0])
            for k in np.flatnonzero(over.failed | over.truncated).tolist():
                alone.begin(k, alone.drawn(settings.drawn_pushes, rng))
        times.append(time.perf_counter())
        nothing = np.zeros((robots.num_envs, *robots.action_space.shape), np.float32)
        for _ in range(UPDATES * settings.n_steps):
            robots.step(nothing)
        times.append(time.perf_counter())
        model.learn(UPDATES * settings.rollout, reset_num_timesteps=False)
        times.append(time.perf_counter())
        walking, caught, ppo = alone.n * periods / np.diff(times)
        shares.append((ppo / walking, ppo / caught))
        print(
            f"round {number}: walks {walking:.0f}, episodes of training {caught:.0f}, PPO {ppo:.0f} "
            f"periods/s, {shares[-1][0]:.2f} and {shares[-1][1]:.2f}"
        )
    print("median shares: {:.2f} and {:.2f}".format(*np.median(shares, axis=0)))


if __name__ == "__main__":
    main()
