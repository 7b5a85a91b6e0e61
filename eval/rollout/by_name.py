"""Environments and policies by name, as the command line gives them."""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium as gym

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.policies.interface import Policy
from ...controllers.policies.network import NetworkPolicy
from ...controllers.policies.policy_file import policy_paths
from ...controllers.settings.arms import ARMS
from ...controllers.settings.presets import is_preset_file, load_preset

NAMESPACE = "PushRecovery/"
DEFAULT_ENV = "PushRecovery/Biped-v0"
ANALYTIC_ARMS = tuple(ARMS)
POLICY_SUFFIXES = (".safetensors", ".json")


def env_ids() -> list[str]:
    """Registered ids of this project."""
    return sorted(name for name in gym.registry if name.startswith(NAMESPACE))


def make_env(env_id: str, **kwargs: Any) -> gym.Env:
    """gym.make of one of this project's ids, or of MODULE:ID; ID@PRESET takes a preset, by name or file.

    Raises:
        UnknownNameError: no such id; lists the valid ones.
        InvalidValueError: the environment cannot be made, or has not the interface that scoring needs.
    """
    name, _, preset = env_id.removeprefix("push_recovery:").partition("@")
    if preset:
        kwargs = {"preset": preset, **kwargs}
    if ":" not in name and name not in env_ids():
        raise UnknownNameError("environment", env_id, env_ids())
    try:
        env = gym.make(name, disable_env_checker=True, **kwargs)
    except (gym.error.Error, ModuleNotFoundError) as error:
        raise InvalidValueError(f"cannot make environment {env_id!r}: {error}") from error
    if lacks := [part for part in ("robot", "limits", "preset") if not hasattr(env.unwrapped, part)]:
        raise InvalidValueError(f"environment {env_id!r} has no {', '.join(lacks)} on env.unwrapped")
    return env


def policy_names() -> tuple[str, ...]:
    """Names that `make_policy` knows."""
    from ...controllers.policies.two_stage import POLICY_NAMES

    return tuple(POLICY_NAMES)


def is_policy_file(name: str) -> bool:
    """Whether a policy argument means a file rather than a name."""
    return Path(name).suffix in POLICY_SUFFIXES or Path(f"{name}.safetensors").is_file()


def _acts_on_residual(env: gym.Env) -> bool:
    from ...envs.residual.wrapper import ResidualAction

    layer: gym.Env = env
    while isinstance(layer, gym.Wrapper):
        if isinstance(layer, ResidualAction):
            return True
        layer = layer.env
    return False


def load_policy(name: str, env: gym.Env) -> Policy:
    """The policy of a name or file, for an environment.

    Raises:
        UnknownNameError: no such name; lists the valid ones.
        InvalidValueError: the file cannot be read, or the policy was made for other spaces.
    """
    unwrapped: Any = env.unwrapped
    if not is_policy_file(name):
        if name not in policy_names():
            raise UnknownNameError("policy", name, [*policy_names(), "FILE.safetensors"])
        if _acts_on_residual(env):
            raise InvalidValueError(
                f"policy {name!r} gives whole actions, but this environment takes residuals; score it on the "
                f"environment below, such as {DEFAULT_ENV}"
            )
        from ...controllers.policies.two_stage import make_policy

        return make_policy(name, unwrapped.robot, unwrapped.limits, unwrapped.preset)
    policy = NetworkPolicy.load(name)
    sizes = (policy.observation_size, policy.action_size)
    spaces = (env.observation_space.shape, env.action_space.shape)
    if ((sizes[0],), (sizes[1],)) != spaces:
        raise InvalidValueError(
            f"policy {name!r} was made for {sizes[0]} observations and {sizes[1]} actions; the environment "
            f"has observation shape {spaces[0]} and action shape {spaces[1]}"
        )
    _check_kind(name, policy, env)
    policy.check_made_for(unwrapped.robot, unwrapped.limits)
    return policy


def _check_kind(name: str, policy: NetworkPolicy, env: gym.Env) -> None:
    """Raise InvalidValueError where whole actions and residuals would be taken for one another.

    A residual's file adds the planner below by itself, so that it acts on the plain environment.
    """
    about = policy.description
    here = env.spec.id if env.spec is not None else type(env.unwrapped).__name__
    if about.residual is not None and _acts_on_residual(env):
        raise InvalidValueError(
            f"policy {name!r} is a residual learned on {about.env_id}, its {about.residual.policy} included; "
            f"on {here} that would be added twice: score it on {about.env_id}"
        )
    if about.residual is None and about.env_id.rpartition(":")[2] != here.rpartition(":")[2]:
        raise InvalidValueError(
            f"policy {name!r} acts alone and was made for {about.env_id}, not for {here}: score it there"
        )


def preset_digest(env_id: str) -> dict[str, str]:
    """SHA-256 of the preset file that an ID@FILE.json names, for a configuration; nothing without one."""
    preset = env_id.partition("@")[2]
    if not is_preset_file(preset):
        return {}
    return {"preset_sha256": hashlib.sha256(Path(preset).read_bytes()).hexdigest()}


def env_label(env_id: str) -> str:
    """The environment's own part of an id, for the name of a directory."""
    return env_id.partition("@")[0].rpartition("/")[2]


def with_preset(env_id: str, preset: str | None) -> str:
    """The id with the preset of an option; raises InvalidValueError for a preset that does not exist."""
    if preset is None:
        return env_id
    load_preset(preset)
    return f"{env_id}@{preset}"


@cache
def code_digest() -> str:
    """SHA-256 over the source of controllers and envs: results of other code are not mixed."""
    digest = hashlib.sha256()
    for package in ("controllers", "envs"):
        module = importlib.import_module(f"...{package}", __package__)
        for root in sorted(module.__path__):
            for path in sorted(Path(root).rglob("*")):
                if path.suffix in {".py", ".xml", ".json"}:
                    digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def file_digest(name: str) -> str | None:
    """SHA-256 of a policy file's weights and description; None for a named policy."""
    if not is_policy_file(name):
        return None
    return hashlib.sha256(b"".join(path.read_bytes() for path in policy_paths(name))).hexdigest()


def require_distinct(kind: str, names: Iterable[str]) -> list[str]:
    """The names as a list; raises InvalidValueError where one comes twice."""
    names = list(names)
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InvalidValueError(f"{kind} {twice[0]!r} is given more than once")
    return names
