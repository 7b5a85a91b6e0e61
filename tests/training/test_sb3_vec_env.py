from typing import ClassVar

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.scenario.scenario import Scenario

pytest.importorskip("stable_baselines3")
from push_recovery.training.vec_env import SB3VecEnv
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

PENDULUM = "push_recovery:PushRecovery/Pendulum-v0"
HARD = {"impulse_min": 20.0, "impulse_max": 200.0, "first_step": 0, "settle_time": 0.5}


def native(n=3, **kwargs):
    return SB3VecEnv(gym.make_vec(PENDULUM, n, vectorization_mode="vector_entry_point", **kwargs))


def test_steps_are_those_of_single_environments():
    """As DummyVecEnv on one environment per robot: observations, rewards, ends, terminal observations."""
    ours = native(push_distribution=HARD)
    theirs = DummyVecEnv([lambda: gym.make(PENDULUM, push_distribution=HARD)] * 3)
    for venv in (ours, theirs):
        venv.seed(5)
    assert ours.reset().tobytes() == theirs.reset().tobytes()
    rng, falls, limits = np.random.default_rng(0), 0, 0
    for _ in range(250):
        actions = rng.uniform(-0.3, 0.3, (3, 7)).astype(np.float32)
        a, b = ours.step(actions), theirs.step(actions)
        for mine, other in zip(a[:3], b[:3], strict=True):
            assert mine.tobytes() == other.tobytes()
            assert mine.dtype == other.dtype
        for mine, other in zip(a[3], b[3], strict=True):
            assert mine["TimeLimit.truncated"] == other["TimeLimit.truncated"]
            assert ("terminal_observation" in mine) == ("terminal_observation" in other)
            if "terminal_observation" in mine:
                assert mine["terminal_observation"].tobytes() == other["terminal_observation"].tobytes()
                assert mine.get("failure_reason") == other["failure_reason"]
                assert mine["reward_terms"] == other["reward_terms"]
                limits += mine["TimeLimit.truncated"]
                falls += not mine["TimeLimit.truncated"]
        assert [i["scenario_id"] for i in ours.reset_infos] == [i["scenario_id"] for i in theirs.reset_infos]
    assert falls > 0


def test_time_limits_are_told_apart_from_falls():
    venv = native(2)
    venv.set_options([{"scenario": Scenario("short", duration=0.02)}, {"scenario": Scenario("long")}])
    venv.reset()
    assert [info["scenario_id"] for info in venv.reset_infos] == ["short", "long"]
    rest = np.zeros((2, 7), np.float32)
    _, _, done, infos = venv.step(rest)
    assert (done.tolist(), infos) == ([False, False], [{"TimeLimit.truncated": False}] * 2)
    observations, _, done, infos = venv.step(rest)
    assert done.tolist() == [True, False]
    assert infos[0]["TimeLimit.truncated"]
    assert infos[0]["time"] == pytest.approx(0.02)
    assert observations[0, 0] == 0.0  # of the new episode
    assert infos[0]["terminal_observation"][0] == pytest.approx(0.02)
    assert venv.reset_infos[0]["scenario_id"].startswith("random-")


@pytest.mark.filterwarnings("ignore:Evaluation environment is not wrapped")
def test_ppo_learns_on_it():
    venv = VecNormalize(VecMonitor(native(4, push_distribution=HARD)))
    model = PPO("MlpPolicy", venv, n_steps=64, batch_size=64, n_epochs=1, device="cpu", seed=0)
    first = [parameter.detach().clone() for parameter in model.policy.parameters()]
    model.learn(512)
    assert model.num_timesteps == 512
    assert model.ep_info_buffer
    assert any((a != b).any() for a, b in zip(first, model.policy.parameters(), strict=True))
    assert np.isfinite(evaluate_policy(model, venv, n_eval_episodes=4)[0])


def test_attributes_are_shared():
    venv = native(2)
    assert venv.get_attr("preset", [1]) == ["default"]
    assert venv.env_is_wrapped(gym.Wrapper) == [False, False]
    venv.set_attr("push_distribution", venv.env.push_distribution)
    with pytest.raises(InvalidValueError, match=r"share one environment, got indices \[0\]"):
        venv.set_attr("push_distribution", None, 0)
    venv.set_options({"reset_mask": 1})
    with pytest.raises(InvalidValueError, match="options of SB3VecEnv are: scenario; got 'reset_mask'"):
        venv.reset()


def test_a_mode_that_resets_within_the_step_is_refused():
    with pytest.raises(InvalidValueError, match="'SameStep'; choose from: NextStep, Disabled"):
        native(2, autoreset_mode="SameStep")


class Ending(gym.vector.VectorEnv):
    """Four robots whose episodes end in every combination of a fall and the time limit."""

    metadata: ClassVar = {"autoreset_mode": gym.vector.AutoresetMode.DISABLED}  # type: ignore[misc]

    def __init__(self):
        self.num_envs, self.observations = 4, np.zeros((4, 1))
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (1,))
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (1,))

    def reset(self, *, seed=None, options=None):
        fresh = self.observations.copy()
        fresh[(options or {}).get("reset_mask", slice(None))] = -1.0
        return fresh, {}

    def step(self, actions):
        failed, late = np.array([False, True, False, True]), np.array([False, False, True, True])
        self.observations = np.arange(4.0)[:, None]
        return self.observations, np.full(4, 0.1), failed, late, {}


def test_a_fall_at_the_time_limit_is_a_fall():
    venv = SB3VecEnv(Ending())
    venv.reset()
    observations, rewards, dones, infos = venv.step(np.zeros((4, 1), np.float32))
    assert dones.tolist() == [False, True, True, True]
    assert [info["TimeLimit.truncated"] for info in infos] == [False, False, True, False]
    assert ["terminal_observation" in info for info in infos] == [False, True, True, True]
    assert [info["terminal_observation"].item() for info in infos[1:]] == [1.0, 2.0, 3.0]
    assert observations[:, 0].tolist() == [0.0, -1.0, -1.0, -1.0]
    assert rewards.dtype == np.float32


class Own(gym.vector.VectorObservationWrapper):
    """Changes nothing, and says that it might."""

    def observations(self, observations):
        return observations


def test_wrappers_below_are_known():
    """Those around all robots, and those of each where each has an environment."""
    robots = gym.make_vec(PENDULUM, 3, vectorization_mode="vector_entry_point")
    assert SB3VecEnv(robots).env_is_wrapped(Own) == [False] * 3
    assert SB3VecEnv(Own(robots)).env_is_wrapped(Own, indices=[0, 2]) == [True] * 2
    each = gym.vector.SyncVectorEnv([lambda: gym.make(PENDULUM), lambda: Monitor(gym.make(PENDULUM))])
    assert SB3VecEnv(each).env_is_wrapped(Monitor) == [False, True]


def test_a_method_is_called_once_for_all_and_not_for_some():
    venv, words = SB3VecEnv(Ending()), []
    venv.env.told = lambda word: words.append(word) or word  # type: ignore[attr-defined]
    assert venv.env_method("told", "a") == ["a"] * 4
    with pytest.raises(InvalidValueError, match="share one environment"):
        venv.env_method("told", "b", indices=1)
    assert words == ["a"]


def test_seeds_and_scenarios_are_for_one_reset_alone():
    venv, told = SB3VecEnv(Ending()), []
    own = venv.env.reset
    venv.env.reset = lambda **given: told.append(given) or own(**given)
    venv.seed(7)
    venv.set_options({"scenario": "one"})
    venv.reset()
    venv.reset()
    first = {"seed": [7, 8, 9, 10], "options": {"scenario": ["one"] * 4}}
    assert told == [first, {"seed": None, "options": None}]
