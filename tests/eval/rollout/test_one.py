"""One episode of an environment whose steps are written by hand."""

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.episodes import planning_period, rollout


class Scripted(gym.Env):
    """Ends at its third step, as it is told."""

    def __init__(self, terminated, truncated, info):
        self.end, self.info, self.count = (terminated, truncated), info, 0

    def reset(self, *, seed=None, options=None):
        self.count, self.seed, self.scenario = 0, seed, options["scenario"]
        return np.zeros(1), {}

    def step(self, action):
        self.count += 1
        ended = self.end if self.count == 3 else (False, False)
        return np.zeros(1), 0.5 * self.count, *ended, self.info if self.count == 3 else {}


class Still:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return 0.0, state


@pytest.mark.parametrize(
    ("terminated", "truncated", "survived"),
    [(True, False, False), (False, True, True), (True, True, False)],
)
def test_a_fall_is_what_terminates(terminated, truncated, survived):
    env = Scripted(terminated, truncated, {"recovered_at": 0.02, "failure_reason": "low"})
    found = rollout(env, Still(), Scenario("a", noise_seed=7), "p")
    assert (found.survived, found.recovered) == (survived, survived)
    assert found.failure_reason == (None if survived else "low")
    assert (found.env_steps, found.total_reward, found.recovered_at) == (3, 0.5 + 1.0 + 1.5, 0.02)
    assert (env.seed, env.scenario.id) == (7, "a")


def test_time_is_what_the_environment_tells_or_its_steps_take():
    assert planning_period(Scripted(False, True, {})) == 0.01
    assert rollout(Scripted(False, True, {}), Still(), Scenario("a"), "p").end_time == pytest.approx(0.03)
    slow = Scripted(False, True, {})
    slow.dt = 0.05
    assert rollout(slow, Still(), Scenario("a"), "p").end_time == pytest.approx(0.15)
    told = Scripted(False, True, {"time": 9.0})
    assert rollout(told, Still(), Scenario("a"), "p").end_time == 9.0
