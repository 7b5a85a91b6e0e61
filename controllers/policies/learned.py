"""Learned policies run by numpy, a network alone or its residual on a planner, and their files.

NAME.safetensors holds the weights, NAME.json the description. Neither can run code. The JSON carries the
SHA-256 of the weights, so that two halves of different policies are never taken for one.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..files import read_file, write_atomically
from ..model.gait_box import GAIT_SIZE, GaitLimits
from ..model.observation import as_doubles
from ..model.robot import RobotModel
from ..settings import PlannerConfig
from ..validation import (
    differences,
    keep_python_numbers,
    parse_json,
    require_integer,
    require_kind,
    require_number,
)
from .interface import Policy
from .mlp import OBSERVATION, Mlp, NetworkInputs, Normalisation, check_inputs, input_size
from .residual import Below, ResidualRule, check_gate, check_residual_scale
from .two_stage import TwoStagePolicy, make_policy

LONGEST_HOLD = 10_000  # of a learned action [planning periods]


@dataclass(frozen=True)
class ResidualBase:
    """The policy that a residual corrects, and how much."""

    policy: str  # name for make_policy
    preset: str  # planner preset
    scale: tuple[float, ...]  # (7,) in action units
    config: PlannerConfig | None = None  # the planner's weights in training, whatever the preset says today
    gate: tuple[float, float] | None = None  # (shut, open) of `ResidualGate` [m]; None: always open

    def __post_init__(self) -> None:
        if not (isinstance(self.policy, str) and isinstance(self.preset, str)):
            raise InvalidValueError(
                f"a residual's policy and preset must be names, got {self.policy!r}, {self.preset!r}"
            )
        object.__setattr__(self, "scale", tuple(check_residual_scale(self.scale).tolist()))
        object.__setattr__(self, "gate", None if self.gate is None else check_gate(self.gate))

    def make(self, robot: RobotModel, limits: GaitLimits) -> Policy:
        """The policy below, with the weights that it had in training."""
        policy = make_policy(self.policy, robot, limits, self.preset)
        if self.config is None or not isinstance(policy, TwoStagePolicy):
            return policy
        return TwoStagePolicy(robot, limits, self.config, adapt=self.policy != "passive", name=self.policy)


@dataclass(frozen=True)
class PolicyDescription:
    """The robot and the environment that a policy was made for; stored beside its weights."""

    env_id: str
    robot: RobotModel
    limits: GaitLimits
    residual: ResidualBase | None = None  # None: the network's output is the action
    hold: int = 1  # planning periods for which a learned action is held
    inputs: tuple[str, ...] = (OBSERVATION,)  # of the network, see `NetworkInputs`

    def __post_init__(self) -> None:
        if not isinstance(self.env_id, str):
            raise InvalidValueError(f"env_id must be a name, got {self.env_id!r}")
        require_integer("hold [planning periods]", self.hold, 1, LONGEST_HOLD)
        keep_python_numbers(self)
        object.__setattr__(self, "inputs", check_inputs(self.inputs, self.residual is not None))


FORMAT = "push-recovery policy"
FORMAT_VERSION = 3
# Values of the keys that the files of earlier versions lack
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


def read_policy(path: str | Path) -> tuple[Mlp, Normalisation, PolicyDescription]:
    """Read the files of `NetworkPolicy.save`.

    Args:
        path: either file of the pair, or their common stem.

    Raises:
        InvalidValueError: a file is missing, damaged, of another version, or the two do not belong together.
    """
    weights_path, description_path = policy_paths(path)
    about = _read_description(description_path)
    try:
        normalisation = Normalisation(
            _numbers(about, "observation_mean"),
            _numbers(about, "observation_variance"),
            require_number("observation_clip", about["observation_clip"]),
            require_number("observation_epsilon", about["observation_epsilon"]),
        )
        residual = about["residual"]
        description = PolicyDescription(
            about["env_id"],
            _record(RobotModel, about["robot"], "robot"),
            _record(GaitLimits, about["limits"], "limits"),
            None if residual is None else read_residual(residual),
            about["hold"],
            tuple(require_kind("inputs", about["inputs"], list)),
        )
        sizes = _sizes(about)
        require_kind("training", about["training"], dict)
    except (InvalidValueError, TypeError, ValueError, ArithmeticError) as error:
        raise InvalidValueError(f"policy description {description_path}: {error}") from error
    return _read_network(weights_path, about, sizes), normalisation, description


def _numbers(about: dict[str, Any], key: str) -> NDArray[np.float64]:
    values = require_kind(key, about[key], list)
    return np.array([require_number(f"{key}[{i}]", value) for i, value in enumerate(values)], np.float64)


def _sizes(about: dict[str, Any]) -> list[int]:
    """Width of every layer, from the input to the output; `about` has known inputs."""
    hidden = require_kind("hidden_sizes", about["hidden_sizes"], list)
    observation_size = require_integer("observation_size", about["observation_size"], 1)
    return [
        observation_size + input_size(about["inputs"], 0),
        *(require_integer(f"hidden_sizes[{i}]", size, 1) for i, size in enumerate(hidden)),
        require_integer("action_size", about["action_size"], 1),
    ]


def _read(kind: str, path: Path) -> bytes:
    try:
        return read_file(path)
    except OSError as error:
        raise InvalidValueError(f"can't read the policy {kind} {path}: {error.strerror}") from error


def _read_description(path: Path) -> dict[str, Any]:
    about = parse_json(f"the policy description {path}", _read("description", path))
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


def _read_network(path: Path, about: dict[str, Any], sizes: list[int]) -> Mlp:
    """The network, its layers of the sizes that the description states."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    content = _read("weights", path)
    if hashlib.sha256(content).hexdigest() != about["weights_sha256"]:
        raise InvalidValueError(
            f"the weights {path} are not those of their JSON (SHA-256 differs): copy both anew"
        )
    try:
        tensors = load(content)
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(f"the policy weights {path} are damaged: {error}") from error
    expected: dict[str, tuple[int, ...]] = {}
    for i, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        expected |= {f"layers.{i}.weight": (outputs, inputs), f"layers.{i}.bias": (outputs,)}
    found = {name: tensor.shape for name, tensor in tensors.items()}
    if found != expected or any(tensor.dtype != np.float32 for tensor in tensors.values()):
        raise InvalidValueError(f"the policy weights {path} must be float32 {expected}, got {found}")
    layers = range(len(sizes) - 1)
    weights, biases = (tuple(tensors[f"layers.{i}.{part}"] for i in layers) for part in ("weight", "bias"))
    try:
        return Mlp(weights, biases, about["activation"], about["output"])
    except ValueError as error:
        raise InvalidValueError(f"the policy weights {path}: {error}") from error


def read_residual(values: Any) -> ResidualBase:
    """A `ResidualBase` from the dict of its fields.

    Raises:
        InvalidValueError: other keys, or impossible values.
    """
    residual = _record(ResidualBase, values, "residual")
    if residual.config is None:
        return residual
    return replace(residual, config=_record(PlannerConfig, _of_today(residual.config), "planner config"))


# Fields that the files of earlier versions lack, and those that no longer exist with the value that is off
NEWER: dict[str, Any] = {"standing_horizon": 0.6, "standing_carry": 0.1}
GONE: dict[str, Any] = {"standing_reach": 0.0}


def _of_today(config: Any) -> Any:
    """The planner's settings of a file of any version in today's fields."""
    if not isinstance(config, dict):
        return config
    return NEWER | {name: value for name, value in config.items() if name not in GONE or value != GONE[name]}


def _record(kind: type[T], values: Any, name: str) -> T:
    """A frozen dataclass from a JSON object with exactly its fields."""
    names = {field.name for field in fields(kind)}  # pyright: ignore[reportArgumentType]
    if not isinstance(values, dict) or set(values) != names:
        raise InvalidValueError(
            f"{name} must be an object with the keys {', '.join(sorted(names))}, got {values!r}"
        )
    return kind(**values)


PolicyState = tuple[NDArray[Any], ...] | None


class LearnedPolicy(ABC):
    """A learned policy with the signature of Stable-Baselines3's predict: its action, held and corrected.

    With `hold` k > 1 the learned action is renewed every k calls while the planner below replans in each; the
    count travels in `state`, which the caller hands back, and starts anew where `episode_start` is True.

    Args:
        description: robot and environment that the policy was made for.
        base: the policy that a residual corrects; by default made from the description.
    """

    observation_size: int  # set by a subclass before it calls `__init__`, like the other
    action_size: int

    def __init__(self, description: PolicyDescription, base: Policy | None = None):
        residual = description.residual
        if residual is not None and self.action_size != GAIT_SIZE:
            raise InvalidValueError(f"a gait residual has {GAIT_SIZE} actions, not {self.action_size}")
        self.description = description
        self.rule: ResidualRule | None = None  # by which a residual is added
        if residual is not None:
            made_for = description.robot, description.limits
            base = residual.make(*made_for) if base is None else base
            scale = np.asarray(residual.scale, dtype=np.float32)
            self.rule = ResidualRule(base, *made_for, scale, residual.gate)

    @abstractmethod
    def _learned(self, rows: NDArray[np.float64], below: Below | None) -> NDArray[np.float32]:
        """Learned actions (n, action_size) in [-1, 1] of observations (n, observation_size)."""

    def predict(
        self,
        observation: ArrayLike,
        state: PolicyState = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], PolicyState]:
        """Actions in [-1, 1], (action_size,) or (n, action_size), float32, for one observation or a batch.

        Args:
            observation: (observation_size,) or (n, observation_size).
            state: of the last call; None where a run begins.
            episode_start: where an episode begins, one flag or (n,).
            deterministic: the mean action is returned either way.

        Raises:
            InvalidValueError: the observation has another shape, or is no array of finite real numbers.
        """
        rows, below, single = self._look(observation)
        action, state = self._held(rows, below, state, episode_start)
        if self.rule is not None and below is not None:
            action = self.rule.total(below, action).total
        return (action[0] if single else action), state

    def learned_action(self, observation: ArrayLike) -> NDArray[np.float32]:
        """The network's own output clipped to [-1, 1], without base or hold, as SB3's predict returns it."""
        rows, below, single = self._look(observation)
        learned = self._learned(rows, below)
        return learned[0] if single else learned

    def check_made_for(self, robot: RobotModel, limits: GaitLimits) -> None:
        """Raise InvalidValueError where an environment's robot or gait limits are not the training's."""
        about = self.description
        for name, mine, theirs in (
            ("another robot", about.robot, robot),
            ("other limits", about.limits, limits),
        ):
            if mine != theirs:
                raise InvalidValueError(
                    f"the policy was made for {name} than the environment's ({about.env_id}): "
                    f"{differences(asdict(mine), asdict(theirs))}"
                )

    def _look(self, observation: ArrayLike) -> tuple[NDArray[np.float64], Below | None, bool]:
        """Observations as rows, the start of a residual there, and whether it was a single one."""
        values = as_doubles(observation)
        if values.ndim not in {1, 2} or values.shape[-1] != self.observation_size:
            raise InvalidValueError(
                f"this policy takes observations ({self.observation_size},) or (n, {self.observation_size}), "
                f"got shape {values.shape}: it was made for {self.description.env_id}"
            )
        if not np.all(np.isfinite(values)):
            raise InvalidValueError(f"the observation is not finite: {values}")
        rows = np.atleast_2d(values)
        return rows, None if self.rule is None else self.rule.below(rows), values.ndim == 1

    def _held(
        self, rows: NDArray, below: Below | None, state: PolicyState, episode_start: ArrayLike | None
    ) -> tuple[NDArray[np.float32], PolicyState]:
        """Learned actions (n, actions), renewed where due, and the state (periods since, actions)."""
        if self.description.hold == 1:
            return self._learned(rows, below), None
        if state is None:
            periods = np.zeros(len(rows), dtype=np.int64)
            held = np.zeros((len(rows), self.action_size), dtype=np.float32)
        else:
            periods, held = state[0].copy(), state[1].copy()
            if held.shape != (len(rows), self.action_size):
                raise InvalidValueError(
                    f"the state is of {len(held)} episodes, the observation of {len(rows)}"
                )
        if episode_start is not None:
            periods[np.broadcast_to(np.asarray(episode_start, dtype=bool), periods.shape)] = 0
        due = periods == 0
        if np.any(due):
            those = None if below is None else Below(below.base[due], below.opening[due])
            held[due] = self._learned(rows[due], those)
        return held, ((periods + 1) % self.description.hold, held)


class NetworkPolicy(LearnedPolicy):
    """A learned policy whose network, normalised observation -> action mean, numpy runs."""

    batchable = True

    def __init__(
        self,
        network: Mlp,
        normalisation: Normalisation,
        description: PolicyDescription,
        base: Policy | None = None,
    ):
        if normalisation.mean.size != network.sizes[0]:
            raise InvalidValueError(
                f"the network takes {network.sizes[0]} inputs, the normalisation {normalisation.mean.size}"
            )
        self.network, self.normalisation = network, normalisation
        self.observation_size = network.sizes[0] - input_size(description.inputs, 0)
        self.action_size = network.sizes[-1]
        super().__init__(description, base)
        self._inputs = NetworkInputs(description.inputs, description.robot, description.limits)

    def network_inputs(self, observation: ArrayLike) -> NDArray[np.float64]:
        """The network's view of one observation or a batch, (n, inputs), before the normalisation."""
        rows, below, _ = self._look(observation)
        return self._inputs.rows(rows, below)

    def save(self, path: str | Path, training: dict[str, Any] | None = None) -> Path:
        """Write PATH.safetensors and PATH.json; returns the first. `training` is kept as a note."""
        from safetensors.numpy import save

        network, normalisation, about = self.network, self.normalisation, self.description
        weights_path, description_path = policy_paths(path)
        tensors = {f"layers.{i}.weight": np.ascontiguousarray(w) for i, w in enumerate(network.weights)}
        tensors |= {f"layers.{i}.bias": np.ascontiguousarray(b) for i, b in enumerate(network.biases)}
        weights = save(tensors)
        description = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "env_id": about.env_id,
            "inputs": list(about.inputs),
            "observation_size": self.observation_size,
            "action_size": self.action_size,
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
            "weights_sha256": hashlib.sha256(weights).hexdigest(),
            "training": training or {},
        }
        text = json.dumps(description, indent=1, allow_nan=False).encode() + b"\n"
        write_atomically(weights_path, weights)
        write_atomically(description_path, text)
        return weights_path

    @classmethod
    def load(cls, path: str | Path, base: Policy | None = None) -> NetworkPolicy:
        """Read a policy from PATH.safetensors and PATH.json; nothing in them can run code."""
        parts = read_policy(path)
        try:
            return cls(*parts, base)
        except InvalidValueError as error:
            raise InvalidValueError(f"policy description {policy_paths(path)[1]}: {error}") from error

    def _learned(self, rows: NDArray[np.float64], below: Below | None) -> NDArray[np.float32]:
        inputs = self.normalisation.apply(self._inputs.rows(rows, below))
        return np.clip(self.network.forward(inputs), np.float32(-1), np.float32(1))
