"""Networks of Stable-Baselines3: an asymmetric critic, a start from a policy, and weights in numpy.

The network and the normalisation of Stable-Baselines3 in numpy.

PPO whose value network sees more than its policy network (Pinto et al., 2017).

PPO that goes on from a policy that walks already.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor, MlpExtractor
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.sac.policies import SACPolicy
from torch import nn

from ..controllers.errors import InvalidValueError
from ..controllers.policies.learned import NetworkPolicy
from ..controllers.policies.mlp import Mlp, Normalisation

ACTIVATIONS: dict[type[nn.Module], str] = {nn.Tanh: "tanh", nn.ReLU: "relu"}
LARGEST = float(np.finfo(np.float32).max)


def network_of(model: Any) -> Mlp:
    """What a model of Stable-Baselines3 acts by: PPO's mean, or tanh of SAC's.

    Args:
        model: PPO (A2C alike) or SAC with an MlpPolicy of tanh or relu layers.

    Raises:
        InvalidValueError: it acts by something else.
    """
    policy = model.policy
    if isinstance(policy, ActorCriticPolicy):
        extractor, body, last = (
            policy.pi_features_extractor,
            policy.mlp_extractor.policy_net,
            policy.action_net,
        )
        squashed = policy.squash_output
    elif isinstance(policy, SACPolicy):
        actor = policy.actor
        extractor, body, last, squashed = actor.features_extractor, actor.latent_pi, actor.mu, True
    else:
        raise InvalidValueError(
            f"a policy file is made of PPO's or SAC's MlpPolicy, got a {type(policy).__name__} of "
            f"{type(model).__name__}"
        )
    if type(extractor) is not FlattenExtractor:
        raise InvalidValueError(f"a policy file has no features extractor {type(extractor).__name__}")
    layers, activation = _layers([*body, last])
    return Mlp(
        tuple(layer.weight.detach().cpu().numpy().copy() for layer in layers),
        tuple(layer.bias.detach().cpu().numpy().copy() for layer in layers),
        activation,
        "tanh" if squashed else "linear",
    )


def _layers(modules: Iterable[nn.Module]) -> tuple[list[nn.Linear], str]:
    """Linear layers, and the one activation that stands between them.

    Raises:
        InvalidValueError: there is anything else, or the activations are not all alike.
    """
    inner = list(modules)
    linear, between = inner[::2], inner[1::2]
    names = {ACTIVATIONS.get(type(module), "") for module in between} or {"tanh"}
    layers = [layer for layer in linear if isinstance(layer, nn.Linear)]
    plain = len(layers) == len(linear) and all(layer.bias is not None for layer in layers)
    if not plain or len(inner) % 2 == 0 or len(names) > 1 or "" in names:
        kinds = ", ".join(type(module).__name__ for module in inner)
        raise InvalidValueError(
            f"a policy file is made of Linear layers with Tanh, or with ReLU, between them; this network is "
            f"{kinds}"
        )
    return layers, names.pop()


def normalisation_of(venv: VecNormalize | None, size: int = 0) -> Normalisation:
    """The normalisation of observations; without one, that which changes no float32.

    Args:
        venv: of the training; None: none.
        size: of the observation, needed where there is no normalisation.

    Raises:
        InvalidValueError: it is of observations that are no rows.
    """
    if venv is None or not venv.norm_obs:
        return Normalisation(np.zeros(size), np.ones(size), LARGEST, np.finfo(np.float64).tiny)
    statistics: Any = venv.obs_rms
    if isinstance(statistics, dict):
        raise InvalidValueError("a policy file normalises one row of observations, not a dict of them")
    return Normalisation(
        np.array(statistics.mean, dtype=np.float64),
        np.array(statistics.var, dtype=np.float64),
        float(venv.clip_obs),
        float(venv.epsilon),
    )


class AsymmetricExtractor(MlpExtractor):
    """Hidden layers of both networks, of which that of the policy sees the first `seen` inputs only.

    Args:
        seen: inputs of the policy network.
        feature_dim: inputs of the value network.
        options: those of `MlpExtractor`.
    """

    def __init__(self, seen: int, feature_dim: int, **options: Any):
        super().__init__(feature_dim, **options)
        self.seen = seen
        first: Any = self.policy_net[0]
        self.policy_net[0] = torch.nn.Linear(seen, first.out_features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Of the policy network, features (n, feature_dim)."""
        return self.policy_net(features[:, : self.seen])


class AsymmetricPolicy(ActorCriticPolicy):
    """`MlpPolicy` with an `AsymmetricExtractor`; `seen` is its argument more."""

    def __init__(self, *arguments: Any, seen: int, **options: Any):
        self.seen = seen
        super().__init__(*arguments, **options)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | {"seen": self.seen}

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = AsymmetricExtractor(
            self.seen,
            self.features_dim,
            net_arch=self.net_arch,
            activation_fn=self.activation_fn,
            device=self.device,
        )


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
