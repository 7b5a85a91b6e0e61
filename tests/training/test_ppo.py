"""PPO: settings that reach it, what its two networks see, the start from a policy, and the rest at first."""

from dataclasses import replace
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import torch
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.training.builders import completed, make_env, make_vec_env, segment_seed
from push_recovery.training.from_sb3 import acting_network, export_policy
from push_recovery.training.imitation import ImitationSettings, imitate
from push_recovery.training.ppo import (
    AdaptedRate,
    AsymmetricPolicy,
    FallingNoise,
    HoldDivergence,
    PPOAlgorithm,
    ValueFirst,
)
from push_recovery.training.settings import TrainingSettings
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

SETTINGS = TrainingSettings(n_envs=2, walks=2, critic=("push", "sensing"), policy_layers=(8,), n_steps=8)


def made():
    env = make_env(SETTINGS)
    settings = completed(SETTINGS, env)
    venv = make_vec_env(settings, env, 0)
    model = PPOAlgorithm(settings, venv, 0).model
    torch.nn.init.normal_(model.policy.action_net.weight, generator=torch.Generator().manual_seed(0))
    return env, settings, venv, model


def test_only_the_value_hangs_on_what_the_policy_does_not_see():
    _, _, _, model = made()
    policy = model.policy
    assert isinstance(policy, AsymmetricPolicy)
    seen = torch.zeros((1, 83), requires_grad=True)
    policy.get_distribution(seen).distribution.mean.sum().backward()
    assert (seen.grad[0, :45] != 0).any()
    assert not seen.grad[0, 45:].any()
    seen.grad = None
    policy.predict_values(seen).sum().backward()
    assert (seen.grad[0, :45] != 0).any()
    assert (seen.grad[0, 45:] != 0).all()


def test_the_exported_policy_acts_as_the_trained_one_without_the_rest(tmp_path):
    env, settings, venv, model = made()
    model.learn(16)
    policy = export_policy(acting_network(model).mlp(), venv, env, settings)
    assert policy.network.weights[0].shape == (8, 45)
    rows = venv.venv.reset()
    ours = policy.network.forward(policy.normalisation.apply(rows[:, :45].astype(np.float64)))
    theirs = model.policy.get_distribution(
        torch.from_numpy(venv.normalize_obs(rows)).float()
    ).distribution.mean
    np.testing.assert_allclose(ours, theirs.detach().numpy(), atol=1e-5)
    policy.save(tmp_path / "policy")
    assert NetworkPolicy.load(tmp_path / "policy").observation_size == 36
    model.save(tmp_path / "model.zip")
    again = type(model).load(tmp_path / "model.zip")
    np.testing.assert_array_equal(
        again.policy.mlp_extractor.policy_net[0].weight.detach(),
        model.policy.mlp_extractor.policy_net[0].weight.detach(),
    )


SETTINGS_START = ImitationSettings(
    robots=2, rounds=1, periods=10, batches=3, batch_size=8, layers=(16, 8), last_batches=2
)


class Joints(gym.Env):
    """Spaces of a robot under joint targets; what it sees is noise."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (58,))
    action_space = gym.spaces.Box(-1.0, 1.0, (14,))

    def reset(self, **kwargs):
        super().reset(**kwargs)
        return self.np_random.normal(size=58).astype(np.float32), {}

    def step(self, action):
        return (
            self.np_random.normal(size=58).astype(np.float32),
            float(-np.square(action).sum()),
            False,
            False,
            {},
        )


def make(layers=(16, 8), **options) -> PPOAlgorithm:
    venv = VecNormalize(DummyVecEnv([Joints]), norm_reward=False, **{"clip_obs": 10.0, **options})
    settings = TrainingSettings(
        "joint", n_envs=1, n_steps=32, batch_size=16, policy_layers=layers, value_layers=(8,)
    )
    return PPOAlgorithm(settings, venv, 0)


@pytest.fixture(scope="module")
def policy():
    return imitate(SETTINGS_START)


def test_ppo_acts_as_the_policy_it_starts_from(policy):
    algorithm = make()
    algorithm.start_from(policy)
    model, venv = algorithm.model, algorithm.venv
    observations = np.random.default_rng(0).normal(size=(20, 58))
    actions = model.predict(venv.normalize_obs(observations), deterministic=True)[0]
    np.testing.assert_allclose(actions, policy.predict(observations)[0], atol=1e-5)


def test_the_normalisation_stays(policy):
    algorithm = make()
    algorithm.start_from(policy)
    model, venv = algorithm.model, algorithm.venv
    model.learn(64)
    np.testing.assert_allclose(venv.obs_rms.mean, policy.normalisation.mean, atol=1e-6)
    np.testing.assert_allclose(venv.obs_rms.var, policy.normalisation.variance, rtol=1e-6)


def test_what_only_a_critic_sees_stands_behind_the_normalisation_and_passes_as_it_is(policy):
    """Two entries of the push behind the 58: mean 0 and variance 1, which no later observation moves."""

    class Pushed(Joints):
        observation_space = gym.spaces.Box(-np.inf, np.inf, (60,))

        def reset(self, **kwargs):
            return np.append(super().reset(**kwargs)[0], np.float32([3.0, -4.0])), {}

    venv = VecNormalize(DummyVecEnv([Pushed]), norm_reward=False, clip_obs=10.0)
    settings = TrainingSettings(
        "joint",
        critic=("push",),
        n_envs=1,
        n_steps=32,
        batch_size=16,
        policy_layers=(16, 8),
        value_layers=(8,),
    )
    PPOAlgorithm(settings, venv, 0).start_from(policy)
    assert venv.obs_rms.mean[58:].tolist() == [0.0, 0.0]
    assert venv.obs_rms.var[58:].tolist() == [1.0, 1.0]
    np.testing.assert_array_equal(venv.obs_rms.mean[:58], policy.normalisation.mean)
    np.testing.assert_array_equal(venv.obs_rms.var[:58], policy.normalisation.variance)
    np.testing.assert_allclose(venv.reset()[0, 58:], [3.0, -4.0], atol=1e-6)


def test_the_value_is_learned_first(policy):
    algorithm = make()
    algorithm.start_from(policy)
    model = algorithm.model
    model.learn(64, callback=ValueFirst(1000))
    np.testing.assert_array_equal(model.policy.action_net.weight.detach(), policy.network.weights[-1])
    value = model.policy.value_net.weight.detach().clone()
    model.learn(64, callback=ValueFirst(0))
    assert (model.policy.action_net.weight.detach().numpy() != policy.network.weights[-1]).any()
    assert (model.policy.value_net.weight.detach() != value).any()


def test_other_layers_are_refused(policy):
    with pytest.raises(InvalidValueError, match=r"needs its layers, .* set policy_layers"):
        make(layers=(16,)).start_from(policy)


def test_a_policy_of_another_activation_is_refused(policy):
    """The same widths with relu between them would act otherwise."""
    relu = NetworkPolicy(replace(policy.network, activation="relu"), policy.normalisation, policy.description)
    with pytest.raises(InvalidValueError, match="relu and linear, got tanh and linear"):
        make().start_from(relu)


def test_another_normalisation_is_refused(policy):
    with pytest.raises(InvalidValueError, match="are not the environments'"):
        make(clip_obs=5.0).start_from(policy)
    with pytest.raises(InvalidValueError, match="are not the environments'"):
        make(epsilon=1e-3).start_from(policy)


@pytest.fixture
def settings(toy):
    return TrainingSettings(
        kind="scratch", env_id=toy, n_envs=2, n_steps=24, batch_size=16, n_epochs=3, hold=1, gamma=0.87,
        gae_lambda=0.77, clip_range=0.13, learning_rate=3e-3, learning_rate_end=1e-3, policy_layers=(5, 4),
        value_layers=(6,), log_std=-0.7, normalise_reward=False, target_kl=0.07,
    )  # fmt: skip


def test_every_setting_is_handed_over(settings, vec_env_of):
    venv = vec_env_of(settings, 3)
    assert (venv.num_envs, venv.gamma, venv.norm_reward, venv.clip_obs) == (2, 0.87, False, 10.0)
    for given in (True, None):  # None: as this is the environment's own reward
        assert vec_env_of(replace(settings, normalise_reward=given), 3).norm_reward
    model = PPOAlgorithm(settings, venv, 3).model
    assert (model.n_steps, model.batch_size, model.n_epochs) == (24, 16, 3)
    assert (model.gamma, model.gae_lambda, model.seed) == (0.87, 0.77, 3)
    assert model.target_kl == 0.07
    assert torch.get_num_threads() == 1
    PPOAlgorithm(replace(settings, threads=2), venv, 3)
    assert torch.get_num_threads() == 2
    torch.set_num_threads(1)
    assert model.clip_range(1.0) == model.clip_range(0.0) == 0.13
    assert (model.lr_schedule(1.0), model.lr_schedule(0.0)) == pytest.approx((3e-3, 1e-3))
    parts = model.policy.mlp_extractor
    widths = [[m.out_features for m in net if hasattr(m, "out_features")]
              for net in (parts.policy_net, parts.value_net)]  # fmt: skip
    assert widths == [[5, 4], [6]]
    np.testing.assert_array_equal(model.policy.log_std.detach().numpy(), np.full(7, np.float32(-0.7)))


def test_a_resumed_run_meets_new_pushes_and_each_part_its_own():
    assert segment_seed(5, 0) == 5
    seeds = {segment_seed(5, timesteps) for timesteps in (0, 256, 512)} | {segment_seed(6, 256)}
    assert len(seeds) == 4
    assert all(0 <= seed < 2**31 for seed in seeds)  # what numpy and torch take
    assert segment_seed(5, 256) == segment_seed(5, 256)


@pytest.mark.parametrize(
    ("divergence", "rate"),
    [(0.021, 2e-4), (0.019, 3e-4), (0.006, 3e-4), (0.0049, 4.5e-4), (None, 3e-4), (0.0, 3e-4)],
)
def test_the_rate_follows_the_divergence_of_an_update(divergence, rate):
    """Wanted 0.01: two thirds of the rate from twice that on, one and a half below half of it, if not 0."""
    adapted = AdaptedRate(3e-4, 0.01)
    callback = HoldDivergence(adapted)
    logged = {} if divergence is None else {"train/approx_kl": divergence}
    callback.model = SimpleNamespace(logger=SimpleNamespace(name_to_value=logged))
    callback._on_rollout_start()
    assert adapted(1.0) == adapted(0.0) == pytest.approx(rate, rel=1e-12)


def test_the_rate_has_bounds():
    low, high = AdaptedRate(1.2e-6, 0.01), AdaptedRate(9e-3, 0.01)
    low.adapt(1.0)
    high.adapt(1e-9)
    assert (low.now, high.now) == (1e-6, 1e-2)


def adapting(wanted: float, **options) -> PPOAlgorithm:
    venv = VecNormalize(DummyVecEnv([Joints]), norm_reward=False)
    settings = TrainingSettings(
        "joint", n_envs=1, n_steps=32, batch_size=16, policy_layers=(8,), value_layers=(8,),
        wanted_kl=wanted, learning_rate=1e-3, **options,
    )  # fmt: skip
    return PPOAlgorithm(settings, venv, 0)


def test_an_update_that_moves_the_policy_little_is_followed_by_a_faster_one_and_a_resumed_run_goes_on_so():
    slow, fast = adapting(1e9), adapting(1e-12)
    for algorithm, rate in ((slow, 1.5**2 * 1e-3), (fast, 1e-3 / 1.5**2)):
        algorithm.learn(96, [])  # three updates; the last one's divergence is not acted on yet
        assert algorithm.model.policy.optimizer.param_groups[0]["lr"] == pytest.approx(rate, rel=1e-12)
    again = adapting(1e9)
    again.restore(slow.tensors(), 96, 15)
    again.learn(32, [])
    assert again.model.policy.optimizer.param_groups[0]["lr"] == pytest.approx(1.5**2 * 1e-3, rel=1e-12)
    older = {name: value for name, value in slow.tensors().items() if name != "rate.now"}
    again = adapting(1e9)
    again.restore(older, 96, 15)
    again.learn(32, [])
    assert again.model.policy.optimizer.param_groups[0]["lr"] == pytest.approx(1e-3, rel=1e-12)


def test_learning_has_its_threads_whatever_a_teacher_has_set():
    algorithm = adapting(0.01, threads=2)
    torch.set_num_threads(1)
    algorithm.learn(32, [])
    assert torch.get_num_threads() == 2
    torch.set_num_threads(1)


def test_noise_is_bounded_linearly_and_may_be_less():
    """From -1 and -2 to -4 over 100 timesteps; at 50 the bounds are -2.5 and -3."""
    callback = FallingNoise((-1.0, -2.0), -4.0, 100)
    log_std = torch.nn.Parameter(torch.tensor([-1.0, -3.2]))
    callback.model = SimpleNamespace(policy=SimpleNamespace(log_std=log_std))
    for done, wanted in ((0, [-1.0, -3.2]), (50, [-2.5, -3.2]), (100, [-4.0, -4.0]), (150, [-4.0, -4.0])):
        callback.num_timesteps = done
        callback._on_rollout_start()
        assert log_std.tolist() == pytest.approx(wanted)


def test_a_run_begins_with_its_noise_and_ends_below_the_bound():
    algorithm = adapting(0.01, log_std=-1.0, log_std_end=-2.0, timesteps=64)
    algorithm.learn(64, [])
    assert (algorithm.model.policy.log_std < -1.4).all()  # bounded by -1.5 before the second of two rollouts


def test_while_the_value_is_learned_nothing_of_the_policy_moves(policy):
    algorithm = make()
    algorithm.start_from(policy)
    acting = algorithm.model.policy
    parts = acting.mlp_extractor.policy_net, acting.action_net
    parameters = [acting.log_std, *(one for part in parts for one in part.parameters())]
    before = [one.detach().clone() for one in parameters]
    algorithm.model.learn(64, callback=ValueFirst(1000))
    assert all((one == kept).all() for one, kept in zip(parameters, before, strict=True))
