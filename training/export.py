"""From Stable-Baselines3's network to a `NetworkPolicy` that needs neither torch nor SB3."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from ..controllers.learned.description import PolicyDescription, ResidualBase
from ..controllers.learned.inputs import OBSERVATION
from ..controllers.learned.mlp import Mlp, Normalisation
from ..controllers.learned.network import NetworkPolicy
from .builders import find_residual
from .settings import TrainingSettings


def export_policy(model: PPO, venv: VecNormalize, env: gym.Env, settings: TrainingSettings) -> NetworkPolicy:
    """The policy as it stands, in numpy.

    Args:
        model: SB3's PPO with an MlpPolicy of tanh layers.
        venv: Its normalisation.
        env: One training environment, for the robot, the limits and the policy below.
        settings: Of the run, completed.
    """
    hidden = [layer for layer in model.policy.mlp_extractor.policy_net if isinstance(layer, nn.Linear)]
    layers = [*hidden, model.policy.action_net]
    network = Mlp(
        tuple(layer.weight.detach().numpy().copy() for layer in layers),
        tuple(layer.bias.detach().numpy().copy() for layer in layers),
    )
    statistics: Any = venv.obs_rms
    normalisation = Normalisation(
        np.array(statistics.mean, dtype=np.float64),
        np.array(statistics.var, dtype=np.float64),
        float(venv.clip_obs),
        float(venv.epsilon),
    )
    unwrapped: Any = env.unwrapped
    wrapper = find_residual(env) if settings.residual else None  # or it is the environment's own
    base = None
    if wrapper is not None:
        config = getattr(wrapper.policy, "config", None)
        base = ResidualBase(
            settings.policy, unwrapped.preset, tuple(wrapper.scale.tolist()), config, wrapper.gate
        )
    description = PolicyDescription(
        settings.env_id,
        unwrapped.robot,
        unwrapped.limits,
        base,
        settings.hold,
        settings.inputs or (OBSERVATION,),
    )
    return NetworkPolicy(network, normalisation, description, None if wrapper is None else wrapper.policy)
