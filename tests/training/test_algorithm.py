"""Another algorithm, added from outside: SAC of Stable-Baselines3 trains, resumes and is exported."""

import dataclasses

import numpy as np
import pytest
import torch
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.training.algorithm import Algorithm
from push_recovery.training.run import Run, load_checkpoint, resume, train
from push_recovery.training.settings import ALGORITHMS, TrainingSettings
from stable_baselines3 import SAC

UPDATE = 8  # timesteps between two updates


class SoftActorCritic(Algorithm):
    """All that SAC needs to be trained here."""

    def make(self, seed, log):
        s = self.settings
        return SAC(
            "MlpPolicy", self.venv, learning_rate=s.learning_rate, batch_size=s.batch_size, gamma=s.gamma,
            buffer_size=1000, learning_starts=64, train_freq=UPDATE, policy_kwargs={
                "net_arch": {"pi": list(s.policy_layers), "qf": list(s.value_layers)},
                "activation_fn": torch.nn.ReLU,
            }, tensorboard_log=log, seed=seed, device="cpu",
        )  # fmt: skip


@pytest.fixture
def settings(toy, monkeypatch):
    monkeypatch.setitem(ALGORITHMS, "sac", SoftActorCritic)
    return TrainingSettings(
        kind="scratch", env_id=toy, algorithm="sac", timesteps=480, n_envs=2, hold=1, batch_size=32,
        gamma=0.9, policy_layers=(16,), value_layers=(16,), learning_rate=3e-3, checkpoint_every=96,
        evaluate_every=480, evaluation_scenarios=2,
    )  # fmt: skip


def test_it_trains_and_is_exported_as_a_policy_that_acts_as_it_does(tmp_path, settings):
    result = train(settings, tmp_path / "run")
    assert result.timesteps == 480
    policy = NetworkPolicy.load(result.policy)
    assert (policy.network.activation, policy.network.output) == ("relu", "tanh")
    model = SAC.load(tmp_path / "run" / "sb3" / "model.zip", device="cpu")
    assert model._n_updates > 0
    rows = np.random.default_rng(0).normal(0.0, 0.5, (50, 36))
    theirs, _ = model.predict(policy.normalisation.apply(rows), deterministic=True)
    ours, _ = policy.predict(rows)
    assert np.abs(theirs).max() > 0.01
    np.testing.assert_allclose(ours, theirs, atol=1e-5)


def test_what_it_has_learned_survives_an_interrupt(tmp_path, settings, stop_at):
    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(settings, out, stop_at(240))
    checkpoint = load_checkpoint(out)
    assert checkpoint.timesteps == 240
    assert checkpoint.settings.algorithm == "sac"
    names = checkpoint.tensors
    assert {"log_ent_coef", "policy.actor.mu.weight", "policy.critic_target.qf0.0.weight"} <= names.keys()
    assert any(name.startswith("actor.optimizer.0.") for name in names)
    assert any(name.startswith("critic.optimizer.0.") for name in names)
    run = Run(checkpoint.settings, tmp_path / "other")
    untrained = run.algorithm.tensors()
    assert (untrained["policy.actor.mu.weight"] != names["policy.actor.mu.weight"]).any()
    run.algorithm.restore(names, checkpoint.timesteps, checkpoint.updates)
    restored = run.algorithm.tensors()
    run.close()
    assert restored.keys() == names.keys()
    for name, value in restored.items():
        np.testing.assert_array_equal(value, names[name], err_msg=name)
    assert run.algorithm.updates == checkpoint.updates > 0
    assert resume(out).timesteps == 480


def test_it_begins_as_a_policy_of_its_own_kind(tmp_path, settings):
    first = train(dataclasses.replace(settings, timesteps=160), tmp_path / "first").policy
    begun = dataclasses.replace(settings, initial=str(first), timesteps=0)
    mine = NetworkPolicy.load(train(begun, tmp_path / "begun").policy)
    rows = np.random.default_rng(0).normal(size=(20, 36))
    np.testing.assert_array_equal(mine.predict(rows)[0], NetworkPolicy.load(first).predict(rows)[0])
    with pytest.raises(InvalidValueError, match="relu and tanh, got tanh and linear"):
        train(dataclasses.replace(begun, algorithm="ppo"), tmp_path / "ppo")


def test_an_unknown_algorithm_is_refused_by_name():
    with pytest.raises(UnknownNameError, match=r"algorithm 'pop'; did you mean 'ppo'\? \(valid: ppo\)"):
        TrainingSettings(algorithm="pop")
