"""A policy of others at work: from the state of the robot to the targets of its joints, by its contract."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, MissingExtraError
from ...envs.joint import full_body
from .contract import AXES, LIMITS, NAMES, OFFSET, POSE, SCALE, TERMS, PolicyContract, gaitkeeper

Array = NDArray[np.float64]


class Episode:
    """What a policy remembers of one robot since its reset."""

    def __init__(self, contract: Any, network: Any, actions: int):
        self.builder = gaitkeeper("terms").ObservationBuilder(contract)
        self.network = network
        self.step = 0
        self.action = np.zeros(actions)  # the last one, as the network gave it


class TorchScript:
    """A network in TorchScript, which keeps what it remembers in itself.

    Raises:
        MissingExtraError: torch is not installed.
        InvalidValueError: the file is no TorchScript.
    """

    is_recurrent = True

    def __init__(self, path: str):
        try:
            self._torch = import_module("torch")
        except ImportError as error:
            raise MissingExtraError("torch", "train") from error
        try:
            self._module = self._torch.jit.load(path, map_location="cpu").eval()
        except RuntimeError as error:
            raise InvalidValueError(f"{path!r} is no TorchScript: {str(error).splitlines()[0]}") from error

    def step(self, observation: Array) -> Array:
        """The output for one observation."""
        with self._torch.no_grad():
            row = self._torch.as_tensor(observation, dtype=self._torch.float32)[None]
            return self._module(row).numpy()[0].astype(np.float64)


class Contender:
    """A network in an environment of `FullBodyEnv`, whose servos are those of its contract.

    Its state is an array of `Episode`, one for each robot.
    """

    batchable = True

    def __init__(self, contract: PolicyContract, episodes: Any, trusted: bool = False):
        """Make it ready for the robots of an environment.

        Args:
            contract: what it expects.
            episodes: of the robots.
            trusted: whether the network may be TorchScript, which can run code of its own.

        Raises:
            InvalidValueError: the robots are driven otherwise than the contract says, or a network in
                TorchScript that is not trusted.
            UnknownNameError: the robot lacks a joint of the contract.
        """
        self.contract, robot = contract, episodes.joints
        servos, core = contract.servos(robot), episodes.core
        if core.servos != servos or abs(episodes.control_hz - contract.rate) > 1e-6:
            raise InvalidValueError(
                f"policy {contract.name!r} acts in an environment with the servos and the rate of its "
                "contract: score it by its name on the robot's own environment"
            )
        self._names = [name for name in robot if name is not None]
        self._own = np.array([i for i, name in enumerate(robot) if name is not None])
        self._absent = [name for name in contract.joints if name not in self._names]
        self._rest = np.array(contract.of_joints(POSE, self._absent))
        present = contract.present(robot)
        self._moved = np.array([contract.joints.index(name) for name in present])
        self._places = np.array([robot.index(name) for name in present])
        self._posture = np.array(contract.of_joints(POSE, present))
        self._scale, self._offset = (
            np.array(contract.of_joints(path, contract.joints)) for path in (SCALE, OFFSET)
        )
        clip = gaitkeeper("contract").action_clip_pairs(contract.contract, len(contract.joints))
        self._clip = None if clip is None else np.array(clip).T
        limit = contract.get(LIMITS) or {}
        self._low, self._high = (
            np.array([limit.get(axis, (-np.inf, np.inf))[end] for axis in AXES], np.float64) for end in (0, 1)
        )
        self._reach, self._size = servos.reach, len(robot)
        self._script = contract.network.suffix != ".onnx"
        if self._script and not trusted:
            raise InvalidValueError(
                f"policy {contract.name!r} has a network in TorchScript, and loading one may run its code: "
                "where you trust it, evaluate, compare, frontier, protocol and policy check take --trust"
            )
        self._shared, self._turned = self._load(), gaitkeeper("terms").quat_to_mat
        if self._script:
            self._check_script()

    def _load(self) -> Any:
        if self._script:
            return TorchScript(str(self.contract.network))
        return gaitkeeper("policy").load_policy(self.contract.contract, self.contract.network)

    def _check_script(self) -> None:
        """Raise InvalidValueError for a network in TorchScript that the contract does not fit."""
        row, contract = np.zeros(full_body.ANGLES + 2 * self._size), self.contract
        row[full_body.QUATERNION][0] = 1.0
        episode = Episode(contract.contract, self._shared, len(self._scale))
        seen = self.observe(episode, row, np.zeros(3))
        try:
            answer = np.atleast_1d(self._shared.step(seen))
        except (RuntimeError, IndexError) as error:
            raise InvalidValueError(
                f"{TERMS} of policy {contract.name!r} has {len(seen)} numbers, which its network does not "
                f"take: {str(error).strip().splitlines()[-1]}"
            ) from error
        if answer.shape != (len(contract.joints),):
            raise InvalidValueError(
                f"{NAMES} of policy {contract.name!r} has {len(contract.joints)} joints, the network gives "
                f"{answer.size} numbers"
            )

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], tuple[NDArray[np.object_]]]:
        """Actions (n, M) for observations (n, 13 + 2 M), or (M,) for one; and what it remembers."""
        seen = np.atleast_2d(observation)
        begins = np.zeros(len(seen), bool) if episode_start is None else np.atleast_1d(episode_start)
        begins = begins | (state is None)
        kept = np.empty(len(seen), object) if state is None else state[0]
        actions = np.zeros((len(seen), self._size), np.float32)
        for i, row in enumerate(seen):
            if begins[i]:
                network = self._load() if self._shared.is_recurrent else self._shared
                kept[i] = Episode(self.contract.contract, network, len(self._scale))
            targets = self._offset + self._scale * self._decide(kept[i], row)
            if self._clip is not None:
                targets = np.clip(targets, *self._clip)
            actions[i, self._places] = (targets[self._moved] - self._posture) / self._reach
        return (actions if np.ndim(observation) > 1 else actions[0]), (kept,)

    def _decide(self, episode: Episode, row: Array) -> Array:
        """The network's output for one robot."""
        command = np.clip(row[full_body.COMMAND], self._low, self._high)
        if hasattr(episode.network, "command"):
            episode.network.command = command
        action = episode.network.step(self.observe(episode, row, command))
        episode.action, episode.step = action, episode.step + 1
        return action

    def observe(self, episode: Episode, row: Array, command: Array) -> Array:
        """What the network sees of a robot in state `row` (13 + 2 M,) under a command (3,)."""
        turn = self._turned(row[full_body.QUATERNION])
        angles, rates = row[full_body.ANGLES :][self._own], row[full_body.ANGLES + self._size :][self._own]
        absent = np.zeros(len(self._absent))
        return episode.builder.step(
            row[full_body.QUATERNION], row[full_body.RATE], np.concatenate([angles, self._rest]),
            np.concatenate([rates, absent]), [*self._names, *self._absent], command, episode.step,
            episode.action, turn @ row[full_body.VELOCITY],
        )  # fmt: skip
