"""A trained policy twice on the same pushes: its file run by numpy, and Stable-Baselines3's own network.

    python benchmarks/learned_policy.py runs/residual [--suite quick]

The file acts on the plain environment, as `push-recovery evaluate` does; SB3's `PPO.predict` acts on the
environment that it was trained in (residual and hold as wrappers). Loads the run's sb3/ folder, which holds
pickles: name only runs of your own.
"""

import argparse
import json
from pathlib import Path

import gymnasium as gym
from push_recovery.controllers.learned.network import NetworkPolicy
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.batch import rollout_all
from push_recovery.eval.rollout.workers import SLOTS
from push_recovery.eval.score.suites import get_suite
from push_recovery.training.builders import make_env, make_plain_env
from push_recovery.training.settings import TrainingSettings
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize


def sb3_recovers(env: gym.Env, model: PPO, normalise: VecNormalize, scenario: Scenario) -> bool:
    """One episode of SB3's network: whether the push was recovered."""
    observation, info = env.reset(seed=scenario.noise_seed, options={"scenario": scenario})
    terminated = truncated = False
    while not (terminated or truncated):
        action, _ = model.predict(normalise.normalize_obs(observation), deterministic=True)
        observation, _, terminated, truncated, info = env.step(action)
    return not terminated and info["recovered_at"] is not None


def main() -> None:
    """Print both rates and how many pushes came out differently."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a finished run")
    parser.add_argument("--suite", default="quick", help="name or JSON file")
    args = parser.parse_args()
    settings = TrainingSettings.from_json(json.loads((args.run / "settings.json").read_text()))
    plain, wrapped = make_plain_env(settings.env_id), make_env(settings)
    learned = NetworkPolicy.load(args.run / "policy")
    model = PPO.load(args.run / "sb3" / "model.zip", device="cpu")
    venv = DummyVecEnv([lambda: make_env(settings)])
    normalise = VecNormalize.load(str(args.run / "sb3" / "vecnormalize.pkl"), venv)
    scenarios = get_suite(args.suite).scenarios
    mine = [outcome.recovered for outcome in rollout_all(plain, learned, scenarios, "file", SLOTS)]
    theirs = [sb3_recovers(wrapped, model, normalise, scenario) for scenario in scenarios]
    count = len(scenarios)
    print(f"policy file, numpy: {sum(mine)}/{count} recovered, rate {sum(mine) / count:.4f}")
    print(f"SB3's network:      {sum(theirs)}/{count} recovered, rate {sum(theirs) / count:.4f}")
    print(f"pushes that came out differently: {sum(a != b for a, b in zip(mine, theirs, strict=True))}")


if __name__ == "__main__":
    main()
