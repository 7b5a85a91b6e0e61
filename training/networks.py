"""The acting network of a model of Stable-Baselines3, and the normalisation before it, in numpy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.sac.policies import SACPolicy
from torch import nn

from ..controllers.errors import InvalidValueError
from ..controllers.policies.mlp import Mlp, Normalisation

ACTIVATIONS: dict[type[nn.Module], str] = {nn.Tanh: "tanh", nn.ReLU: "relu"}
LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class ActingNetwork:
    """The layers that a model acts by, and what stands between and behind them."""

    layers: list[nn.Linear]
    activation: str  # as `Mlp` names it
    output: str


def acting_network(model: Any) -> ActingNetwork:
    """The layers that a model of Stable-Baselines3 acts by: PPO's mean, or tanh of SAC's.

    Args:
        model: PPO (A2C alike) or SAC with an MlpPolicy of tanh or relu layers.

    Raises:
        InvalidValueError: it acts by something else.
    """
    policy = model.policy
    if isinstance(policy, ActorCriticPolicy):
        extractor, squashed = policy.pi_features_extractor, policy.squash_output
        body, last = policy.mlp_extractor.policy_net, policy.action_net
    elif isinstance(policy, SACPolicy):
        extractor, squashed = policy.actor.features_extractor, True
        body, last = policy.actor.latent_pi, policy.actor.mu
    else:
        raise InvalidValueError(
            f"a policy file is made of PPO's or SAC's MlpPolicy, got a {type(policy).__name__} of "
            f"{type(model).__name__}"
        )
    if type(extractor) is not FlattenExtractor:
        raise InvalidValueError(f"a policy file has no features extractor {type(extractor).__name__}")
    return ActingNetwork(*_layers([*body, last]), "tanh" if squashed else "linear")


def network_of(model: Any) -> Mlp:
    """The `acting_network` of a model in numpy."""
    acting = acting_network(model)
    weights, biases = (
        tuple(getattr(layer, name).detach().cpu().numpy().copy() for layer in acting.layers)
        for name in ("weight", "bias")
    )
    return Mlp(weights, biases, acting.activation, acting.output)


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
    mean, variance = (np.array(values, dtype=np.float64) for values in (statistics.mean, statistics.var))
    return Normalisation(mean, variance, float(venv.clip_obs), float(venv.epsilon))
