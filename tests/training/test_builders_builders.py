"""What of the settings reaches Stable-Baselines3."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from push_recovery.training.builders import segment_seed
from push_recovery.training.ppo import PPOAlgorithm
from push_recovery.training.settings import TrainingSettings


@pytest.fixture
def settings(toy):
    return TrainingSettings(
        kind="scratch", env_id=toy, n_envs=2, n_steps=24, batch_size=16, n_epochs=3, hold=1, gamma=0.87,
        gae_lambda=0.77, clip_range=0.13, learning_rate=3e-3, learning_rate_end=1e-3, policy_layers=(5, 4),
        value_layers=(6,), log_std=-0.7, normalise_reward=False,
    )  # fmt: skip


def test_every_setting_is_handed_over(settings, vec_env_of):
    venv = vec_env_of(settings, 3)
    assert (venv.num_envs, venv.gamma, venv.norm_reward, venv.clip_obs) == (2, 0.87, False, 10.0)
    for given in (True, None):  # None: as this is the environment's own reward
        assert vec_env_of(dataclasses.replace(settings, normalise_reward=given), 3).norm_reward
    model = PPOAlgorithm(settings, venv, 3).model
    assert (model.n_steps, model.batch_size, model.n_epochs) == (24, 16, 3)
    assert (model.gamma, model.gae_lambda, model.seed) == (0.87, 0.77, 3)
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
