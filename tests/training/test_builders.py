"""The learner on the package's own environments."""

import dataclasses
import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.controllers.policies.mlp import NetworkInputs
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.scenario.distribution import PushDistribution
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.envs.wrappers import ActionHold, ResidualAction
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.training.builders import make_env, own_episodes
from push_recovery.training.ppo import FallingRate, PPOAlgorithm
from push_recovery.training.run import curve_scenarios, train
from push_recovery.training.settings import LOG_STD, TrainingSettings
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_env_sb3
from stable_baselines3.common.vec_env import VecNormalize

PENDULUM, BIPED, RESIDUAL = (f"PushRecovery/{name}-v0" for name in ("Pendulum", "Biped", "BipedResidual"))


SMALL = TrainingSettings(n_envs=2, walks=2, evaluation_scenarios=1)  # as small as a run can be


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A residual after two short updates, with a learning rate that moves it well away from zero."""
    settings = TrainingSettings(
        env_id=PENDULUM,
        timesteps=512,
        n_envs=4,
        n_steps=64,
        batch_size=128,
        learning_rate=5e-3,
        evaluation_scenarios=1,
    )
    return train(settings, tmp_path_factory.mktemp("run") / "run"), settings


def test_robots_of_a_run_are_of_all_its_profiles():
    env = make_env(dataclasses.replace(SMALL, profile=("exact", "hardware")))
    rng, episodes = np.random.default_rng(0), own_episodes(env, 1)
    drawn = [episodes.drawn(PushDistribution(), rng) for _ in range(40)]
    assert {scenario.sensing for scenario in drawn} == {"exact", "onboard"}
    env.close()


def short(scenario: Scenario) -> Scenario:
    return dataclasses.replace(scenario, duration=3.0)


@pytest.mark.parametrize("env_id", [PENDULUM, BIPED])
def test_an_untrained_residual_scores_exactly_as_two_stage(tmp_path, env_id):
    settings = dataclasses.replace(SMALL, env_id=env_id, timesteps=0)
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
    inner = ResidualAction(gym.make(settings.env_id), "two-stage", gate=settings.gate)
    wrapped = ActionHold(inner, settings.periods)
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


def test_the_file_acts_as_sb3_on_what_the_robot_meets(trained, vec_env_of):
    result, settings = trained
    folder = result.policy.parent / "sb3"
    env = gym.make(settings.env_id)
    venv = vec_env_of(settings, 0)
    normalise = VecNormalize.load(str(folder / "vecnormalize.pkl"), venv.unwrapped)
    model, learned = PPO.load(folder / "model.zip", device="cpu"), NetworkPolicy.load(result.policy)
    observation, _ = env.reset(seed=5)
    rule, about = learned.rule, learned.description
    inputs = NetworkInputs(about.inputs, about.robot, about.limits)
    worst, largest = 0.0, 0.0
    for _ in range(100):
        seen = inputs.rows(observation[None], rule.below(observation[None]))[0]
        sb3, _ = model.predict(normalise.normalize_obs(seen), deterministic=True)
        mine = learned.learned_action(observation)
        worst, largest = max(worst, float(np.abs(sb3 - mine).max())), max(largest, float(np.abs(mine).max()))
        action, _ = learned.predict(observation)
        observation, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            break
    assert largest > 1e-3
    assert worst < 2e-6


@pytest.mark.filterwarnings("ignore:render_mode 'human' needs a display:RuntimeWarning")
def test_the_registered_residual_passes_both_checkers():
    check_env(gym.make(RESIDUAL, disable_env_checker=True))
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


def test_every_action_has_its_own_noise(vec_env_of):
    settings = dataclasses.replace(SMALL, env_id=PENDULUM)
    venv = vec_env_of(settings, 0)
    log_std = PPOAlgorithm(settings, venv, 0).model.policy.log_std.detach().numpy()
    np.testing.assert_array_equal(log_std, np.full(7, np.float32(LOG_STD["residual"])))
    with pytest.raises(InvalidValueError, match="log_std"):
        PPOAlgorithm(dataclasses.replace(settings, log_std=(-1.0, -2.0)), venv, 0)


def test_a_closed_gate_leaves_the_walk_to_the_planner():
    walk = Scenario("walk", duration=1.0)
    env, plain = gym.make(RESIDUAL, gate=[0.02, 0.06]), gym.make(BIPED)
    unwrapped = plain.unwrapped
    planner = make_policy("two-stage", unwrapped.robot, unwrapped.limits, unwrapped.preset)
    a, b = (e.reset(seed=1, options={"scenario": walk})[0] for e in (env, plain))
    for _ in range(100):
        assert a.tobytes() == b.tobytes()
        a, *_ = env.step(np.ones(7, np.float32))
        b, *_ = plain.step(planner.predict(b)[0])
    assert json.loads(env.spec.to_json())["kwargs"] == {"gate": [0.02, 0.06]}


@pytest.mark.parametrize(("policy", "status"), [("two-stage", "solved"), ("stage-1", None)])
def test_info_tells_the_status_of_stage_2(policy, status):
    env = gym.make(RESIDUAL, policy=policy)
    env.reset(seed=0)
    assert env.step(np.zeros(7, np.float32))[4]["qp_status"] == status


def test_residuals_and_whole_actions_are_not_taken_for_one_another(tmp_path):
    for kind, env_id in (("residual", BIPED), ("scratch", RESIDUAL)):
        settings = dataclasses.replace(SMALL, kind=kind, env_id=env_id, timesteps=0)
        train(settings, tmp_path / kind)
    residual, scratch = str(tmp_path / "residual/policy.json"), str(tmp_path / "scratch/policy.json")
    for name, right, wrong in ((residual, BIPED, RESIDUAL), (scratch, RESIDUAL, BIPED)):
        load_policy(name, gym.make(right))
        with pytest.raises(PushRecoveryError, match=f"{name}.*{right}|{name}.*{wrong}") as error:
            load_policy(name, gym.make(wrong))
        assert right in str(error.value)
        assert wrong in str(error.value)


@pytest.mark.parametrize("env_id", [PENDULUM, BIPED, RESIDUAL])
def test_plain_ppo_trains_straight_from_gym_make(env_id):
    model = PPO("MlpPolicy", gym.make(env_id), n_steps=64, batch_size=32, n_epochs=1, seed=0, device="cpu")
    before = model.policy.action_net.weight.detach().numpy().copy()
    model.learn(64)
    after = model.policy.action_net.weight.detach().numpy()
    assert np.all(np.isfinite(after))
    assert np.any(after != before)


def test_the_learning_rate_falls_from_its_start_to_its_end():
    rate = FallingRate(5e-4, 1e-4)
    assert [rate(remaining) for remaining in (1.0, 0.5, 0.0)] == pytest.approx([5e-4, 3e-4, 1e-4])


@pytest.mark.parametrize(
    ("reward", "divided"), [("recovery", False), ("steps", False), ("environment", True)]
)
def test_only_the_environments_own_reward_is_divided_where_nothing_is_said(vec_env_of, reward, divided):
    venv = vec_env_of(dataclasses.replace(SMALL, env_id=PENDULUM, reward=reward), 0)
    assert venv.norm_reward == divided


def test_errors_are_drawn_where_an_environment_draws_its_scenarios_itself():
    settings = dataclasses.replace(SMALL, env_id=PENDULUM, errors=(("friction", 0.5, 0.5),))
    env = make_env(settings)
    drawn = env.unwrapped.push_distribution.sample(np.random.default_rng(0))
    assert drawn.errors.friction == 0.5
    env.close()
