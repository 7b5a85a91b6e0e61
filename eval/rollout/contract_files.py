"""The files that contracts of policies of others come in, and policies that packages carry.

| file | who writes it |
|---|---|
| FILE.onnx with `joint_names` in its metadata, a deploy.yaml beside it | mjlab |
| deploy.yaml, its network beside it or in ../exported | unitree_rl_lab, unitree_rl_mjlab |
| NAME.yaml with `kps`, the network that it names beside it | unitree_rl_gym (legged_gym) |
| FILE.onnx with `dof_names` in its metadata, for a G1 or a T1 | Holosoma |
| CONTRACT.yaml | `push-recovery policy inspect FILE --out CONTRACT.yaml` |

Nothing that these files say is run but the network.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeGuard

from ...controllers.errors import InvalidValueError, PushRecoveryError, is_finite_number, shown
from ...controllers.files import read_file
from .contract import (
    ABSENT,
    DAMPING,
    GROUP,
    LIMITS,
    NAMES,
    NETWORK,
    OFFSET,
    POSE,
    RATE,
    SCALE,
    STIFFNESS,
    TERMS,
    PolicyContract,
    check_contract,
    gaitkeeper,
    term_field,
)  # fmt: skip

NETWORKS = (".onnx", ".pt", ".jit")  # of ONNX and TorchScript
SUFFIXES = (*NETWORKS, ".yaml", ".yml")
FIXED = ("schema", NETWORK)  # fields that the file alone has
G1_MOTORS = 29


def is_contract(name: object) -> TypeGuard[str]:
    """Whether a policy argument means a contract or the network of one."""
    return isinstance(name, str) and (name in PACKAGED or Path(name).suffix in SUFFIXES)


@dataclass(frozen=True)
class Trusted:
    """A contract whose network may run code of its own, as TorchScript does; what `--trust` makes."""

    name: str

    def predict(self, observation: Any) -> Any:
        """Refuse: a contract acts in the environment of its servos alone."""
        raise InvalidValueError(f"policy {self.name!r} acts in the environment of its contract alone")


def trusted(name: str) -> Any:
    """A policy by name, under its label as `Trusted` where it means a contract."""
    return {name: Trusted(name)} if is_contract(name) else name


def contract_name(policy: object) -> str | None:
    """Name of the contract that a policy means; None for one of another kind."""
    if isinstance(policy, Trusted):
        return policy.name
    return policy if is_contract(policy) else None


@dataclass(frozen=True)
class Packaged:
    """A policy that a package on the package index carries."""

    package: str
    module: str
    path: str  # in the module's folder
    install: str  # the line that installs it


_HOLOSOMA = "pip install --no-deps holosoma-inference"
PACKAGED: Mapping[str, Packaged] = {
    f"holosoma-{robot}-{learner}": Packaged(
        "holosoma-inference", "holosoma_inference",
        f"models/loco/{robot}_29dof/{learner}_{robot}_29dof.onnx", _HOLOSOMA,
    )
    for robot in ("g1", "t1") for learner in ("ppo", "fastsac")
}  # fmt: skip


def contract_file(name: str) -> Path:
    """The file of a contract: the path itself, or that of a packaged policy.

    Raises:
        InvalidValueError: no such file, or the package of a policy is not installed.
    """
    path = Path(name)
    if name in PACKAGED:
        known = PACKAGED[name]
        spec = find_spec(known.module)
        if spec is None or not spec.submodule_search_locations:
            raise InvalidValueError(
                f"policy {name!r} comes with {known.package}, which is not installed; install it with: "
                f"{known.install}"
            )
        path = Path(spec.submodule_search_locations[0]) / known.path
    if not path.is_file():
        raise InvalidValueError(f"there is no file {str(path)!r} of policy {name!r}")
    return path


def read_contract(name: str, changes: Mapping[str, Any] | None = None) -> PolicyContract:
    """The contract of a file or a packaged policy, checked against its network.

    Args:
        name: path of a file, or a name of PACKAGED.
        changes: fields by their dotted paths, above what the files say.

    Raises:
        MissingExtraError: gaitkeeper is not installed.
        InvalidValueError: a policy's package is not installed; a file that cannot be read; a field that is
            missing, contradicts another or does not fit the network, by its name.
    """
    path = contract_file(name)
    try:
        contract, network, notes = _read(path)
    except PushRecoveryError:
        raise
    except Exception as error:  # of whatever kind the readers of YAML and ONNX raise
        plain = {KeyError: f"it lacks {error}", IndexError: "a list in its files has too few entries"}
        why = plain.get(type(error), error)
        raise InvalidValueError(f"cannot read the contract of policy {name!r}: {why}") from error
    for key, value in (changes or {}).items():
        if any(f"{fixed}.".startswith(f"{key}.") or key.startswith(f"{fixed}.") for fixed in FIXED):
            raise InvalidValueError(
                f"{key!r} of policy {name!r} is what its files say and takes no other value"
            )
        try:
            if key.startswith(f"{TERMS}."):
                _set_in_term(contract, *key.removeprefix(f"{TERMS}.").split(".", 1), value=value)
            else:
                contract.set(key, value, "user", "--set")
        except KeyError as error:
            raise InvalidValueError(f"{key!r} is no field of a contract: {error}") from error
        except (AttributeError, TypeError) as error:
            raise InvalidValueError(f"{key!r} is no field of a contract: above it stands a value") from error
    found = PolicyContract(name, contract, network, notes)
    try:
        check_contract(found)
    except PushRecoveryError:
        raise
    except Exception as error:  # of whatever kind a value, or the network that it does not fit, raises
        raise InvalidValueError(
            f"a field of the contract of policy {name!r} has a value of the wrong kind: {error}"
        ) from error
    return found


def _set_in_term(contract: Any, name: str, key: str = "", *, value: Any) -> None:
    """Set scale, clip or a parameter (`params.NAME`) of a term, named as `fields_of` has it.

    Raises:
        KeyError: no such term, or nothing of it that may be set.
        InvalidValueError: a scale that is neither a number nor one for each of its numbers.
    """
    terms = contract.get(TERMS)
    term = next((term for term in terms if term_field(term) == f"{TERMS}.{name}"), None)
    kind, _, parameter = key.partition(".")
    if term is None:
        raise KeyError(f"{TERMS}.{name}")
    if kind == "params" and parameter:
        term.setdefault("params", {})[parameter] = value
    elif key == "clip":
        term["clip"] = value
    elif key == "scale":
        scale = value if isinstance(value, list) else [value] * int(term["dim"])
        if len(scale) != int(term["dim"]) or not all(map(is_finite_number, scale)):
            raise InvalidValueError(
                f"{TERMS}.{name}.scale must be a number, or one for each of {term['dim']}, not {shown(value)}"
            )
        term["scale"] = scale
    else:
        raise KeyError(f"{TERMS}.{name}.{key}")
    contract.set(TERMS, terms, "user", f"--set {name}.{key}")


def changes_of(words: Sequence[str]) -> dict[str, Any]:
    """Fields and values of words FIELD=VALUE, the values as YAML.

    Raises:
        InvalidValueError: a word without a field or a value.
    """
    import yaml

    found = {}
    for word in words:
        path, equals, text = word.partition("=")
        if not (path and equals and text):
            raise InvalidValueError(f"--set takes FIELD=VALUE, got {word!r}")
        try:
            found[path] = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise InvalidValueError(f"the value of {word!r} is no YAML: {error}") from error
    return found


def _sha256(path: Path) -> str:
    return hashlib.sha256(read_file(path)).hexdigest()


def _read(path: Path) -> tuple[Any, Path, tuple[str, ...]]:
    """Contract, network and notes of a file, by what the file says that it is."""
    if path.suffix in NETWORKS:
        return _of_network(path)
    content = _fields(path)
    if "schema" in content:
        return _of_contract(path, content)
    if "joint_ids_map" in content:
        network = _beside(path, "", "../exported")
        graph = network if network.suffix == ".onnx" else None
        contract, findings = gaitkeeper("readers.unitree_deploy").read_unitree_deploy(path, graph)
        notes = _noticed(contract, findings)
        if (motors := len(content["stiffness"])) < G1_MOTORS:
            notes += (f"it lists {motors} motors and is read as a G1's, which has {G1_MOTORS}",)
        return contract, network, notes
    if "kps" in content:
        network = _beside(path, Path(str(content.get("policy_path", ""))).name)
        scene = str(content.get("xml_path", ""))
        if scene and "g1" not in scene.lower():
            raise InvalidValueError(
                f"{str(path)!r} is for the robot of xml_path {scene!r}; of unitree_rl_gym those of a G1 are "
                "read, for others write a CONTRACT.yaml"
            )
        contract, findings = gaitkeeper("readers.rl_gym_deploy").read_rl_gym_deploy(path, network)
        notes = _noticed(contract, findings)
        return contract, network, notes if scene else (*notes, "it names no xml_path and is read as a G1's")
    raise InvalidValueError(
        f"{str(path)!r} is no contract that is known: it has neither 'schema' (policy inspect --out), nor "
        "'joint_ids_map' (deploy.yaml of unitree_rl_lab), nor 'kps' (configuration of unitree_rl_gym)"
    )


def _fields(path: Path) -> dict[str, Any]:
    """The fields of a file of YAML."""
    import yaml

    content = yaml.safe_load(read_file(path))
    if not isinstance(content, dict):
        raise InvalidValueError(f"{str(path)!r} is no contract: it holds no fields")
    if isinstance(step := content.get("step_dt"), bool):
        raise InvalidValueError(f"step_dt of {str(path)!r} must be a time in seconds, got {step}")
    return content


def _noticed(contract: Any, findings: Sequence[Any]) -> tuple[str, ...]:
    """What a reader has noticed, in words; where two files disagree, the contract has it, too."""
    for finding in findings:
        conflicting = getattr(finding, "kind", None) == "conflicting"
        if conflicting and contract.prov(finding.path).source != "conflicting":
            contract.set(finding.path, contract.get(finding.path), "conflicting", finding.message)
    return tuple(getattr(finding, "message", finding) for finding in findings)


def _beside(path: Path, name: str, *folders: str) -> Path:
    """The network that lies beside a file: by name, or the only one there is."""
    places = [path.parent, *(path.parent / folder for folder in folders)]
    there = [file for place in places if place.is_dir() for file in sorted(place.iterdir())
             if (file.name == name if name else file.suffix in NETWORKS)]  # fmt: skip
    if len(there) != 1 and not name:  # exporters write the same network in both forms
        there = [file for file in there if file.suffix == ".onnx"] or there
    if len(there) != 1:
        what = f"{name!r}, which it names," if name else "one network (" + ", ".join(NETWORKS) + ")"
        found = ", ".join(file.name for file in there) or "none"
        raise InvalidValueError(f"{what} must lie beside {str(path)!r}, found {found}")
    return there[0]


def _of_contract(path: Path, content: dict[str, Any]) -> tuple[Any, Path, tuple[str, ...]]:
    contract = gaitkeeper("contract").Contract.from_dict(content)
    source = contract.get(NETWORK, None)
    if not isinstance(source, dict) or not {"path", "sha256"} <= source.keys():
        raise InvalidValueError(f"{NETWORK} of {str(path)!r} is missing: a path and a sha256")
    network = path.parent / source["path"]
    if not network.is_file():
        raise InvalidValueError(f"there is no network {str(network)!r}, which {NETWORK} names")
    if PolicyContract(str(path), contract, network).network_sha256() != source["sha256"]:
        raise InvalidValueError(
            f"{NETWORK}.sha256 of {str(path)!r} is that of another file than {str(network)!r}"
        )
    return contract, network, ()


def _of_network(path: Path) -> tuple[Any, Path, tuple[str, ...]]:
    """The contract that an ONNX file's metadata and the files beside it make."""
    if path.suffix != ".onnx":
        raise InvalidValueError(
            f"{str(path)!r} is a TorchScript file, which says nothing of its contract: name the YAML that "
            "came with it, or a CONTRACT.yaml"
        )
    metadata = gaitkeeper("policy").OnnxPolicy(path).sess.get_modelmeta().custom_metadata_map
    if "joint_names" in metadata:
        places = (path.parent / "deploy.yaml", path.parent / "../params/deploy.yaml")
        deploy = next((place for place in places if place.is_file()), None)
        if deploy is not None:
            _fields(deploy)  # raises where it has none
        contract, findings = gaitkeeper("readers.mjlab_export").read_mjlab_export(path, deploy)
        return contract, path, _noticed(contract, findings)
    if "dof_names" in metadata:
        return _holosoma(path, metadata), path, ()
    raise InvalidValueError(
        f"the metadata of {str(path)!r} say nothing of its contract: they have neither 'joint_names' (mjlab) "
        f"nor 'dof_names' (Holosoma), but {', '.join(sorted(metadata)) or 'nothing'}; name the deploy.yaml "
        "that came with it, or a CONTRACT.yaml"
    )


# What Holosoma's ONNX files leave out
_HOLOSOMA_SOURCE = "holosoma-inference 0.1.3, config_values and policies/locomotion.py"
_LEG = {"g1": (-0.312, 0.0, 0.0, 0.669, -0.363, 0.0), "t1": (-0.2, 0.0, 0.0, 0.4, -0.25, 0.0)}
_HOLOSOMA_POSES = {
    "g1": (*_LEG["g1"], *_LEG["g1"], 0.0, 0.0, 0.0, 0.2, 0.2, 0.0, 0.6, 0.0, 0.0, 0.0, 0.2, -0.2, 0.0, 0.6,
           0.0, 0.0, 0.0),
    "t1": (0.0, 0.0, 0.2, -1.35, 0.0, -0.5, 0.0, 0.0, 0.0, 0.2, 1.35, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0,
           *_LEG["t1"], *_LEG["t1"]),
}  # fmt: skip
_HOLOSOMA_SCALES = {  # of angular velocity and joint rates
    "g1": {"base_ang_vel": 0.25, "dof_vel": 0.05},
    "t1": {"base_ang_vel": 1.0, "dof_vel": 0.1},
}
_HOLOSOMA_CLOCK = {
    "period": 1.0, "offset": 0.5, "clock_offset_steps": 1,
    "stand": {"mode": "hold", "eps_planar": 0.01, "eps_yaw": 0.01, "hold": [0.5, 0.5], "resume": [0.0, 0.5]},
}  # fmt: skip
_HOLOSOMA_RATE, _HOLOSOMA_ACTION = 50.0, 0.25
_T1_HANDS = tuple(f"{side}_{part}" for side in ("Left", "Right")
                  for part in ("Wrist_Pitch", "Wrist_Yaw", "Hand_Roll"))  # fmt: skip


def _holosoma(path: Path, metadata: Mapping[str, str]) -> Any:
    """The contract of a Holosoma walker: terms sorted by name, joints and gains of its metadata."""
    joints = json.loads(metadata["dof_names"])
    robot = "g1" if "waist_yaw_joint" in joints else "t1" if "AAHead_yaw" in joints else ""
    if not robot or len(joints) != len(_HOLOSOMA_POSES[robot]):
        raise InvalidValueError(
            f"'dof_names' of {str(path)!r} are those of no robot of Holosoma that is known"
        )
    contract_of = gaitkeeper("contract")
    c, count, scales = contract_of.Contract(), len(joints), _HOLOSOMA_SCALES[robot]

    def term(name: str, kind: str, size: int, scale: float = 1.0, **params: Any) -> dict[str, Any]:
        return {"id": kind, "source_name": name, "dim": size, "scale": [scale] * size, "clip": None,
                "params": params}  # fmt: skip

    terms = [
        term("actions", "last_action", count, reset="zeros"),
        term("base_ang_vel", "base_ang_vel", 3, scales["base_ang_vel"]),
        term("command_ang_vel", "velocity_commands", 1, index=[2]),
        term("command_lin_vel", "velocity_commands", 2, index=[0, 1]),
        term("cos_phase", "gait_phase_legs", 2, index=[2, 3], **_HOLOSOMA_CLOCK),
        term("dof_pos", "joint_pos_rel", count),
        term("dof_vel", "joint_vel_rel", count, scales["dof_vel"]),
        term("projected_gravity", "projected_gravity", 3),
        term("sin_phase", "gait_phase_legs", 2, index=[0, 1], **_HOLOSOMA_CLOCK),
    ]
    pose = dict(zip(joints, _HOLOSOMA_POSES[robot], strict=True))
    ranges = json.loads(metadata.get("command_ranges", "{}"))
    limit = {to: ranges[of] for to, of in (("vx", "lin_vel_x"), ("vy", "lin_vel_y"), ("wz", "ang_vel_yaw"))
             if of in ranges}  # fmt: skip
    stated, own = ("preset", _HOLOSOMA_SOURCE), ("file", "ONNX metadata")
    c.set("source", {"format": "holosoma_onnx", "robot": robot,
                     "files": [{"path": path.name, "sha256": _sha256(path)}]}, "file")  # fmt: skip
    c.set(RATE, 1.0 / _HOLOSOMA_RATE, *stated)
    c.set(NAMES, joints, own[0], "ONNX metadata dof_names")
    c.set(GROUP, {"terms": terms, "clip_then_scale": True,
                  "history": {"length": 1, "layout": "term_major", "order": "oldest_first",
                              "init": "repeat_first"}}, *stated)  # fmt: skip
    c.set(LIMITS, limit or None, own[0], "ONNX metadata command_ranges")
    c.set(POSE, pose, *stated)
    c.set(OFFSET, pose, *stated)
    c.set(SCALE, dict.fromkeys(joints, _HOLOSOMA_ACTION), *stated)
    for key, path_ in (("kp", STIFFNESS), ("kd", DAMPING)):
        c.set(
            path_, dict(zip(joints, json.loads(metadata[key]), strict=True)), own[0], f"ONNX metadata {key}"
        )
    if robot == "t1":
        c.set(ABSENT, list(_T1_HANDS), "user", "wrists and hands, which T1 of 23 joints lacks")
    return c
