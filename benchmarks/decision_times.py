"""How long policies think: the wall time of their decisions, one for every 10 ms of a robot's time.

    python benchmarks/decision_times.py [--env ID] [--suite NAME] [--sample 32] [--policies two-stage ...]

The scenarios are spread evenly over the suite. A policy acts for one robot at a time.
"""

import argparse
import sys
import time

import numpy as np
from push_recovery.controllers.policies.interface import as_policy
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.score.suites import get_suite


class Timed:
    """A policy that notes how long each of its decisions takes."""

    def __init__(self, policy):
        self.policy, self.seconds = as_policy(policy), []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """What the policy does, timed."""
        begun = time.perf_counter()
        found = self.policy.predict(observation, state, episode_start, deterministic)
        self.seconds.append(time.perf_counter() - begun)
        return found


def main() -> int:
    """Measure and print a row for each policy."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--env", default="PushRecovery/Biped-v0", help="environment")
    parser.add_argument("--suite", default="quick", help="suite")
    parser.add_argument("--sample", type=int, default=32, help="scenarios of it (default: 32)")
    parser.add_argument("--policies", nargs="+", default=["two-stage", "sampling-mpc"], help="policies")
    options = parser.parse_args()
    env = make_env(options.env)
    suite = get_suite(options.suite, options.env)
    scenarios = suite.scenarios[:: max(1, len(suite.scenarios) // options.sample)][: options.sample]
    print("policy: decisions; median, 95 %, 99 %, largest [ms]; over 10 ms [%]; mean share of real time")
    for name in options.policies:
        policy = Timed(load_policy(name, env))
        rollout(env, policy, scenarios[0], name)  # compiles
        policy.seconds.clear()
        for scenario in scenarios:
            rollout(env, policy, scenario, name)
        ms = 1e3 * np.array(policy.seconds)
        median, high, higher = np.percentile(ms, (50, 95, 99))
        print(
            f"{name}: {len(ms)}; {median:.2f}, {high:.2f}, {higher:.2f}, {ms.max():.0f}; "
            f"{100.0 * (ms > 10.0).mean():.2f}; {ms.mean() / 10.0:.3f}",
            flush=True,
        )
    env.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
