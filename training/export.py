"""The policy of a run as a `NetworkPolicy`, which needs neither torch nor Stable-Baselines3."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium as gym
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from ..controllers.learned.description import PolicyDescription, ResidualBase
from ..controllers.learned.inputs import OBSERVATION
from ..controllers.learned.network import NetworkPolicy
from ..envs.residual.wrapper import ResidualAction
from .builders import find_residual
from .networks.sb3_network import network_of, normalisation_of
from .settings import TrainingSettings


def export_policy(model: PPO, venv: VecNormalize, env: gym.Env, settings: TrainingSettings) -> NetworkPolicy:
    """The policy as it stands, in numpy.

    Args:
        model: SB3's PPO with an MlpPolicy.
        venv: Its normalisation.
        env: One training environment, for the robot, the limits and the policy below.
        settings: Of the run, completed.
    """
    unwrapped: Any = env.unwrapped
    wrapper = find_residual(env) if settings.residual else None  # or it is the environment's own
    base = None if wrapper is None else residual_base(wrapper, settings.policy)
    description = PolicyDescription(
        settings.env_id,
        unwrapped.robot,
        unwrapped.limits,
        base,
        settings.periods,
        settings.inputs or (OBSERVATION,),
    )
    below = None if wrapper is None else wrapper.policy
    network, whole = network_of(model), normalisation_of(venv)
    seen = slice(network.weights[0].shape[1])  # what only the critic sees stands behind it
    normalisation = replace(whole, mean=whole.mean[seen], variance=whole.variance[seen])
    return NetworkPolicy(network, normalisation, description, below)


def residual_base(wrapper: ResidualAction, name: str) -> ResidualBase:
    """What a residual corrects, the policy below by its name."""
    preset = str(wrapper.unwrapped.preset)  # type: ignore[attr-defined]
    config = getattr(wrapper.policy, "config", None)
    return ResidualBase(name, preset, tuple(wrapper.scale.tolist()), config, wrapper.gate)
