"""Learned policies on disk: NAME.safetensors holds the weights, NAME.json says what they are.

Neither can run code. The JSON carries the SHA-256 of the weights, so that two halves of different policies
are never taken for one.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import InvalidValueError
from ..files import read_file, write_atomically
from ..json_text import parse_json
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from .description import PolicyDescription, ResidualBase
from .inputs import OBSERVATION, input_size
from .mlp import Mlp, Normalisation

FORMAT = "push-recovery policy"
FORMAT_VERSION = 3
# What the files of earlier versions mean by keys that they lack
EARLIER = {1: {"inputs": [OBSERVATION], "output": "linear"}, 2: {"output": "linear"}, FORMAT_VERSION: {}}
KEYS = ("activation", "action_size", "env_id", "format", "format_version", "hidden_sizes", "hold", "inputs",
        "limits", "observation_clip", "observation_epsilon", "observation_mean", "observation_size",
        "observation_variance", "output", "residual", "robot", "training", "weights_sha256")  # fmt: skip

T = TypeVar("T")


def policy_paths(path: str | Path) -> tuple[Path, Path]:
    """The weights' and the description's path of a policy named by either or by their common stem."""
    path = Path(path)
    stem = path.with_suffix("") if path.suffix in {".safetensors", ".json"} else path
    return stem.with_name(stem.name + ".safetensors"), stem.with_name(stem.name + ".json")


def write_policy(
    network: Mlp,
    normalisation: Normalisation,
    about: PolicyDescription,
    path: str | Path,
    training: dict[str, Any] | None = None,
) -> Path:
    """Write a policy; returns the path of its weights.

    Args:
        network: Normalised observation -> action mean.
        normalisation: Of the observation.
        about: What the policy was made for.
        path: Either file of the pair, or their common stem.
        training: How it came about (steps, seed, ...), kept as a note.
    """
    from safetensors.numpy import save

    weights_path, description_path = policy_paths(path)
    tensors = {f"layers.{i}.weight": np.ascontiguousarray(w) for i, w in enumerate(network.weights)}
    tensors |= {f"layers.{i}.bias": np.ascontiguousarray(b) for i, b in enumerate(network.biases)}
    weights = save(tensors)
    description = _description(network, normalisation, about)
    description |= {"weights_sha256": hashlib.sha256(weights).hexdigest(), "training": training or {}}
    text = json.dumps(description, indent=1, allow_nan=False).encode() + b"\n"
    write_atomically(weights_path, weights)
    write_atomically(description_path, text)
    return weights_path


def _description(network: Mlp, normalisation: Normalisation, about: PolicyDescription) -> dict[str, Any]:
    """What the file beside the weights says of them, all but their digest and how they came about."""
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "env_id": about.env_id,
        "inputs": list(about.inputs),
        "observation_size": network.sizes[0] - input_size(about.inputs, 0),
        "action_size": network.sizes[-1],
        "hidden_sizes": list(network.sizes[1:-1]),
        "activation": network.activation,
        "output": network.output,
        "observation_mean": normalisation.mean.tolist(),
        "observation_variance": normalisation.variance.tolist(),
        "observation_clip": normalisation.clip,
        "observation_epsilon": normalisation.epsilon,
        "hold": about.hold,
        "residual": None if about.residual is None else asdict(about.residual),
        "robot": asdict(about.robot),
        "limits": asdict(about.limits),
    }


def read_policy(path: str | Path) -> tuple[Mlp, Normalisation, PolicyDescription]:
    """Read what `write_policy` wrote.

    Args:
        path: Either file of the pair, or their common stem.

    Raises:
        InvalidValueError: A file is missing, damaged, of another version, or the two do not belong together.
    """
    weights_path, description_path = policy_paths(path)
    about = _read_description(description_path)
    network = _read_network(weights_path, about)
    try:
        normalisation = Normalisation(
            np.asarray(about["observation_mean"], dtype=np.float64),
            np.asarray(about["observation_variance"], dtype=np.float64),
            float(about["observation_clip"]),
            float(about["observation_epsilon"]),
        )
        residual = about["residual"]
        description = PolicyDescription(
            env_id=about["env_id"],
            robot=_record(RobotModel, about["robot"], "robot"),
            limits=_record(GaitLimits, about["limits"], "limits"),
            residual=None if residual is None else _residual(residual),
            hold=about["hold"],
            inputs=tuple(about["inputs"]),
        )
    except (InvalidValueError, TypeError, ValueError) as error:
        raise InvalidValueError(f"policy description {description_path}: {error}") from error
    return network, normalisation, description


def _read_description(path: Path) -> dict[str, Any]:
    try:
        text = read_file(path)
    except OSError as error:
        raise InvalidValueError(f"can't read the policy description {path}: {error.strerror}") from error
    about = parse_json(f"the policy description {path}", text)
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        raise InvalidValueError(f"{path} is not a policy description (its format must be {FORMAT!r})")
    version = about.get("format_version")
    if version not in tuple(EARLIER):
        raise InvalidValueError(
            f"{path} has format version {version!r}, this version reads {', '.join(map(str, EARLIER))}"
        )
    about |= EARLIER[version]
    missing = [key for key in KEYS if key not in about]
    if missing:
        raise InvalidValueError(f"the policy description {path} lacks {', '.join(missing)}")
    return about


def _read_network(path: Path, about: dict[str, Any]) -> Mlp:
    """The network, its shapes as the description states them."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        content = read_file(path)
    except OSError as error:
        raise InvalidValueError(f"can't read the policy weights {path}: {error.strerror}") from error
    if hashlib.sha256(content).hexdigest() != about["weights_sha256"]:
        raise InvalidValueError(
            f"the weights {path} are not those of their JSON (SHA-256 differs): copy both anew"
        )
    try:
        tensors = load(content)
        inputs = about["observation_size"] + input_size(about["inputs"], 0)
        sizes = [inputs, *about["hidden_sizes"], about["action_size"]]
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(f"the policy weights {path} are damaged: {error}") from error
    if not all(isinstance(size, int) and not isinstance(size, bool) and size > 0 for size in sizes):
        raise InvalidValueError(f"the sizes of a policy must be whole numbers > 0, got {sizes}")
    expected: dict[str, tuple[int, ...]] = {}
    for i, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        expected |= {f"layers.{i}.weight": (outputs, inputs), f"layers.{i}.bias": (outputs,)}
    found = {name: tensor.shape for name, tensor in tensors.items()}
    if found != expected or any(tensor.dtype != np.float32 for tensor in tensors.values()):
        raise InvalidValueError(f"the policy weights {path} must be float32 {expected}, got {found}")
    layers = range(len(sizes) - 1)
    try:
        return Mlp(
            tuple(tensors[f"layers.{i}.weight"] for i in layers),
            tuple(tensors[f"layers.{i}.bias"] for i in layers),
            about["activation"],
            about["output"],
        )
    except ValueError as error:
        raise InvalidValueError(f"the policy weights {path}: {error}") from error


def _residual(values: Any) -> ResidualBase:
    residual = _record(ResidualBase, values, "residual")
    if residual.config is None:
        return residual
    return replace(residual, config=_record(PlannerConfig, residual.config, "planner config"))


def _record(kind: type[T], values: Any, name: str) -> T:
    """A frozen dataclass from a JSON object with exactly its fields."""
    names = {field.name for field in fields(kind)}  # pyright: ignore[reportArgumentType]
    if not isinstance(values, dict) or set(values) != names:
        raise InvalidValueError(
            f"{name} must be an object with the keys {', '.join(sorted(names))}, got {values!r}"
        )
    return kind(**values)
