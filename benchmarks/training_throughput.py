"""What PPO keeps of the environment's own throughput: python benchmarks/training_throughput.py [ROUNDS].

Planning periods a second of (a) robots that the planner leads, pushed as in training, and (b) as many robots
under PPO with its updates; in turns, so that both meet the same machine.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from push_recovery.training.builders import completed, make_env, make_ppo, make_vec_env
from push_recovery.training.settings import TrainingSettings

UPDATES = 4  # of PPO a round; the environment alone steps as often


def main() -> None:
    """Print both rates of each round, and the median of their ratios."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    settings = TrainingSettings("residual", walks=128)
    env = make_env(settings)
    settings = completed(settings, env)
    venv = make_vec_env(settings, env, 0)
    model = make_ppo(settings, venv, 0, None)
    model.learn(settings.rollout)  # compiled, warm
    alone, shared = venv.unwrapped.episodes.alike(settings.n_envs, 2), []
    walker = env.env.policy
    rng = np.random.default_rng(0)
    for k in range(alone.n):
        alone.begin(k, alone.drawn(settings.drawn_pushes, rng))
    for number in range(rounds):
        periods = UPDATES * settings.n_steps * settings.periods
        began = time.perf_counter()
        for _ in range(periods):
            over = alone.step(walker.predict(alone.core.observation)[0])
            for k in np.flatnonzero(over.failed | over.truncated).tolist():
                alone.begin(k, alone.drawn(settings.drawn_pushes, rng))
        middle = time.perf_counter()
        model.learn(UPDATES * settings.rollout, reset_num_timesteps=False)
        end = time.perf_counter()
        rates = [alone.n * periods / seconds for seconds in (middle - began, end - middle)]
        shared.append(rates[1] / rates[0])
        print(f"round {number}: environment {rates[0]:.0f}, PPO {rates[1]:.0f} periods/s, {shared[-1]:.2f}")
    print(f"median share: {np.median(shared):.2f}")


if __name__ == "__main__":
    main()
