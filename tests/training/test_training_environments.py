"""The learner on the package's own environments."""

import dataclasses
import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from push_recovery.controllers.network_policy import NetworkPolicy
from push_recovery.controllers.policies import make_policy
from push_recovery.envs.action_hold import ActionHold
from push_recovery.envs.residual import ResidualAction
from push_recovery.envs.scenario import Scenario
from push_recovery.eval.rollout import rollout
from push_recovery.training.curve import curve_scenarios
from push_recovery.training.ppo import train
from push_recovery.training.settings import TrainingSettings
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_env_sb3
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

PENDULUM, BIPED, RESIDUAL = (f"PushRecovery/{name}-v0" for name in ("Pendulum", "Biped", "BipedResidual"))


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A residual after two short updates, with a learning rate that moves it well away from zero."""
    settings = TrainingSettings(
        env_id=PENDULUM, timesteps=512, n_envs=4, n_steps=64, learning_rate=5e-3, evaluation_scenarios=1
    )
    return train(settings, tmp_path_factory.mktemp("run") / "run"), settings


def short(scenario: Scenario) -> Scenario:
    return dataclasses.replace(scenario, duration=3.0)


@pytest.mark.parametrize("env_id", [PENDULUM, BIPED])
def test_an_untrained_residual_scores_exactly_as_two_stage(tmp_path, env_id):
    settings = TrainingSettings(env_id=env_id, timesteps=0, n_envs=1, evaluation_scenarios=1)
    learned = NetworkPolicy.load(train(settings, tmp_path / "run").policy)
    env = gym.make(env_id)
    unwrapped = env.unwrapped
    planner = make_policy("two-stage", unwrapped.robot, unwrapped.limits, unwrapped.preset)
    for scenario in curve_scenarios(2):
        assert rollout(env, learned, scenario, "same") == rollout(env, planner, scenario, "same")


def test_the_file_scores_on_the_plain_environment_as_the_wrappers_do(trained):
    """The policy file on the plain environment does what the network does on the wrapped one."""
    result, settings = trained
    learned = NetworkPolicy.load(result.policy)
    plain = gym.make(settings.env_id)
    wrapped = ActionHold(ResidualAction(gym.make(settings.env_id), "two-stage"), settings.hold)
    scenario = short(curve_scenarios(3)[2])
    outcome = rollout(plain, learned, scenario, "file")
    observation, _ = wrapped.reset(seed=scenario.noise_seed, options={"scenario": scenario})
    total, ended, moved = 0.0, False, False
    while not ended:
        action = learned.learned_action(observation)
        observation, reward, terminated, truncated, info = wrapped.step(action)
        total += float(reward)
        moved = moved or bool(np.any(info["residual_action"]))
        ended = terminated or truncated
    assert moved
    assert info["time"] == outcome.end_time
    assert terminated == (not outcome.survived)
    assert total == pytest.approx(outcome.total_reward, rel=1e-12)


def test_the_file_acts_as_sb3_on_what_the_robot_meets(trained):
    result, settings = trained
    folder = result.policy.parent / "sb3"
    env = gym.make(settings.env_id)
    normalise = VecNormalize.load(str(folder / "vecnormalize.pkl"), DummyVecEnv([lambda: env]))
    model, learned = PPO.load(folder / "model.zip", device="cpu"), NetworkPolicy.load(result.policy)
    observation, _ = env.reset(seed=5)
    worst, largest = 0.0, 0.0
    for _ in range(100):
        sb3, _ = model.predict(normalise.normalize_obs(observation), deterministic=True)
        mine = learned.learned_action(observation)
        worst, largest = max(worst, float(np.abs(sb3 - mine).max())), max(largest, float(np.abs(mine).max()))
        action, _ = learned.predict(observation)
        observation, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            break
    assert largest > 1e-3
    assert worst < 2e-6


def test_the_registered_residual_passes_both_checkers():
    check_env(gym.make(RESIDUAL, disable_env_checker=True), skip_render_check=True)
    check_env_sb3(gym.make(RESIDUAL, disable_env_checker=True))


def test_the_registered_residual_at_zero_is_the_biped_with_two_stage():
    env, plain = gym.make(RESIDUAL), gym.make(BIPED)
    unwrapped = plain.unwrapped
    planner = make_policy("two-stage", unwrapped.robot, unwrapped.limits, unwrapped.preset)
    options = {"scenario": curve_scenarios(1)[0]}
    a, _ = env.reset(seed=1, options=options)
    b, _ = plain.reset(seed=1, options=options)
    for _ in range(120):
        assert a.tobytes() == b.tobytes()
        a, reward_a, *_ = env.step(np.zeros(7, np.float32))
        b, reward_b, *_ = plain.step(planner.predict(b)[0])
        assert reward_a == reward_b


def test_the_registered_residual_is_made_again_from_its_spec():
    env = gym.make(RESIDUAL, policy="stage-1", scale=[0.1] * 7, hold=2)
    assert json.loads(env.spec.to_json())["kwargs"] == {"policy": "stage-1", "scale": [0.1] * 7, "hold": 2}
    assert str(gym.make(env.spec)) == str(env)


@pytest.mark.parametrize("env_id", [PENDULUM, BIPED, RESIDUAL])
def test_plain_ppo_trains_straight_from_gym_make(env_id):
    model = PPO("MlpPolicy", gym.make(env_id), n_steps=64, batch_size=32, n_epochs=1, seed=0, device="cpu")
    before = model.policy.action_net.weight.detach().numpy().copy()
    model.learn(64)
    after = model.policy.action_net.weight.detach().numpy()
    assert np.all(np.isfinite(after))
    assert np.any(after != before)
