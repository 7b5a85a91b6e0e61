"""Models of Stable-Baselines3 as policy files: their networks and normalisation in numpy."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common import policies, torch_layers
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.sac.policies import SACPolicy
from torch import nn

from ..controllers.errors import InvalidValueError
from ..controllers.policies.learned import NetworkPolicy, PolicyDescription, ResidualBase
from ..controllers.policies.mlp import OBSERVATION, Mlp, Normalisation
from ..controllers.policies.two_stage import POLICY_NAMES
from ..envs.episode.gym_env import noted
from ..envs.wrappers import ActionHold, ResidualAction
from ..eval.rollout.environments import make_env
from .builders import find_residual, layers_of
from .model_policy import (
    Changing,
    Trained,
    check_normalisation,
    check_wrappers,
    id_of,
    in_memory,
    lacking,
    normaliser,
    unlike,
    words,
)
from .settings import TrainingSettings, env_of_kind

ACTIVATIONS: dict[type[nn.Module], str] = {nn.Tanh: "tanh", nn.ReLU: "relu"}
LARGEST = float(np.finfo(np.float32).max)
TOLERANCE = 1e-5  # between numpy and torch, in units of the action
SAMPLES = 256  # observations of the check


@dataclass(frozen=True)
class ActingNetwork:
    """The layers that a model acts by, and what stands between and behind them."""

    layers: list[nn.Linear]
    activation: str = "tanh"  # as `Mlp` names it
    output: str = "linear"

    def mlp(self) -> Mlp:
        """The same network in numpy."""
        weights, biases = (
            tuple(getattr(layer, name).detach().cpu().numpy().copy() for layer in self.layers)
            for name in ("weight", "bias")
        )
        return Mlp(weights, biases, self.activation, self.output)


def acting_network(model: Any) -> ActingNetwork:
    """The layers that a model of Stable-Baselines3 acts by: PPO's mean, or tanh of SAC's.

    Args:
        model: PPO (A2C alike) or SAC with an MlpPolicy of tanh or relu layers.

    Raises:
        InvalidValueError: it acts by something else.
    """
    policy = model.policy
    if isinstance(policy, policies.ActorCriticPolicy):
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
    if type(extractor) is not torch_layers.FlattenExtractor:
        raise InvalidValueError(f"a policy file has no features extractor {type(extractor).__name__}")
    return ActingNetwork(*_layers([*body, last]), "tanh" if squashed else "linear")


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


def export_policy(
    network: Mlp, venv: VecNormalize, env: gym.Env, settings: TrainingSettings
) -> NetworkPolicy:
    """The policy of a run as it stands, which needs neither torch nor Stable-Baselines3."""
    unwrapped: Any = env.unwrapped
    wrapper = find_residual(env) if settings.residual else None  # or it is the environment's own
    base = None if wrapper is None else residual_base(wrapper, settings.policy)
    inputs = settings.inputs or (OBSERVATION,)
    about = PolicyDescription(
        settings.env_id, unwrapped.robot, unwrapped.limits, base, settings.periods, inputs
    )
    whole, seen = normalisation_of(venv), slice(network.sizes[0])  # behind it is what only the critic sees
    normalisation = replace(whole, mean=whole.mean[seen], variance=whole.variance[seen])
    return NetworkPolicy(network, normalisation, about, None if wrapper is None else wrapper.policy)


def residual_base(wrapper: ResidualAction, name: str) -> ResidualBase:
    """The policy that a residual corrects, by its name, and how."""
    preset = str(wrapper.unwrapped.preset)  # type: ignore[attr-defined]
    config = getattr(wrapper.policy, "config", None)
    return ResidualBase(name, preset, tuple(wrapper.scale.tolist()), config, wrapper.gate)


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
        InvalidValueError: the model acts by something that a policy file does not hold, or the environment or
            the normalisation is not like that of its training.
    """
    hold, trained = _hold(env), in_memory(model)
    check_wrappers(trained, env)
    _check_spaces(model, env)
    normalise = _normalise(trained, normalise)
    network = acting_network(model).mlp()
    normalisation = normalisation_of(normalise, network.sizes[0])
    _check_agreement(model, network, normalisation, normalise)
    _check_meaning(trained, env)
    wrapper = find_residual(env)
    unwrapped: Any = env.unwrapped
    if lacks := [part for part in ("robot", "limits", "preset") if not hasattr(unwrapped, part)]:
        raise InvalidValueError(f"a policy file is for a gait environment; {env} has no {', '.join(lacks)}")
    if unwrapped.spec is None:
        raise InvalidValueError(f"{env} has no id, under which its policy could be scored: use gym.make")
    env_id = unwrapped.spec.id
    base = None
    if wrapper is not None:  # a residual's policy acts on the environment below
        env_id = env_of_kind("residual", env_id)
        name = getattr(wrapper.policy, "name", None)
        if name not in POLICY_NAMES:
            raise InvalidValueError(
                f"a policy file names what it corrects, one of {', '.join(POLICY_NAMES)}; this residual is "
                f"on {wrapper.policy!r}"
            )
        base = residual_base(wrapper, name)
    _check_held(env, env_id)
    about = PolicyDescription(env_id, unwrapped.robot, unwrapped.limits, base, hold)
    return NetworkPolicy(network, normalisation, about, None if wrapper is None else wrapper.policy)


def _hold(env: gym.Env) -> int:
    """Planning periods for which an action is held.

    Raises:
        InvalidValueError: a wrapper changes what the network sees or gives, and is no part of a policy file.
    """
    periods = 1
    for layer in layers_of(env):
        if isinstance(layer, ActionHold):
            periods *= layer.periods
        elif isinstance(layer, Changing):
            raise InvalidValueError(
                f"the wrapper {type(layer).__name__} may change observations or actions, and a policy file "
                "does not hold it; for running means use VecNormalize, for rewards alone a "
                "gymnasium.RewardWrapper"
            )
    return periods


def _normalise(trained: Trained, given: VecNormalize | None) -> VecNormalize | None:
    """The layer of what was handed over that normalises observations.

    Raises:
        InvalidValueError: the model has seen them otherwise.
    """
    mine: Any = trained.statistics
    found: Any = normaliser(given)
    check_normalisation(trained._replace(statistics=found), "hand them over as `normalise`, or ")
    if not trained.has_env or mine is found:
        return found
    if mine is None or found is None:
        there, here = ("raw" if one is None else "normalised" for one in (mine, found))
        raise InvalidValueError(
            f"{trained.name} was trained on {there} observations, and those of `normalise` are {here}: "
            "from_sb3(model, env, model.get_vec_normalize_env()) takes the right ones"
        )
    pairs = [(one.obs_rms.mean, one.obs_rms.var, one.clip_obs, one.epsilon) for one in (mine, found)]
    if not all(np.array_equal(one, other) for one, other in zip(*pairs, strict=True)):
        raise InvalidValueError(
            f"the statistics of `normalise` are not those of {trained.name}: "
            "from_sb3(model, env, model.get_vec_normalize_env()) takes the right ones"
        )
    return found


def _check_meaning(trained: Trained, env: gym.Env) -> None:
    """Raise InvalidValueError where a model says that its actions meant something else in its training."""
    here = noted(env.action_space) or {}
    # Whoever loads a model may give it another environment, and its own space keeps what was noted first
    for space, env_id in (trained.action, trained.env_id), (trained.model.action_space, ""):
        theirs = noted(space)
        if theirs is not None and theirs != here:
            raise InvalidValueError(
                f"{trained.name} was trained in {words(theirs, env_id)}, and the environment handed over is "
                f"{words(here, id_of(env))}: {unlike(theirs, here)}; hand over one like that of its training"
            )


def _check_held(env: gym.Env, env_id: str) -> None:
    """Raise InvalidValueError where actions mean more than a policy file holds.

    A policy file is scored in `env_id` as it is, and holds robot, gait box, one residual and the hold.
    """
    if (here := noted(env.action_space)) is None:
        return
    made = make_env(env_id)
    there = (noted(made.action_space) or {}) | {key: here[key] for key in ("robot", "limits") if key in here}
    if isinstance(lacks := lacking(here, there), str):
        raise InvalidValueError(
            f"a policy file is scored in {env_id}, and the environment handed over differs from it in more "
            f"than one residual and its hold: {lacks}"
        )


def _check_spaces(model: Any, env: gym.Env) -> None:
    for name in ("observation_space", "action_space"):
        theirs, here = getattr(model, name), getattr(env, name)
        if theirs != here:
            raise InvalidValueError(f"the model was trained with the {name} {theirs}, and {env} has {here}")
    if len(model.observation_space.shape or ()) != 1:
        raise InvalidValueError(
            f"a policy file sees one row of numbers, and the model takes {model.observation_space}"
        )
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
