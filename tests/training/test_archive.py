"""A saved model of Stable-Baselines3 acts where the user trusts it, and is not opened where not."""

import copy
import json
import zipfile

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.rollout.environments import make_env

sb3 = pytest.importorskip("stable_baselines3", reason="needs the extra train")

from push_recovery.training.model_policy import ArchivePolicy, algorithm_of  # noqa: E402

PENDULUM = "PushRecovery/Pendulum-v0"
ALGORITHMS = {
    "PPO": {"n_steps": 8, "batch_size": 8},
    "A2C": {"n_steps": 8},
    "SAC": {"buffer_size": 8},
    "TD3": {"buffer_size": 8},
}


def saved(path, env: gym.Env, name: str = "PPO"):
    model = getattr(sb3, name)(
        "MlpPolicy", env, **ALGORITHMS[name], policy_kwargs={"net_arch": [4]}, device="cpu", seed=3
    )
    model.save(path)
    return model


@pytest.mark.parametrize("name", ALGORITHMS)
def test_it_acts_as_the_model_without_exploration(tmp_path, name):
    env = make_env(PENDULUM)
    model = saved(tmp_path / "model.zip", env, name)
    assert algorithm_of("it", (tmp_path / "model.zip").read_bytes()) == name
    policy = copy.deepcopy(ArchivePolicy.of(str(tmp_path / "model.zip")))
    observation, _ = env.reset(seed=1)
    action, _ = policy.predict(observation)
    np.testing.assert_array_equal(action, model.predict(observation, deterministic=True)[0])
    assert np.abs(action).max() > 0.0
    assert vars(copy.deepcopy(policy)).keys() == {"path", "sha256"}  # without the model that it has loaded


def test_statistics_beside_it_are_used(tmp_path):
    env = sb3.common.vec_env.DummyVecEnv([lambda: make_env(PENDULUM)])
    normalised = sb3.common.vec_env.VecNormalize(env)
    model = saved(tmp_path / "model.zip", normalised)
    normalised.obs_rms.mean += 0.3
    normalised.save(str(tmp_path / "vecnormalize.pkl"))
    observation = np.linspace(-0.2, 0.4, env.observation_space.shape[0]).astype(np.float32)
    action, _ = ArchivePolicy.of(str(tmp_path / "model.zip")).predict(observation)
    expected, _ = model.predict(normalised.normalize_obs(observation), deterministic=True)
    np.testing.assert_allclose(action, expected, rtol=0, atol=1e-6)
    assert not np.allclose(action, model.predict(observation, deterministic=True)[0])


def test_what_is_no_archive_is_refused_unloaded(tmp_path):
    path = tmp_path / "model.zip"
    path.write_bytes(b"no archive")
    observation = np.zeros(3, np.float32)
    with pytest.raises(InvalidValueError, match="no archive of Stable-Baselines3"):
        ArchivePolicy.of(str(path)).predict(observation)
    with zipfile.ZipFile(path, "w") as content:
        content.writestr("data", json.dumps({"exploration_fraction": 0.1}))
    with pytest.raises(InvalidValueError, match="none of the algorithms PPO"):
        ArchivePolicy.of(str(path)).predict(observation)
    policy = ArchivePolicy.of(str(path))
    path.write_bytes(b"other")
    with pytest.raises(InvalidValueError, match="has changed"):
        policy.predict(observation)
    with pytest.raises(InvalidValueError, match="can't read"):
        ArchivePolicy.of(str(tmp_path / "none.zip"))


def test_statistics_stay_as_they_were_saved_and_belong_to_the_digest(tmp_path):
    """(x - 0.5) / 2 is what the model sees, however often it acts; other statistics are other content."""
    normalised = sb3.common.vec_env.VecNormalize(
        sb3.common.vec_env.DummyVecEnv([lambda: make_env(PENDULUM)]), epsilon=0.0
    )
    model = saved(tmp_path / "model.zip", normalised)
    normalised.obs_rms.mean[:], normalised.obs_rms.var[:] = 0.5, 4.0
    normalised.save(str(tmp_path / "vecnormalize.pkl"))
    policy = ArchivePolicy.of(str(tmp_path / "model.zip"))
    observation = np.linspace(-0.2, 0.4, normalised.observation_space.shape[0])
    expected, _ = model.predict(((observation - 0.5) / 2.0).astype(np.float32), deterministic=True)
    for _ in range(3):
        np.testing.assert_allclose(policy.predict(observation)[0], expected, rtol=0, atol=1e-6)
    normalised.obs_rms.mean[:] = 0.6
    normalised.save(str(tmp_path / "vecnormalize.pkl"))
    assert ArchivePolicy.of(policy.path).sha256 != policy.sha256
    with pytest.raises(InvalidValueError, match="has changed since it was named"):
        copy.deepcopy(policy).predict(observation)
