"""Environments by name, as the command line gives them, and the digests that their results belong to."""

import hashlib
import importlib
import re
import sys
from contextlib import closing
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Self

import gymnasium as gym

from ...controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from ...controllers.model.robot import SAME, Similarity
from ...controllers.policies.learned import read_policy
from ...controllers.settings import VARIANTS, is_preset_file, load_preset
from ...envs.joint.full_body import driven, joint_names
from ...envs.robots.compiled_robot import compiled_robot, robot_digest
from ...envs.robots.description import robot_description
from ...envs.scenario.scenario import EXACT, Profile, Scenario, get_profile
from ..output.rows import read_content
from . import DEFAULT_ENV, NAMESPACE
from .contract_files import contract_name, is_contract, read_contract
from .load_policy import FOLDER, import_from_here, is_policy_file, policy_names, shipped_names, source_of

ROBOT_FILE = ".robot.json"
FULL_BODY = "FullBody"  # in the id of the form whose actions drive all joints
OF_REFERENCE = ("Biped", "Pendulum")  # how ids of the robot of 60 kg begin
ON_JOINTS = re.compile("(JointResidual|Joint)(?=-v)")  # what the id of a form on the joints has besides


def env_ids() -> list[str]:
    """Registered ids of this project."""
    return sorted(name for name in gym.registry if name.startswith(NAMESPACE))


@dataclass(frozen=True)
class EnvName:
    """Name of an environment: ID, MODULE:ID or a robot file, with a preset of its own in ID@PRESET."""

    module: str  # that registers the id; empty for this project's
    id: str
    preset: str  # by name or file; empty: the environment's own
    robot: str = ""  # robot file; empty: the id's own robot

    @classmethod
    def parse(cls, text: str) -> Self:
        """The parts of a name.

        Raises:
            UnknownNameError: an id that is not this project's, and no module is named that registers it.
            InvalidValueError: the module's name is impossible, or no preset follows the @.
        """
        plain = str(text).removeprefix("push_recovery:")
        file, of_file, after = plain.partition(f"{ROBOT_FILE}@")  # folders of a robot file may have an @ too
        if of_file or plain.endswith(ROBOT_FILE):
            name, at, preset = (f"{file}{ROBOT_FILE}", "@", after) if of_file else (plain, "", "")
        else:
            name, at, preset = plain.partition("@")
        module, colon, env_id = name.rpartition(":")
        if at and not preset:
            raise InvalidValueError(f"environment {text!r:.200} names no preset after its @")
        if name.endswith(ROBOT_FILE):
            return cls("", DEFAULT_ENV, preset, name)
        if not colon and name not in env_ids():
            raise UnknownNameError("environment", text, env_ids())
        if colon and not (env_id and all(part.isidentifier() for part in module.split("."))):
            raise InvalidValueError(
                f"environment {text!r:.200} must be one of {', '.join(env_ids())}, MODULE:ID or a robot file "
                f"NAME{ROBOT_FILE}"
            )
        return cls(module, env_id, preset)

    @property
    def runs_code(self) -> bool:
        """Whether to make the environment imports a module that is not loaded yet."""
        return bool(self.module) and self.module not in sys.modules

    @property
    def full_id(self) -> str:
        """Name for gym.make."""
        return f"{self.module}:{self.id}" if self.module else self.id

    @property
    def options(self) -> dict[str, str]:
        """Arguments of gym.make that give the environment a preset and a robot of its own."""
        named = {"preset": self.preset, "robot": self.robot}
        return {option: value for option, value in named.items() if value}

    @property
    def label(self) -> str:
        """The environment's own part, for the name of a directory."""
        return Path(self.robot).name.removesuffix(ROBOT_FILE) or self.id.rpartition("/")[2]


def make_env(env_id: str, **kwargs: Any) -> gym.Env:
    """gym.make of one of this project's ids, or of MODULE:ID; ID@PRESET takes a preset, by name or file.

    Raises:
        UnknownNameError: no such id; lists the valid ones.
        InvalidValueError: the environment cannot be made, or has not the interface that scoring needs.
    """
    name = EnvName.parse(env_id)
    kwargs = {**name.options, **kwargs}
    if name.runs_code:
        import_from_here(name.module)
    try:
        env = gym.make(name.full_id, disable_env_checker=True, **kwargs)
    except (gym.error.Error, ModuleNotFoundError) as error:
        raise InvalidValueError(f"cannot make environment {env_id!r}: {error}") from error
    if lacks := [part for part in ("robot", "limits", "preset") if not hasattr(env.unwrapped, part)]:
        raise InvalidValueError(f"environment {env_id!r} has no {', '.join(lacks)} on env.unwrapped")
    return env


def has_own_robot(env: Any, policy: Any) -> bool:
    """Whether the preset of a biped has a robot for this policy alone, which the environment is not yet."""
    biped = env.unwrapped
    if not (isinstance(policy, str) and policy in VARIANTS and getattr(biped, "variant", policy) != policy):
        return False
    return load_preset(biped.preset).has_own_robot(policy)


def own_form(policy: Any, env_id: str) -> str | None:
    """The form on the joints, of the same robot and pushes, whose actions a policy file gives, if it does."""
    name = EnvName.parse(env_id)
    if name.module or name.robot or not (isinstance(policy, str) and is_policy_file(policy)):
        return None
    form = read_policy(policy)[2].env_id
    if form == name.id or ON_JOINTS.sub("", form) != name.id:
        return None
    return f"{form}@{name.preset}" if name.preset else form


def full_body_form(env_id: str) -> str:
    """The form whose actions drive all joints, of the robot of an environment.

    Raises:
        InvalidValueError: a form on the joints, or no robot with joints.
    """
    name = EnvName.parse(env_id)
    if FULL_BODY in name.id:
        return env_id
    if not name.id.endswith("-v0") or ON_JOINTS.search(name.id) or "Pendulum" in name.id:
        raise InvalidValueError(
            f"a policy of joint targets needs the environment of a robot, as {DEFAULT_ENV}, got {env_id!r}"
        )
    # corrections of a planner act on the same robot
    form = f"{name.module}:".lstrip(":") + re.sub("(Residual)?-v0", f"{FULL_BODY}-v0", name.id)
    return f"{form}@{name.preset}" if name.preset else form


def all_joints(env: Any) -> tuple[str | None, ...]:
    """Names of all joints of the robot of an environment, by which a contract finds its own.

    Raises:
        InvalidValueError: it has no robot with joints.
    """
    if not hasattr(getattr(env.unwrapped, "core", None), "body"):
        raise InvalidValueError(
            f"a policy of joint targets needs the environment of a robot, as {DEFAULT_ENV}"
        )
    return joint_names(compiled_robot(driven(env.unwrapped.core.body.description)))


def contender_env(env: Any, env_id: str, policy: str, **kwargs: Any) -> gym.Env:
    """The environment of a policy with a contract: its robot's, with the contract's servos and rate."""
    found, form = read_contract(policy), full_body_form(env_id)
    kwargs |= {"servos": found.servos(all_joints(env)), "control_hz": found.rate}
    if robot_file := EnvName.parse(env_id).robot:
        kwargs = {"robot": robot_file, **kwargs}
    return make_env(form, **kwargs)


def can_take(env: Any, name: str) -> bool:
    """Whether a policy by name is made for an environment's robot, and the package it comes in is there."""
    ours = env.unwrapped
    if is_contract(name):
        if not hasattr(ours.episodes.core, "body"):
            return False
        try:
            read_contract(name).servos(all_joints(env))
        except PushRecoveryError:
            return False
    if name in shipped_names():
        policy = read_policy(FOLDER / name)[2]
        return (policy.robot, policy.limits) == (ours.robot, ours.limits)
    return True


def policy_names_for(env: Any) -> tuple[str, ...]:
    """`policy_names` without those that an environment's robot can't take."""
    return tuple(name for name in policy_names() if can_take(env, name))


def own_env(env: Any, env_id: str, policy: Any, **kwargs: Any) -> gym.Env | None:
    """An environment with this policy's own robot or actions; None where it acts in that of the id."""
    if (contract := contract_name(policy)) is not None:
        return contender_env(env, env_id, contract, **kwargs)
    if has_own_robot(env, policy):
        return make_env(env_id, variant=policy, **kwargs)
    form = own_form(policy, env_id)
    return None if form is None else make_env(form, **kwargs)


def make_env_for(policy: Any, env_id: str, **kwargs: Any) -> gym.Env:
    """`make_env`, or the `own_env` of a policy where it has one."""
    env = make_env(env_id, **kwargs)
    if (own := own_env(env, env_id, policy, **kwargs)) is None:
        return env
    env.close()
    return own


def preset_digest(env_id: str) -> dict[str, str]:
    """SHA-256 of all that a name of an environment stands for besides this package's code.

    That is of its preset file, its robot (robot file, model and what that includes, preset file; or the
    compiled model of one made in Python) and the module that registers it; nothing of what it has not.

    Raises:
        PushRecoveryError: a file can't be read, or the module can't be imported.
    """
    name, found = EnvName.parse(env_id), {}
    if is_preset_file(name.preset):
        found["preset_sha256"] = hashlib.sha256(read_content(Path(name.preset), "preset file")).hexdigest()
    if name.module:
        found["module_sha256"] = hashlib.sha256(source_of(import_from_here(name.module))).hexdigest()
    if robot := own_robot(name):
        found["robot_sha256"] = robot_digest(robot_description(robot))
    return found


def own_robot(name: EnvName) -> Any:
    """The robot file of a name, or the robot that its id was registered with; None where there is none."""
    spec = gym.registry.get(name.id)  # what is not registered is refused where it is made
    return name.robot or (spec.kwargs.get("robot") if spec else None)


def robot_of(env_id: str) -> tuple[str, Similarity]:
    """Name of an environment's robot, and its size against the one that suites are written for."""
    name = EnvName.parse(env_id)
    if not (name.module or own_robot(name)) and name.label.startswith(OF_REFERENCE):
        return "biped", SAME
    return _robot_of(env_id, *preset_digest(env_id).items())


@lru_cache(maxsize=64)
def _robot_of(env_id: str, *content: tuple[str, str]) -> tuple[str, Similarity]:
    """`robot_of` of files with a content."""
    with closing(make_env(env_id)) as env:
        description = getattr(getattr(env.unwrapped, "episodes", None), "description", None)
        return getattr(description, "name", EnvName.parse(env_id).label), size_of(env)


def size_of(env: Any) -> Similarity:
    """Size of an environment's robot against that of 60 kg."""
    return Similarity.of(env.unwrapped.robot)


def under_profile(env: Any, scenario: Scenario, profile: str) -> Scenario:
    """A scenario under a profile, of the size of an environment's robot; what it says itself stands."""
    return get_profile(profile).scaled(size_of(env)).applied(scenario)


def profile_on(env_id: str, profile: str) -> Profile:
    """A profile by name, of the size of an environment's robot."""
    found = get_profile(profile)
    return found if found == EXACT else found.scaled(robot_of(env_id)[1])


def env_label(env_id: str) -> str:
    """The environment's own part of an id, for the name of a directory."""
    return EnvName.parse(env_id).label


def with_preset(env_id: str, preset: str | None) -> str:
    """The id with the preset of an option; raises InvalidValueError for a preset that does not exist."""
    if preset is None:
        return env_id
    if EnvName.parse(env_id).preset:
        raise InvalidValueError(f"environment {env_id!r} names a preset already; leave out {preset!r}")
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
