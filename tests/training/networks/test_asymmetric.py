"""The policy network sees the first inputs only, the value network all; what is exported acts alike."""

import numpy as np
import torch
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.training.builders import completed, make_env, make_ppo, make_vec_env
from push_recovery.training.from_sb3 import export_policy
from push_recovery.training.networks import AsymmetricPolicy
from push_recovery.training.settings import TrainingSettings

SETTINGS = TrainingSettings(n_envs=2, walks=2, critic=("push", "sensing"), policy_layers=(8,), n_steps=8)


def made():
    env = make_env(SETTINGS)
    settings = completed(SETTINGS, env)
    venv = make_vec_env(settings, env, 0)
    model = make_ppo(settings, venv, 0, None)
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
    policy = export_policy(model, venv, env, settings)
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
