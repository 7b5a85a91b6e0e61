"""Policies by name, file, MODULE:ATTRIBUTE or as objects, made ready to act in an environment.

Learned policies that come with the package lie in the folder `policies/` beside this module, as
NAME.safetensors and NAME.json. They are no code: a new one leaves the digest of the code, and with it the
rows of all others, as they are. How each came about stands in its JSON; its settings are those of
`training.settings`.
"""

import hashlib
import importlib
import inspect
import os
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.files import is_file, read_file
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.policies import two_stage
from ...controllers.policies.interface import Policy, as_policy
from ...controllers.policies.learned import NetworkPolicy, policy_paths
from ...envs.joint.full_body import FullBodyEpisodes
from ...envs.wrappers import ResidualAction, ResidualVectorEnv
from .. import sampling_mpc
from ..output.rows import read_json
from . import DEFAULT_ENV
from .contender import Contender
from .contract_files import PACKAGED, Trusted, contract_name, is_contract, read_contract

FOLDER = Path(__file__).parent / "policies"
NAMES = (
    "residual", "residual-hardware", "scratch", "joint", "joint-residual", "joint-residual-hardware",
    "residual-g1", "joint-residual-g1", "joint-residual-t1", "joint-residual-jvrc1", "joint-g1",
)  # fmt: skip


def shipped_names() -> tuple[str, ...]:
    """NAMES whose files are there."""
    return tuple(name for name in NAMES if all(path.is_file() for path in policy_paths(FOLDER / name)))


def shipped_digest() -> str:
    """SHA-256 of the policies that are there: their names and files."""
    digest = hashlib.sha256()
    for name in shipped_names():
        digest.update(name.encode() + b"\0")
        for path in policy_paths(FOLDER / name):
            digest.update(hashlib.sha256(read_file(path)).digest())
    return digest.hexdigest()


def training_note(path: Path) -> Any:
    """The entry `training` of a policy's JSON, how it came about; None where there is none.

    Raises:
        InvalidValueError: the file can't be read, or is no JSON.
    """
    about = read_json(path, "the policy description")
    return about.get("training") if isinstance(about, dict) else None


def named_file(name: str) -> str:
    """The weights' file that a name stands for; what is no name of a shipped policy comes back as it is.

    Raises:
        InvalidValueError: a name of a policy whose files are not there.
    """
    if name not in NAMES:
        return name
    if name not in shipped_names():
        there = ", ".join(shipped_names()) or "none"
        raise InvalidValueError(
            f"policy {name!r} does not come with this version, whose trained policies are: {there}; "
            f"train it with: push-recovery policies {name}"
        )
    return str(policy_paths(FOLDER / name)[0])


def import_from_here(name: str) -> Any:
    """Import a module that the user named, also from the working directory as `python -m` has it.

    Raises:
        InvalidValueError: no such module, or it can't be imported.
    """
    if not all(part.isidentifier() for part in name.split(".")):
        raise InvalidValueError(f"{name!r:.200} is no name of a module")
    here = os.getcwd()
    if here not in sys.path and "" not in sys.path:
        sys.path.insert(0, here)
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidValueError(f"cannot import {name!r}: {error}") from error


def import_attribute(name: str) -> tuple[Any, Any]:
    """Module and attribute of MODULE:ATTRIBUTE.

    Raises:
        UnknownNameError: the module has no such attribute; lists those that it has.
        InvalidValueError: no such module, or it can't be imported.
    """
    module_name, _, path = name.partition(":")
    found = module = import_from_here(module_name)
    for part in path.split("."):
        if not part or not hasattr(found, part):
            valid = [entry for entry in vars(found) if not entry.startswith("_")]
            raise UnknownNameError(f"attribute of {module_name}", part, sorted(valid))
        found = getattr(found, part)
    return module, found


def acting(policy: Any, name: str = "") -> Any:
    """A name as text, or an object that acts; a class or a function without `predict` is called for it.

    The name of a shipped policy becomes that of its file.

    Raises:
        InvalidValueError: there is no way to an object with `predict`, or no file of a shipped policy.
    """
    if isinstance(policy, str | os.PathLike):
        return named_file(os.fspath(policy))
    name = name or repr(policy)[:200]
    if isinstance(policy, type) or (callable(policy) and not hasattr(policy, "predict")):
        try:
            policy = policy()
        except TypeError as error:
            raise InvalidValueError(f"policy {name} cannot be made without arguments: {error}") from error
    if not callable(getattr(policy, "predict", None)):
        raise InvalidValueError(f"policy {name} has no method predict(observation)")
    return policy


def source_of(what: Any) -> bytes:
    """Source text of a module or class; nothing where there is none to read."""
    try:
        return inspect.getsource(what).encode()
    except (OSError, TypeError):
        return b""


POLICY_SUFFIXES = (".safetensors", ".json")
MODELS = "...training.model_policy"  # a package after this one, loaded only where there is a model
OF_MODELS = {("stable_baselines3.common.base_class", "BaseAlgorithm"),
             ("stable_baselines3.common.policies", "BasePolicy")}  # fmt: skip
ARCHIVE = "ArchivePolicy"  # of the same package: a model of Stable-Baselines3 in a file
FORMS = ("FILE.safetensors", "MODULE:ATTRIBUTE", "FILE.onnx", "CONTRACT.yaml")


def load_policy(policy: Any, env: gym.Env) -> Policy:
    """A policy for an environment: by name, file or MODULE:ATTRIBUTE, or an object with `predict`.

    An attribute may be an object with `predict`, or a class or function that makes one without arguments. A
    model of Stable-Baselines3 does here what it did in the environment of its training, hold, residual and
    normalisation included.

    Raises:
        UnknownNameError: no such name; lists the valid ones.
        InvalidValueError: the file cannot be read, the policy was made for other spaces, or can't act; a
            model was trained in an environment that is not like this one, or doesn't say in which.
    """
    policy = acting(policy)
    if (contract := contract_name(policy)) is not None:
        return _load_contender(contract, env, isinstance(policy, Trusted))
    if not isinstance(policy, str):
        return _load_object(policy, env)
    if is_policy_file(policy):
        return _load_file(policy, env)
    if is_attribute(policy):
        return _load_object(acting(import_attribute(policy)[1], policy), env)
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
    if name in NAMES or is_contract(name):
        return load_policy(name, env)
    if name.endswith(".zip"):
        raise InvalidValueError(
            f"policy {name!r} is an archive of Stable-Baselines3, and loading one runs its code: where you "
            "trust it, evaluate, compare, frontier and protocol take --trust; or load it yourself and score "
            "the model, push_recovery.evaluate(policies={'mine': PPO.load(...)})"
        )
    if name.endswith(".py"):
        raise InvalidValueError(f"policy {name!r} is a file of Python: name what acts, MODULE:ATTRIBUTE")
    if name not in policy_names():
        raise UnknownNameError("policy", name, [*policy_names(), *FORMS])
    unwrapped: Any = getattr(env, "unwrapped", env)
    if lacks := [part for part in ("robot", "limits", "preset") if not hasattr(unwrapped, part)]:
        raise InvalidValueError(f"policy {name!r} needs a gait environment; {env} has no {', '.join(lacks)}")
    if acts_on_joints(env):
        episodes = unwrapped.episodes
        if name != "random":
            raise InvalidValueError(
                f"policy {name!r} gives gait actions, but {episodes.name} takes {episodes.action_size} of "
                f"the joints; score it on {DEFAULT_ENV}, and here random, {' or '.join(FORMS)}"
            )
        return two_stage.RandomPolicy(name, episodes.observation_size, episodes.action_size)
    if acts_on_residual(env):
        raise InvalidValueError(
            f"policy {name!r} gives whole actions, but this environment takes residuals; score it on the "
            f"environment below, such as {DEFAULT_ENV}"
        )
    if name == sampling_mpc.NAME:
        return sampling_mpc.SamplingMpcPolicy(env)
    return two_stage.make_policy(name, unwrapped.robot, unwrapped.limits, unwrapped.preset)


def policy_names() -> tuple[str, ...]:
    """Names that `make_policy` knows: analytic ones, sampling MPC, those of packages, those that ship."""
    return (*two_stage.POLICY_NAMES, sampling_mpc.NAME, *PACKAGED, *shipped_names())


def is_policy_file(name: str) -> bool:
    """Whether a policy argument means a file rather than a name."""
    return Path(name).suffix in POLICY_SUFFIXES or is_file(f"{name}.safetensors")


def is_attribute(name: str) -> bool:
    """Whether a policy argument means an attribute of a module."""
    return ":" in name and not is_policy_file(name)


def acts_on_residual(env: Any) -> bool:
    """Whether the actions of an environment are residuals on a policy of its own."""
    layer: Any = env
    while isinstance(layer, gym.Wrapper) and not isinstance(layer, ResidualAction):
        layer = layer.env
    return isinstance(layer, ResidualAction | ResidualVectorEnv)


def acts_on_joints(env: Any) -> bool:
    """Whether the actions of an environment are those of joints instead of a gait."""
    episodes = getattr(getattr(env, "unwrapped", env), "episodes", None)
    return getattr(episodes, "action_size", GAIT_SIZE) != GAIT_SIZE


def _load_object(policy: Any, env: gym.Env) -> Policy:
    """An object with `predict`; models of Stable-Baselines3 by what they were trained in."""
    kinds = {(kind.__module__, kind.__name__) for kind in type(policy).__mro__}
    if not (kinds & OF_MODELS or type(policy).__name__ == ARCHIVE):
        return as_policy(policy)
    return importlib.import_module(MODELS, __package__).model_policy(policy, env)


def _load_contender(name: str, env: gym.Env, trusted: bool) -> Policy:
    """A policy of others, in the environment of its servos."""
    episodes = getattr(env.unwrapped, "episodes", None)
    if not isinstance(episodes, FullBodyEpisodes):
        raise InvalidValueError(
            f"policy {name!r} gives targets of all joints; it acts in the form FullBody of an environment"
        )
    return Contender(read_contract(name), episodes, trusted)


def _load_file(name: str, env: gym.Env) -> NetworkPolicy:
    """A file's policy; refused where whole actions and residuals would be taken for one another.

    A residual's file adds the planner below by itself, so that it acts on the plain environment.
    """
    policy = NetworkPolicy.load(name)
    sizes = (policy.observation_size, policy.action_size)
    spaces = (env.observation_space.shape, env.action_space.shape)
    if ((sizes[0],), (sizes[1],)) != spaces:
        raise InvalidValueError(
            f"policy {name!r} was made for {sizes[0]} observations and {sizes[1]} actions; the environment "
            f"has observation shape {spaces[0]} and action shape {spaces[1]}"
        )
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
    unwrapped: Any = env.unwrapped
    policy.check_made_for(unwrapped.robot, unwrapped.limits)
    return policy
