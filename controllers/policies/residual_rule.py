"""The one rule by which a learned correction is added to what a policy does."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from .interface import Policy
from .residual import compose
from .residual_gate import check_gate, make_gate

Actions = NDArray[np.float32]


class Correction(NamedTuple):
    """What became of n corrected actions, in action units."""

    total: Actions  # (n, 7) base + shift, clipped to [-1, 1]; the base's own bits where the shift is 0
    base: Actions  # (n, 7) what the policy below would do
    shift: Actions  # (n, 7) scale x g x learned action


class Below(NamedTuple):
    """What n corrections start from."""

    base: Actions  # (n, 7) of the policy below
    opening: Actions  # (n, 1) of the gate, in [0, 1]


class ResidualRule:
    """total = clip(base + scale x g x a, -1, 1), with g the gate's opening, 1 without a gate.

    Args:
        policy: What acts below; a gate takes its touchdown delay.
        robot: Physical constants.
        limits: Gait box, which the gate's nominal gait follows from.
        scale: (7,) in action units, see `check_residual_scale`.
        gate: (shut, open) [m], see `ResidualGate`; None: none.

    Raises:
        InvalidValueError: An impossible gate, or one on a policy with double support.
    """

    def __init__(
        self, policy: Policy, robot: RobotModel, limits: GaitLimits, scale: Actions, gate: ArrayLike | None
    ):
        self.policy, self.scale = policy, scale
        self.gate = None if gate is None else check_gate(gate)
        self._gate = make_gate(policy, robot, limits, self.gate)

    def opening(self, observations: NDArray[np.float64]) -> Actions:
        """Openings g (n, 1) in [0, 1] at observations (n, 36)."""
        if self._gate is None:
            return np.ones((len(observations), 1), np.float32)
        return self._gate(observations)

    def correct(self, observations: NDArray[np.float64], base: ArrayLike, learned: Actions) -> Correction:
        """What learned actions (n, 7) in [-1, 1] make of the base's (n, 7) at observations (n, 36)."""
        return self.add(Below(np.asarray(base, np.float32), self.opening(observations)), learned)

    def add(self, below: Below, learned: Actions) -> Correction:
        """What learned actions (n, 7) in [-1, 1] make of what is below."""
        opened: Actions = below.opening * learned
        shift: Actions = self.scale * opened
        return Correction(compose(below.base, opened, self.scale), below.base, shift)

    def below(self, observations: NDArray[np.float64]) -> Below:
        """What the policy below does for n robots in one call, without a memory, and the gate's openings.

        Raises:
            InvalidValueError: the policy has a memory.
        """
        base, state = self.policy.predict(observations)
        if state is not None:
            raise InvalidValueError(
                "a residual on n robots needs a policy without memory: predict gave a state"
            )
        return Below(np.asarray(base, np.float32), self.opening(observations))

    def act(self, observations: NDArray[np.float64], learned: Actions) -> Correction:
        """`correct` what the policy below does for n robots.

        Raises:
            InvalidValueError: the policy has a memory.
        """
        return self.total(self.below(observations), learned)

    def total(self, below: Below, learned: Actions) -> Correction:
        """`add`, the sum within [-1, 1] where nothing is corrected, too."""
        correction = self.add(below, learned)
        return correction._replace(total=np.clip(correction.total, np.float32(-1.0), np.float32(1.0)))
