"""What a network sees: blocks of numbers by name, all of them functions of the observation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..errors import InvalidValueError, UnknownNameError
from ..model.capturability import capture_constants, capture_margin_kernel
from ..model.gait_box import GAIT_SIZE, GaitLimits
from ..model.observation import DCM, ELAPSED, TRUNK_ANGLE, TRUNK_RATE
from ..model.robot import RobotModel
from ..policies.residual_rule import Below

OBSERVATION, BASE, GATE, MARGIN = "observation", "base", "gate", "margin"
INPUTS = (OBSERVATION, BASE, GATE, MARGIN)
OF_RESIDUAL = (BASE, GATE)  # that only a residual has
MARGIN_RANGE = 0.5  # beyond which a margin tells nothing more [m]

_DCM, _ANGLE, _RATE = DCM.start, TRUNK_ANGLE.start, TRUNK_RATE.start


def check_inputs(names: Sequence[str], residual: bool) -> tuple[str, ...]:
    """Names of blocks in their order.

    Raises:
        InvalidValueError: the first is not the observation, one stands twice, or one belongs to residuals.
        UnknownNameError: there is no such block.
    """
    blocks = tuple(names)
    for name in blocks:
        if name not in INPUTS:
            raise UnknownNameError("input of a network", str(name), INPUTS)
    if blocks[:1] != (OBSERVATION,) or len(set(blocks)) < len(blocks):
        raise InvalidValueError(
            f"the inputs of a network are '{OBSERVATION}' and then others, each once, got {list(blocks)}"
        )
    if not residual and (foreign := [name for name in blocks if name in OF_RESIDUAL]):
        raise InvalidValueError(f"only a residual has the input {foreign[0]!r}")
    return blocks


def input_size(names: Sequence[str], observation_size: int) -> int:
    """Length of the blocks together."""
    sizes = {OBSERVATION: observation_size, BASE: GAIT_SIZE, GATE: 1, MARGIN: 1}
    return sum(sizes[name] for name in names)


class NetworkInputs:
    """Rows for a network out of observations.

    - `observation`: as it is.
    - `base` (7): what the policy below does.
    - `gate` (1): the opening g of the residual's gate, 1 without one.
    - `margin` (1): the capture margin of the observation, within MARGIN_RANGE [m].

    Args:
        names: of the blocks, see `check_inputs`.
        robot: physical constants.
        limits: gait box.
    """

    def __init__(self, names: Sequence[str], robot: RobotModel, limits: GaitLimits):
        self.names = tuple(names)
        self._capture = capture_constants(robot, limits)

    def rows(self, observations: NDArray[np.float64], below: Below | None) -> NDArray[np.float64]:
        """Inputs (n, size) of observations (n, k), and of what a residual corrects there."""
        if len(self.names) == 1:
            return observations
        blocks: dict[str, Any] = {OBSERVATION: observations}
        if below is not None:
            blocks |= {BASE: below.base, GATE: below.opening}
        if MARGIN in self.names:
            blocks[MARGIN] = margins(observations, self._capture)
        return np.concatenate([np.asarray(blocks[name], np.float64) for name in self.names], axis=1)


@njit(cache=True)
def margins(observations, capture):  # pragma: no cover
    """Capture margins (n, 1) of gait observations (n, 36), clipped to MARGIN_RANGE [m]."""
    out = np.empty((observations.shape[0], 1))
    for i in range(observations.shape[0]):
        obs = observations[i]
        margin = capture_margin_kernel(
            obs[ELAPSED], obs[_DCM : _DCM + 2], obs[_ANGLE : _ANGLE + 2], obs[_RATE : _RATE + 2], capture
        )
        out[i, 0] = min(max(margin, -MARGIN_RANGE), MARGIN_RANGE)
    return out
