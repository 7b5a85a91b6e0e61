"""A gait environment of one unstable number, quick enough to train on."""

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel

TOY = "PushRecoveryTest/Toy-v0"


class ToyGait(gym.Env):
    """offset' = 1.1 offset + 0.3 action[0]; falls where |offset| > 1; the reward is 1 - offset^2."""

    def __init__(self):
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (36,), np.float64)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (7,), np.float32)
        self.robot, self.limits, self.preset = RobotModel(), GaitLimits(), "default"

    def _observe(self):
        observation = np.zeros(36)
        observation[1:3] = self.offset, 0.1
        return observation

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        scenario = (options or {}).get("scenario")
        start = self.np_random.uniform(-0.4, 0.4)
        self.offset = start if scenario is None else 0.5 * np.cos(scenario.pushes[0].direction)
        self.count = 0
        return self._observe(), {}

    def step(self, action):
        self.count += 1
        self.offset = 1.1 * self.offset + 0.3 * float(action[0])
        fell = abs(self.offset) > 1.0
        info = {
            "failure_reason": "offset" if fell else None,
            "recovered_at": None if fell or abs(self.offset) > 0.3 else 0.1,
            "reward_terms": {"offset": 1.0 - self.offset**2},
        }
        return self._observe(), 1.0 - self.offset**2, fell, self.count >= 40, info


if TOY not in gym.registry:
    gym.register(TOY, entry_point=ToyGait)


@pytest.fixture
def toy():
    return f"gymnasium:{TOY}"  # MODULE:ID


@pytest.fixture
def stop_at():
    """Reports that interrupt training as Ctrl-C would, from a number of timesteps on."""

    def made(timesteps):
        def report(done, words):
            if done >= timesteps:
                raise KeyboardInterrupt

        return report

    return made


@pytest.fixture
def curve_of(monkeypatch):
    """Lets the points of a curve recover given shares, in turn; returns the scored policies by timesteps."""
    from push_recovery.training import run

    def made(*shares):
        left, scored = list(shares), {}

        def score(env, policy, scenarios, timesteps, seconds):
            scored[timesteps] = policy
            return run.CurvePoint(timesteps, seconds, len(scenarios), left.pop(0), 1.0, 0.0)

        monkeypatch.setattr(run, "score", score)
        return scored

    return made


@pytest.fixture
def vec_env_of():
    """What a run of settings trains on, by its seed."""
    from push_recovery.training.builders import completed, make_env, make_vec_env

    def made(settings, seed):
        env = make_env(settings)
        return make_vec_env(completed(settings, env), env, seed)

    return made
