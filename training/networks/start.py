"""PPO that goes on from a policy that walks already."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from ...controllers.errors import InvalidValueError
from ...controllers.learned.network import NetworkPolicy

KEPT = 1e15  # observations that count as seen before: what a run adds to them changes nothing


def start_from(policy: NetworkPolicy, model: PPO, venv: VecNormalize) -> None:
    """Give PPO's policy network the weights of a policy, and its environments the normalisation.

    The normalisation stays as it is from then on: the weights were learned behind it. What only a critic sees
    stands behind it, and passes as it is.

    Raises:
        InvalidValueError: the layers are of other widths, or the normalisation is another one.
    """
    net: Any = model.policy
    layers = [one for one in net.mlp_extractor.policy_net if isinstance(one, torch.nn.Linear)]
    layers.append(net.action_net)
    found = tuple((layer.in_features, layer.out_features) for layer in layers)
    given = tuple((weight.shape[1], weight.shape[0]) for weight in policy.network.weights)
    if found != given:
        raise InvalidValueError(
            f"a run that starts from a policy needs its layers, {given}, got {found}: set policy_layers"
        )
    normalisation = policy.normalisation
    statistics: Any = venv.obs_rms
    if (venv.clip_obs, venv.epsilon) != (normalisation.clip, normalisation.epsilon):
        raise InvalidValueError(
            f"the policy's clip and epsilon {(normalisation.clip, normalisation.epsilon)} are not the "
            f"environments', {(venv.clip_obs, venv.epsilon)}"
        )
    for layer, weight, bias in zip(layers, policy.network.weights, policy.network.biases, strict=True):
        layer.weight.data.copy_(torch.from_numpy(weight))
        layer.bias.data.copy_(torch.from_numpy(bias))
    more = len(statistics.mean) - len(normalisation.mean)
    statistics.mean = np.append(normalisation.mean, np.zeros(more))
    statistics.var = np.append(normalisation.variance, np.ones(more))
    statistics.count = KEPT


class ValueFirst(BaseCallback):
    """Lets the policy rest until the value network has learned what it is worth.

    Args:
        timesteps: of rest.
    """

    def __init__(self, timesteps: int):
        super().__init__()
        self.timesteps = timesteps

    def _on_rollout_start(self) -> None:
        policy: Any = self.model.policy
        acts = self.num_timesteps >= self.timesteps
        parts = policy.mlp_extractor.policy_net, policy.action_net
        for parameter in (policy.log_std, *(one for part in parts for one in part.parameters())):
            parameter.requires_grad_(acts)

    def _on_step(self) -> bool:
        return True
