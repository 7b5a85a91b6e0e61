"""A model of Stable-Baselines3 as a policy that can be saved, scored and shipped."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecNormalize

from ..controllers.errors import InvalidValueError
from ..controllers.learned.description import PolicyDescription, ResidualBase
from ..controllers.learned.mlp import Mlp, Normalisation
from ..controllers.learned.network import NetworkPolicy
from ..controllers.policies.arms import POLICY_NAMES
from ..envs.residual.action_hold import ActionHold
from ..envs.residual.wrapper import ResidualAction
from .builders import find_residual
from .export import residual_base
from .networks.sb3_network import network_of, normalisation_of
from .settings import ENV_OF_KIND

TOLERANCE = 1e-5  # between numpy and torch, in units of the action
SAMPLES = 256  # observations of the check


def from_sb3(model: Any, env: gym.Env, normalise: VecNormalize | None = None) -> NetworkPolicy:
    """PPO or SAC as a policy that needs neither torch nor Stable-Baselines3.

        from_sb3(model, gym.make("push_recovery:PushRecovery/BipedResidual-v0", hold=2)).save("mine")

    What it gives is compared with the model's own `predict` before it is returned.

    Args:
        model: with an MlpPolicy of tanh or relu layers.
        env: like one of those that it was trained in, wrappers included: a residual and a hold become part of
            the policy.
        normalise: of its observations, where it was trained with one.

    Raises:
        InvalidValueError: the model acts by something that a policy file does not hold, or the environment is
            not like those of its training.
    """
    _check_spaces(model, env)
    network = network_of(model)
    normalisation = normalisation_of(normalise, network.sizes[0])
    _check_agreement(model, network, normalisation, normalise)
    wrapper, hold = find_residual(env), _hold(env)
    unwrapped: Any = env.unwrapped
    if lacks := [part for part in ("robot", "limits", "preset") if not hasattr(unwrapped, part)]:
        raise InvalidValueError(f"a policy file is for a gait environment; {env} has no {', '.join(lacks)}")
    if unwrapped.spec is None:
        raise InvalidValueError(f"{env} has no id, under which its policy could be scored: use gym.make")
    env_id = unwrapped.spec.id
    if wrapper is not None:  # a residual's policy acts on the environment below
        env_id = ENV_OF_KIND["residual"].get(env_id, env_id)
    base = None if wrapper is None else _base(wrapper)
    about = PolicyDescription(env_id, unwrapped.robot, unwrapped.limits, base, hold)
    return NetworkPolicy(network, normalisation, about, None if wrapper is None else wrapper.policy)


def _base(wrapper: ResidualAction) -> ResidualBase:
    """What a residual corrects, by name."""
    policy: Any = wrapper.policy
    name = getattr(policy, "name", None)
    if name not in POLICY_NAMES:
        raise InvalidValueError(
            f"a policy file names what it corrects, one of {', '.join(POLICY_NAMES)}; this residual is on "
            f"{policy!r}"
        )
    return residual_base(wrapper, name)


def _hold(env: gym.Env) -> int:
    """Planning periods for which an action is held.

    Raises:
        InvalidValueError: a wrapper changes what the network sees or gives, and is no part of a policy file.
    """
    periods, layer = 1, env
    while isinstance(layer, gym.Wrapper):
        if isinstance(layer, ActionHold):
            periods *= layer.periods
        elif isinstance(layer, gym.ObservationWrapper | gym.ActionWrapper):
            raise InvalidValueError(
                f"the wrapper {type(layer).__name__} changes observations or actions, and a policy file does "
                "not hold it; for running means use VecNormalize"
            )
        layer = layer.env
    return periods


def _check_spaces(model: Any, env: gym.Env) -> None:
    for name in ("observation_space", "action_space"):
        theirs, here = getattr(model, name), getattr(env, name)
        if theirs != here:
            raise InvalidValueError(f"the model was trained with the {name} {theirs}, and {env} has {here}")
    space = model.action_space
    if not (isinstance(space, gym.spaces.Box) and np.all(space.low == -1.0) and np.all(space.high == 1.0)):
        raise InvalidValueError(f"the actions of a policy file are in [-1, 1], those of the model in {space}")


def _check_agreement(
    model: Any, network: Mlp, normalisation: Normalisation, normalise: VecNormalize | None
) -> None:
    """Raise InvalidValueError where the network in numpy gives other actions than the model."""
    draws = np.random.default_rng(0).normal(size=(SAMPLES, network.sizes[0]))
    rows = normalisation.mean + 2.0 * np.sqrt(normalisation.variance) * draws
    theirs, _ = model.predict(
        rows if normalise is None else normalise.normalize_obs(rows), deterministic=True
    )
    ours = np.clip(network.forward(normalisation.apply(rows)), -1.0, 1.0)
    difference = float(np.abs(ours - theirs).max())
    if not difference <= TOLERANCE:
        raise InvalidValueError(
            f"the network in numpy differs from the model by {difference:.2g} in the action: a policy file "
            "does not hold all that this model acts by"
        )
