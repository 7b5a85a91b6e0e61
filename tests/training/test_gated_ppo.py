"""PPO that acts only while the gate of the residual is open."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError

pytest.importorskip("stable_baselines3")
from push_recovery.controllers.policies.network import NetworkPolicy
from push_recovery.envs.scenario.push_distribution import PushDistribution
from push_recovery.training import gated_rollout
from push_recovery.training.builders import make_ppo, make_vec_env
from push_recovery.training.checkpoint import load_checkpoint
from push_recovery.training.gated_ppo import GatedPPO, GateNormalize
from push_recovery.training.ppo import resume, train
from push_recovery.training.settings import TrainingSettings
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

PENDULUM = "PushRecovery/Pendulum-v0"
SETTINGS = TrainingSettings(
    env_id=PENDULUM, timesteps=256, n_envs=4, n_steps=32, n_epochs=1, gate=(0.02, 0.05), policy_layers=(8,),
    value_layers=(8,), evaluation_scenarios=1, normalise_reward=False,
)  # fmt: skip


class Watch(BaseCallback):
    """Keeps what the robots gave and what PPO made of it."""

    def __init__(self):
        super().__init__()
        self.rewards, self.ended, self.rollouts = [], [], []

    def _on_step(self):
        self.rewards.append(self.locals["rewards"].copy())
        self.ended.append(self.locals["dones"].copy())
        return True

    def _on_rollout_end(self):
        buffer = self.model.rollout_buffer
        self.rollouts.append(
            {name: getattr(buffer, name).copy() for name in ("observations", "rewards", "actions")}
        )


def learn(settings, seed=0):
    venv = make_vec_env(settings, seed)
    model, watch = make_ppo(settings, venv, seed, None), Watch()
    model.learn(settings.timesteps, callback=watch)
    return venv, model, watch


def test_every_learned_action_is_one_at_an_open_gate():
    venv, model, watch = learn(dataclasses.replace(SETTINGS, timesteps=128, learning_rate=1e-9))
    assert isinstance(venv, GateNormalize)
    assert isinstance(model, GatedPPO)
    assert model.num_timesteps == 128
    assert len(watch.rewards) > 32  # the robots also walk
    statistics = venv.obs_rms
    assert statistics.count == pytest.approx(128, abs=2 * 4)  # those of the rollout, and those due after it
    seen = watch.rollouts[0]["observations"].reshape(-1, 36)
    assert len(np.unique(seen, axis=0)) == 128
    gated = venv.gate(venv.unnormalize_obs(seen))  # statistics have moved since, and clipping loses some
    assert np.mean(gated > 0.0) > 0.5
    total, given = watch.rollouts[0]["rewards"].sum(), np.sum(watch.rewards)
    assert 0.0 < total < given


class Robots(VecEnv):
    """Three robots that do nothing."""

    def __init__(self):
        space = gym.spaces.Box(-1.0, 1.0, (36,), np.float64)
        super().__init__(3, space, gym.spaces.Box(-1.0, 1.0, (7,), np.float32))

    def reset(self):
        return np.zeros((3, 36))

    def step_async(self, actions):
        """Nothing."""

    def step_wait(self):
        raise NotImplementedError

    def close(self):
        """Nothing."""

    def get_attr(self, attr_name, indices=None):
        return [None] * 3

    def set_attr(self, attr_name, value, indices=None):
        """Nothing."""

    def env_method(self, method_name, *method_args, indices=None, **method_kwargs):
        return []

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * 3


def test_rewards_are_normalised_by_the_discounted_returns_of_each_robot():
    """Returns R <- gamma R + r of the robots that earned, forgotten where their episode has ended."""
    venv = GateNormalize(Robots(), None, gamma=0.5, clip_reward=100.0)  # type: ignore[arg-type]
    venv.reset()
    seen = []
    venv.ret_rms.update = lambda returns: seen.append(returns.tolist())  # type: ignore[method-assign]
    venv.ret_rms.var = np.array(4.0)
    over = np.array([False, True])
    normalised = venv.earn([0, 2], np.array([1.0, 4.0]), over)
    assert normalised == pytest.approx([0.5, 2.0], rel=1e-6)  # over the deviation of the returns
    venv.earn([0, 1], np.array([3.0, 2.0]), np.zeros(2, np.bool_))
    venv.earn([2, 1], np.array([1.0, 1.0]), over)
    assert seen == [[1.0, 4.0], [3.5, 2.0], [1.0, 2.0]]  # 0.5 x 1 + 3; robot 2 began anew; 0.5 x 2 + 1
    assert venv.returns.tolist() == [3.5, 0.0, 1.0]


def test_with_an_open_gate_it_is_plain_ppo():
    """A robot that is always due makes the rollouts, and so the weights, of Stable-Baselines3's own loop."""

    class Open:
        def __call__(self, observations):
            return np.ones((len(observations), 1), np.float32)

    plain = dataclasses.replace(SETTINGS, gate=None, learning_rate=5e-3)
    weights, statistics = [], []
    for gated in (False, True):
        settings = dataclasses.replace(plain, pushes=PushDistribution(settle_time=30.0))
        venv = make_vec_env(settings, 3)
        assert type(venv) is VecNormalize
        if gated:
            assert isinstance(venv.venv, VecMonitor)
            venv = GateNormalize(venv.venv, Open(), norm_reward=False)  # type: ignore[arg-type]
        model = make_ppo(settings, venv, 3, None)
        assert type(model) is (GatedPPO if gated else PPO)
        before = model.policy.value_net.weight.detach().numpy().copy()
        model.learn(settings.timesteps)
        assert np.abs(model.policy.value_net.weight.detach().numpy() - before).max() > 1e-3
        weights.append(np.concatenate([p.detach().numpy().ravel() for p in model.policy.parameters()]))
        statistics.append(venv.obs_rms.mean)
    np.testing.assert_allclose(weights[1], weights[0], atol=2e-5)
    np.testing.assert_allclose(statistics[1], statistics[0], atol=1e-4)


def test_equal_seeds_give_equal_weights(tmp_path):
    first, second = (train(SETTINGS, tmp_path / name).policy.read_bytes() for name in "ab")
    assert first == second
    assert train(dataclasses.replace(SETTINGS, seed=1), tmp_path / "c").policy.read_bytes() != first


def test_an_interrupted_run_goes_on_to_its_end(tmp_path):
    def stop(timesteps, recovered):
        if timesteps >= 128:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(SETTINGS, tmp_path / "run", stop)
    assert load_checkpoint(tmp_path / "run").timesteps == 128
    result = resume(tmp_path / "run")
    assert result.timesteps == 256
    assert NetworkPolicy.load(result.policy).description.residual.gate == SETTINGS.gate  # type: ignore[union-attr]


def test_pushes_that_never_open_the_gate_are_refused(monkeypatch):
    monkeypatch.setattr(gated_rollout, "MAX_EPISODES", 2)
    weak = PushDistribution(impulse_min=0.1, impulse_max=0.2, settle_time=0.1)
    with pytest.raises(InvalidValueError, match="no push opens it"):
        learn(dataclasses.replace(SETTINGS, pushes=weak))


def test_the_model_is_one_of_stable_baselines3(tmp_path):
    result = train(SETTINGS, tmp_path / "run")
    model = PPO.load(result.policy.parent / "sb3" / "model.zip", device="cpu")
    assert model.predict(np.zeros(36))[0].shape == (7,)
    assert not hasattr(model, "_streams")
