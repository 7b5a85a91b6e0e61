"""A policy by name, file, MODULE:ATTRIBUTE, or as an object, ready to act in an environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.files import is_file
from ...controllers.learned.network import NetworkPolicy
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.policies.interface import Policy, as_policy
from ..sampling_mpc.settings import NAME as SAMPLING_MPC
from ..shipped.names import NAMES, shipped_names
from .names import DEFAULT_ENV
from .user_object import acting, import_attribute

POLICY_SUFFIXES = (".safetensors", ".json")
FORMS = ("FILE.safetensors", "MODULE:ATTRIBUTE")


def load_policy(policy: Any, env: gym.Env) -> Policy:
    """A policy for an environment: by name, file or MODULE:ATTRIBUTE, or an object with `predict`.

    An attribute may be an object with `predict`, or a class or function that makes one without arguments.

    Raises:
        UnknownNameError: no such name; lists the valid ones.
        InvalidValueError: the file cannot be read, the policy was made for other spaces, or can't act.
    """
    policy = acting(policy)
    if not isinstance(policy, str):
        return as_policy(policy)
    if is_policy_file(policy):
        return _load_file(policy, env)
    if is_attribute(policy):
        return as_policy(acting(import_attribute(policy)[1], policy))
    return make_policy(policy, env)


def make_policy(name: str, env: Any) -> Policy:
    """A policy by name: an analytic one for an environment's robot, gait box and preset, or a shipped one.

    Args:
        name: one of `push-recovery list`, such as "two-stage" or "residual".
        env: a gait environment, single or vector; "sampling-mpc" acts on the robot in it, a single one.

    Raises:
        UnknownNameError: no such name; lists the valid ones.
        InvalidValueError: the environment has no gait, takes residuals, or actions on the joints; a shipped
            policy was made for another environment, or its file is not there.
    """
    from ...controllers.policies.arms import make_policy as make_analytic

    if name in NAMES:
        return load_policy(name, env)
    _refuse_archive(name)
    if name not in policy_names():
        raise UnknownNameError("policy", name, [*policy_names(), *FORMS])
    unwrapped: Any = getattr(env, "unwrapped", env)
    if lacks := [part for part in ("robot", "limits", "preset") if not hasattr(unwrapped, part)]:
        raise InvalidValueError(f"policy {name!r} needs a gait environment; {env} has no {', '.join(lacks)}")
    if acts_on_joints(env):
        return _random_joints(name, unwrapped.episodes)
    if acts_on_residual(env):
        raise InvalidValueError(
            f"policy {name!r} gives whole actions, but this environment takes residuals; score it on the "
            f"environment below, such as {DEFAULT_ENV}"
        )
    if name == SAMPLING_MPC:
        from ..sampling_mpc.policy import SamplingMpcPolicy

        return SamplingMpcPolicy(env)
    return make_analytic(name, unwrapped.robot, unwrapped.limits, unwrapped.preset)


def _random_joints(name: str, episodes: Any) -> Policy:
    """The one analytic policy that acts on joints."""
    from ...controllers.policies.random import RandomPolicy

    if name != "random":
        raise InvalidValueError(
            f"policy {name!r} gives gait actions, but {episodes.name} takes {episodes.action_size} of the "
            f"joints; score it on {DEFAULT_ENV}, and here random, {' or '.join(FORMS)}"
        )
    return RandomPolicy(name, episodes.observation_size, episodes.action_size)


def policy_names() -> tuple[str, ...]:
    """Names that `make_policy` knows: analytic policies, sampling MPC, and those that ship."""
    from ...controllers.policies.arms import POLICY_NAMES

    return (*POLICY_NAMES, SAMPLING_MPC, *shipped_names())


def is_policy_file(name: str) -> bool:
    """Whether a policy argument means a file rather than a name."""
    return Path(name).suffix in POLICY_SUFFIXES or is_file(f"{name}.safetensors")


def is_attribute(name: str) -> bool:
    """Whether a policy argument means an attribute of a module."""
    return ":" in name and not is_policy_file(name)


def acts_on_residual(env: Any) -> bool:
    """Whether the actions of an environment are residuals on a policy of its own."""
    from ...envs.residual.vector_env import ResidualVectorEnv
    from ...envs.residual.wrapper import ResidualAction

    if isinstance(env, ResidualVectorEnv):
        return True
    layer: Any = env
    while isinstance(layer, gym.Wrapper):
        if isinstance(layer, ResidualAction):
            return True
        layer = layer.env
    return False


def acts_on_joints(env: Any) -> bool:
    """Whether the actions of an environment are those of joints instead of a gait."""
    episodes = getattr(getattr(env, "unwrapped", env), "episodes", None)
    return getattr(episodes, "action_size", GAIT_SIZE) != GAIT_SIZE


def _refuse_archive(name: str) -> None:
    """Say what to do about files that hold code."""
    if name.endswith(".zip"):
        raise InvalidValueError(
            f"policy {name!r} is an archive of Stable-Baselines3, and loading one runs its code: where you "
            "trust it, evaluate and compare take --trust; or load it yourself and score the model, "
            "push_recovery.evaluate(policies={'mine': PPO.load(...)})"
        )
    if name.endswith(".py"):
        raise InvalidValueError(f"policy {name!r} is a file of Python: name what acts, MODULE:ATTRIBUTE")


def _load_file(name: str, env: gym.Env) -> NetworkPolicy:
    policy = NetworkPolicy.load(name)
    sizes = (policy.observation_size, policy.action_size)
    spaces = (env.observation_space.shape, env.action_space.shape)
    if ((sizes[0],), (sizes[1],)) != spaces:
        raise InvalidValueError(
            f"policy {name!r} was made for {sizes[0]} observations and {sizes[1]} actions; the environment "
            f"has observation shape {spaces[0]} and action shape {spaces[1]}"
        )
    _check_kind(name, policy, env)
    unwrapped: Any = env.unwrapped
    policy.check_made_for(unwrapped.robot, unwrapped.limits)
    return policy


def _check_kind(name: str, policy: NetworkPolicy, env: gym.Env) -> None:
    """Raise InvalidValueError where whole actions and residuals would be taken for one another.

    A residual's file adds the planner below by itself, so that it acts on the plain environment.
    """
    about = policy.description
    here = env.spec.id if env.spec is not None else type(env.unwrapped).__name__
    if about.residual is not None and acts_on_residual(env):
        raise InvalidValueError(
            f"policy {name!r} is a residual learned on {about.env_id}, its {about.residual.policy} included; "
            f"on {here} that would be added twice: score it on {about.env_id}"
        )
    if about.residual is None and about.env_id.rpartition(":")[2] != here.rpartition(":")[2]:
        raise InvalidValueError(
            f"policy {name!r} acts alone and was made for {about.env_id}, not for {here}: score it there"
        )
