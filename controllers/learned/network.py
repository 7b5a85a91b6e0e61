"""A learned policy run by numpy: a network alone, or a network's residual on a planner."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..made_for import differences
from ..model.gait_box import GAIT_SIZE, GaitLimits
from ..model.observation import as_doubles
from ..model.robot import RobotModel
from ..policies.interface import Policy
from ..policies.residual_rule import Below, ResidualRule
from .description import PolicyDescription
from .inputs import NetworkInputs, input_size
from .mlp import Mlp, Normalisation
from .policy_file import policy_paths, read_policy, write_policy

PolicyState = tuple[NDArray[Any], ...] | None


class NetworkPolicy:
    """A learned policy with the signature of Stable-Baselines3's predict.

    With `hold` k > 1 the learned action is renewed every k calls while the planner below replans in each; the
    count travels in `state`, which the caller hands back, and starts anew where `episode_start` is True.

    Args:
        network: Normalised observation -> action mean.
        normalisation: Of the observation.
        description: What the policy was made for.
        base: The policy that a residual corrects; by default made from the description.
    """

    def __init__(
        self,
        network: Mlp,
        normalisation: Normalisation,
        description: PolicyDescription,
        base: Policy | None = None,
    ):
        inputs, actions = network.sizes[0], network.sizes[-1]
        if normalisation.mean.size != inputs:
            raise InvalidValueError(
                f"the network takes {inputs} inputs, the normalisation {normalisation.mean.size}"
            )
        residual = description.residual
        if residual is not None and actions != GAIT_SIZE:
            raise InvalidValueError(f"a gait residual has {GAIT_SIZE} actions, this network {actions}")
        self.network = network
        self.normalisation = normalisation
        self.description = description
        if residual is not None and base is None:
            base = residual.make(description.robot, description.limits)
        self.rule: ResidualRule | None = None  # by which a residual is added
        if residual is not None and base is not None:
            scale = np.asarray(residual.scale, dtype=np.float32)
            self.rule = ResidualRule(base, description.robot, description.limits, scale, residual.gate)
        self._inputs = NetworkInputs(description.inputs, description.robot, description.limits)

    @property
    def observation_size(self) -> int:
        """Length of the observation."""
        return self.network.sizes[0] - input_size(self.description.inputs, 0)

    @property
    def action_size(self) -> int:
        """Length of the action."""
        return self.network.sizes[-1]

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
            state: What the last call returned; None where a run begins.
            episode_start: Where an episode begins, one flag or (n,).
            deterministic: The mean action is returned either way.

        Raises:
            InvalidValueError: The observation has another shape, or is no array of finite real numbers.
        """
        rows, single = self._rows(observation)
        below = None if self.rule is None else self.rule.below(rows)
        action, state = self._held(rows, below, state, episode_start)
        if self.rule is not None and below is not None:
            action = self.rule.total(below, action).total
        return (action[0] if single else action), state

    def learned_action(self, observation: ArrayLike) -> NDArray[np.float32]:
        """The network's own output clipped to [-1, 1], without base or hold: what SB3's predict returns."""
        rows, single = self._rows(observation)
        learned = self._learned(rows, None if self.rule is None else self.rule.below(rows))
        return learned[0] if single else learned

    def network_inputs(self, observation: ArrayLike) -> NDArray[np.float64]:
        """What the network sees of one observation or a batch, (n, inputs), before the normalisation."""
        rows, _ = self._rows(observation)
        return self._inputs.rows(rows, None if self.rule is None else self.rule.below(rows))

    def check_made_for(self, robot: RobotModel, limits: GaitLimits) -> None:
        """Raise InvalidValueError where an environment's robot or gait limits are not the training's."""
        for name, mine, theirs in (
            ("another robot", self.description.robot, robot),
            ("other limits", self.description.limits, limits),
        ):
            if mine != theirs:
                raise InvalidValueError(
                    f"the policy was made for {name} than the environment's ({self.description.env_id}): "
                    f"{differences(asdict(mine), asdict(theirs))}"
                )

    def save(self, path: str | Path, training: dict[str, Any] | None = None) -> Path:
        """Write PATH.safetensors and PATH.json; returns the first. `training` is kept as a note."""
        return write_policy(self.network, self.normalisation, self.description, path, training)

    @classmethod
    def load(cls, path: str | Path, base: Policy | None = None) -> NetworkPolicy:
        """Read a policy from PATH.safetensors and PATH.json; nothing in them can run code."""
        parts = read_policy(path)
        try:
            return cls(*parts, base)
        except InvalidValueError as error:
            raise InvalidValueError(f"policy description {policy_paths(path)[1]}: {error}") from error

    def _rows(self, observation: ArrayLike) -> tuple[NDArray[np.float64], bool]:
        values = as_doubles(observation)
        if values.ndim not in {1, 2} or values.shape[-1] != self.observation_size:
            raise InvalidValueError(
                f"this policy takes observations ({self.observation_size},) or (n, {self.observation_size}), "
                f"got shape {values.shape}: it was made for {self.description.env_id}"
            )
        if not np.all(np.isfinite(values)):
            raise InvalidValueError(f"the observation is not finite: {values}")
        return np.atleast_2d(values), values.ndim == 1

    def _learned(self, rows: NDArray[np.float64], below: Below | None) -> NDArray[np.float32]:
        inputs = self.normalisation.apply(self._inputs.rows(rows, below))
        return np.clip(self.network.forward(inputs), np.float32(-1), np.float32(1))

    def _held(
        self,
        rows: NDArray[np.float64],
        below: Below | None,
        state: PolicyState,
        episode_start: ArrayLike | None,
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
