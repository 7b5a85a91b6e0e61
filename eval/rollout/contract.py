"""What a policy of others expects of the robot around it: its contract.

A contract says what the network sees (terms in order, scale, history, clock), what its output means (joints,
default pose, scale), and what drives the joints (stiffness, damping, rate). It is that of the package
gaitkeeper, `gaitkeeper.contract`, with where each field came from; `contract_files` reads it.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ...controllers.errors import (
    InvalidValueError,
    MissingExtraError,
    UnknownNameError,
    is_finite_number,
    shown,
)
from ...controllers.files import read_file, write_text
from ...envs.biped.period import substeps
from ...envs.joint.full_body import Servos

EXTRA = "contenders"
REACH = 2.0 * np.pi  # of an action of 1, far enough for a motor's full torque [rad]
GROUP = "policy_io.observation_groups.policy"
TERMS = f"{GROUP}.terms"
NAMES, POSE, RATE = "policy_io.joints.names", "control.default_joint_pos", "timing.policy_dt"
SCALE, OFFSET = "control.actions.joint_pos.scale", "control.actions.joint_pos.offset"
STIFFNESS, DAMPING = "control.actuators.kp", "control.actuators.kd"
EFFORT, LIMITS = "model.effort_limit", "policy_io.commands.base_velocity.limit"
AXES = ("vx", "vy", "wz")  # of a command
ABSENT = "control.absent"  # joints of the contract that the robot may lack: they count as in the default pose
NETWORK = "source.network"
CLIP, UNLISTED = "control.actions.joint_pos.clip", "control.unlisted"
WEIGHTS = re.compile(rb"\n\x08location\x12(.)", re.DOTALL)  # in ONNX, ahead of the name of another file
OF_EACH_JOINT = (POSE, SCALE, OFFSET, STIFFNESS, DAMPING)
NEEDED = (RATE, NAMES, TERMS, *OF_EACH_JOINT)


def gaitkeeper(module: str) -> Any:
    """A module of gaitkeeper.

    Raises:
        MissingExtraError: it is not installed.
    """
    if find_spec("gaitkeeper") is None:
        raise MissingExtraError("gaitkeeper", EXTRA)
    return import_module(f"gaitkeeper.{module}")


@dataclass(frozen=True)
class PolicyContract:
    """A contract, the network that it is for, and what was noticed when it was read."""

    name: str
    contract: Any  # gaitkeeper.contract.Contract
    network: Path
    notes: tuple[str, ...] = field(default=(), compare=False)

    def get(self, path: str, default: Any = None) -> Any:
        """A field by its dotted path."""
        return self.contract.get(path, default)

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints of the network's output, in its order."""
        return tuple(self.get(NAMES))

    @property
    def rate(self) -> float:
        """Decisions a second [Hz]."""
        return 1.0 / float(self.get(RATE))

    def of_joints(self, path: str, joints: Sequence[str]) -> tuple[float, ...]:
        """Numbers of a field for some joints."""
        values = self.get(path)
        return tuple(float(values[name]) for name in joints)

    def present(self, robot: Sequence[str | None]) -> tuple[str, ...]:
        """Joints of the contract that a robot has.

        Raises:
            UnknownNameError: it lacks one that the contract does not let it lack.
            InvalidValueError: it lacks several: the policy is of another robot.
        """
        has, may_lack = set(robot), self.get(ABSENT) or ()
        lacking = [name for name in self.joints if name not in has and name not in may_lack]
        if len(lacking) > 1:
            raise InvalidValueError(
                f"policy {self.name!r} is of another robot: this one lacks {len(lacking)} of the "
                f"{len(self.joints)} joints that it moves, such as {lacking[0]!r} (--env ID, see list)"
            )
        if lacking:
            raise UnknownNameError(
                f"joint of the robot in {NAMES} of policy {self.name!r}", lacking[0], filter(None, robot)
            )
        return tuple(name for name in self.joints if name in has)

    def servos(self, robot: Sequence[str | None]) -> Servos:
        """The drives that the contract asks of a robot with these joints; other joints keep their angle."""
        joints = self.present(robot)
        effort = self.get(EFFORT)
        held = self.get(UNLISTED) or {}
        others = tuple(str(name) for name in held.get("pose", {}) if name in set(robot) - set(joints))
        values = [
            (*self.of_joints(path, joints), *(float(held[key][name]) for name in others))
            for path, key in ((POSE, "pose"), (STIFFNESS, "kp"), (DAMPING, "kd"))
        ]
        torque = None
        if isinstance(effort, Mapping):
            limits = (effort.get(name) for name in (*joints, *others))
            torque = tuple(1e6 if limit is None else min(float(limit), 1e6) for limit in limits)
        posture, stiffness, damping = values
        return Servos((*joints, *others), posture, stiffness, damping, torque, REACH)

    def digest(self) -> str:
        """SHA-256 of what the rows of the policy hang on: contract and all files of the network."""
        return hashlib.sha256(self.contract.dump().encode() + b"\0" + self.content()).hexdigest()

    def content(self) -> bytes:
        """What the network's file holds, and after it the files that it needs beside it.

        Those are the networks of a contract that switches between two, and the weights that an ONNX file
        keeps in a file of their own and names by its place.
        """
        content, several = read_file(self.network), self.get("policy_io.graph.switch") or {}
        named = {Path(str(several[key])).name for key in ("above", "below") if key in several}
        for entry in WEIGHTS.finditer(content):
            named.add(content[entry.end() : entry.end() + entry[1][0]].decode(errors="replace"))
        beside = (self.network.parent / name for name in sorted(named) if name.isprintable())
        more = (file for file in beside if file.is_file() and file.name != self.network.name)
        return b"\0".join([content, *map(read_file, more)])

    def network_sha256(self) -> str:
        """SHA-256 by which CONTRACT.yaml names its network."""
        return hashlib.sha256(self.content()).hexdigest()

    def write(self, path: Path) -> None:
        """Write the contract as CONTRACT.yaml; it names its network by a path from there, and by its hash."""
        kept = self.contract.copy()
        network = self.network.resolve()
        where = path.resolve().parent
        inside = network.relative_to(where) if network.is_relative_to(where) else network
        kept.set(NETWORK, {"path": str(inside), "sha256": self.network_sha256()}, "file", "policy inspect")
        write_text(path, kept.dump())


def term_field(term: Mapping[str, Any]) -> str:
    """The path of a term of the observation, by its name in its group."""
    return f"{TERMS}.{gaitkeeper('terms').term_key(term)}"


def fields_of(contract: PolicyContract) -> list[tuple[str, str, Any]]:
    """(path, value as text, provenance) of every field of a contract that is known."""
    found: list[tuple[str, str, Any]] = []

    def visit(path: str, value: Any) -> None:
        inner = isinstance(value, dict) and value and not set(contract.joints) & value.keys()
        if inner:
            for key, part in value.items():
                visit(f"{path}.{key}" if path else key, part)
        elif path.endswith(".terms"):
            for term in value:
                scale = np.unique(term["scale"])
                text = f"{term['dim']} numbers, scale {', '.join(f'{one:g}' for one in scale)}"
                name = gaitkeeper("terms").term_key(term)
                found.append((f"{path}.{name}", text, contract.contract.prov(f"{path}.{term['id']}")))
        elif value is not None:
            text = (
                ", ".join(f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}" for k, v in value.items())
                if isinstance(value, dict)
                else str(value)
            )
            found.append((path, text, contract.contract.prov(path)))

    for section, content in contract.contract.data.items():
        visit(section, content)
    return found


def _is_range(value: Any) -> bool:
    """Whether a value is a pair low <= high; an end may be infinite."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        return False
    ends = all(is_finite_number(one) or one in (-math.inf, math.inf) for one in value)
    return ends and value[0] <= value[1]


def _at_rest(contract: Any, term: Mapping[str, Any]) -> Any:
    """The numbers of one term of a robot that stands still and upright with all joints at 0."""
    alone = contract.copy()
    alone.set(GROUP, {**contract.get(GROUP), "terms": [term], "history": {}})
    builder, actions = gaitkeeper("terms").ObservationBuilder(alone), np.zeros(len(contract.get(NAMES)))
    names = [*contract.get(NAMES), *builder.extra_joints]
    angles = np.zeros(len(names))
    upright, still = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    return builder.step(upright, still, angles, angles, names, still, 0, actions, still)


def check_contract(found: PolicyContract) -> None:
    """Raise InvalidValueError with the field that is missing, contradicts another or does not fit."""
    contract, name = found.contract, found.name

    def refuse(path: str, why: str) -> NoReturn:
        raise InvalidValueError(
            f"{path} of policy {name!r} {why}; push-recovery policy inspect FILE --set {path}=VALUE --out "
            "CONTRACT.yaml gives it"
        )

    for path in NEEDED:
        if contract.get(path, None) is None:
            detail = contract.prov(path).detail
            refuse(path, f"is missing ({detail})" if detail else "is missing")
    for path, origin in contract.provenance.items():
        if origin.source == "conflicting" and contract.prov(path).source == "conflicting":
            refuse(path, f"is contradictory: {origin.detail}")
    for path in (NAMES, ABSENT):
        names = [] if contract.get(path, None) is None else contract.get(path)
        if not (isinstance(names, list) and all(isinstance(joint, str) for joint in names)):
            refuse(path, f"must be a list of names, not {shown(names)}")
    joints = contract.get(NAMES)
    if twice := [joint for joint in joints if joints.count(joint) > 1]:
        refuse(NAMES, f"names {twice[0]} twice")
    if not (is_finite_number(contract.get(RATE)) and contract.get(RATE) > 0.0):
        refuse(RATE, f"must be a time in seconds, not {shown(contract.get(RATE))}")
    for path in (EFFORT, LIMITS, UNLISTED):
        if not isinstance(contract.get(path, None), Mapping | None):
            refuse(path, f"must have fields, not {shown(contract.get(path))}")
    unlisted = list(contract.get(f"{UNLISTED}.pose", {}))
    held = [(f"{UNLISTED}.{key}", unlisted) for key in ("pose", "kp", "kd") if unlisted]
    for path, names in (*((path, joints) for path in OF_EACH_JOINT), *held):
        values = contract.get(path, None)
        lacks = [joint for joint in names if joint not in values] if isinstance(values, Mapping) else names
        if lacks:
            refuse(path, f"has no number for {', '.join(sorted(lacks)[:3])}")
        bound, least = (" >= 0", 0.0) if path.endswith((".kp", ".kd")) else ("", -math.inf)
        for joint in names:
            if not (is_finite_number(values[joint]) and values[joint] >= least):
                refuse(path, f"has no number{bound} for {joint}, but {shown(values[joint])}")
    effort = contract.get(EFFORT, None) or {}
    strange = sorted(map(str, effort.keys() - {*joints, *unlisted}))
    if strange and (without := [joint for joint in joints if joint not in effort]):
        refuse(EFFORT, f"has {strange[0]!r}, which is no joint of the policy, and none for {without[0]}")
    for joint, value in effort.items():
        if not (value is None or _is_range((0.0, value))):
            refuse(EFFORT, f"has no number >= 0 for {joint}, but {shown(value)}")
    for axis, value in (contract.get(LIMITS, None) or {}).items():
        if axis not in AXES:
            refuse(LIMITS, f"has {shown(axis)}, which is none of {', '.join(AXES)}")
        if not _is_range(value):
            refuse(LIMITS, f"has no [low, high] for {axis}, but {shown(value)}")
    clip = contract.get(CLIP, None)
    each = isinstance(clip, list) and len(clip) == len(joints) and all(map(_is_range, clip))
    if clip not in (None, []) and not (each or _is_range(clip)):
        refuse(CLIP, f"must be [low, high], or a list of one for each joint, not {shown(clip)}")
    try:
        substeps(found.rate)
    except InvalidValueError as error:
        refuse(RATE, f"is {contract.get(RATE):g} s: {error}")
    group = contract.get(GROUP)
    known = gaitkeeper("terms").TERMS
    if unknown := [term["id"] for term in group["terms"] if term.get("id") not in known]:
        refuse(TERMS, f"has a term that is not known, {unknown[0]!r}")
    for term in group["terms"]:
        field, size = term_field(term), int(term["dim"])
        try:
            seen = np.size(_at_rest(contract, term))
        except KeyError as error:
            missing = str(error.args[0])
            if missing.isidentifier():
                refuse(f"{field}.params.{missing}", "is missing")
            refuse(field, f"cannot be worked out: {missing}")
        except Exception as error:  # of whatever kind a wrong value raises
            refuse(field, f"cannot be worked out: {error}")
        if seen != size:
            refuse(TERMS, f"says that {term['id']} has {size} numbers, and it has {seen}")
    if found.network.suffix == ".onnx":
        network = gaitkeeper("policy").load_policy(contract, found.network)
        size = int(group.get("history", {}).get("length", 1)) * sum(
            int(term["dim"]) for term in group["terms"]
        )
        if not group.get("history", {}).get("chunks") and network.n_in != size:
            refuse(TERMS, f"has {size} numbers, the network takes {network.n_in}")
        if network.n_out != len(joints):
            refuse(NAMES, f"has {len(joints)} joints, the network gives {network.n_out} numbers")
        parts = getattr(network, "models", {"": network}).values()  # of one that switches between several
        if not all(np.isfinite(part.step(np.ones(part.n_in))).all() for part in parts):
            raise InvalidValueError(
                f"the network {str(found.network)!r} of policy {name!r} answers an observation of ones with "
                "numbers that are not finite: its weights are damaged"
            )
