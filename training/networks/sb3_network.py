"""The network and the normalisation of Stable-Baselines3 in numpy."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.sac.policies import SACPolicy
from torch import nn

from ...controllers.errors import InvalidValueError
from ...controllers.learned.mlp import Mlp, Normalisation

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
