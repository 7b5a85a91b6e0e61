"""A small network in numpy, and the blocks of numbers that it sees, all functions of the observation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidValueError, UnknownNameError
from ..jit import njit
from ..model.capturability import capture_constants, capture_margin_kernel
from ..model.gait_box import GAIT_SIZE, GaitLimits
from ..model.observation import DCM, ELAPSED, TRUNK_ANGLE, TRUNK_RATE
from ..model.robot import RobotModel
from ..validation import require_choice
from .residual import Below

ACTIVATIONS = ("tanh", "relu")
OUTPUTS = ("linear", "tanh")


@dataclass(frozen=True)
class Normalisation:
    """x = clip((observation - mean) / sqrt(variance + epsilon), -clip, clip), as float32."""

    mean: NDArray[np.float64]  # (observations,)
    variance: NDArray[np.float64]  # (observations,)
    clip: float = 10.0
    epsilon: float = 1e-8

    def __post_init__(self) -> None:
        if self.mean.ndim != 1 or self.mean.shape != self.variance.shape:
            raise InvalidValueError(
                f"observation mean {self.mean.shape} and variance {self.variance.shape} must be equal rows"
            )
        if not (np.all(np.isfinite(self.mean)) and np.all(np.isfinite(self.variance))):
            raise InvalidValueError("observation mean and variance must be finite")
        if np.any(self.variance < 0) or not (np.isfinite(self.epsilon) and self.epsilon > 0):
            raise InvalidValueError("observation variance must be >= 0 and epsilon > 0")
        if not (np.isfinite(self.clip) and self.clip > 0):
            raise InvalidValueError(f"observation clip must be positive and finite, got {self.clip}")

    def apply(self, observations: NDArray[np.float64]) -> NDArray[np.float32]:
        """Normalised observations, (..., observations) float32."""
        scaled = (observations - self.mean) / np.sqrt(self.variance + self.epsilon)
        return np.clip(scaled, -self.clip, self.clip).astype(np.float32)


@dataclass(frozen=True)
class Mlp:
    """Layers y = W x + b, W (outputs, inputs) float32, an activation between them, `output` after the last.

    The sums run in one fixed order, so that a row's output has the same bits alone and in any batch.

    Raises:
        InvalidValueError: shapes that do not follow from each other, or a value that is not finite.
        UnknownNameError: another activation or output.
    """

    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    activation: str = "tanh"  # of ACTIVATIONS
    output: str = "linear"  # of OUTPUTS
    _columns: tuple[NDArray[np.float32], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        require_choice("activation", self.activation, ACTIVATIONS)
        require_choice("output", self.output, OUTPUTS)
        if not self.weights or len(self.weights) != len(self.biases):
            raise InvalidValueError(
                f"a network needs as many biases as weights, got {len(self.weights)}, {len(self.biases)}"
            )
        size = self.weights[0].shape[-1]
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.ndim != 2 or weight.shape[1] != size or bias.shape != weight.shape[:1]:
                raise InvalidValueError(
                    f"layer {i}: weight must be (outputs, {size}), bias (outputs,), got {weight.shape}, "
                    f"{bias.shape}"
                )
            if not (np.all(np.isfinite(weight)) and np.all(np.isfinite(bias))):
                raise InvalidValueError(f"layer {i}: every weight and bias must be finite")
            size = weight.shape[0]
        columns = tuple(np.ascontiguousarray(weight.T, dtype=np.float32) for weight in self.weights)
        object.__setattr__(self, "_columns", columns)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Width of every layer, from the input to the output."""
        return (self.weights[0].shape[1], *(weight.shape[0] for weight in self.weights))

    def forward(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Outputs (n, outputs) of inputs (n, inputs)."""
        layer = np.ascontiguousarray(inputs, dtype=np.float32)
        last = len(self.weights) - 1
        for i, (columns, bias) in enumerate(zip(self._columns, self.biases, strict=True)):
            layer = _affine(layer, columns, bias)
            if (self.activation if i < last else self.output) == "tanh":
                _tanh(layer)
            elif i < last:
                np.maximum(layer, np.float32(0), out=layer)
        return layer


@njit(cache=True)
def _affine(inputs, columns, bias):  # pragma: no cover - compiled
    """Inputs (n, i) @ columns (i, o) + bias (o,), summed over i in order."""
    rows, size = inputs.shape
    out = np.empty((rows, columns.shape[1]), dtype=np.float32)
    for row in range(rows):
        sums = out[row]
        sums[:] = bias
        for i in range(size):
            x = inputs[row, i]
            for j in range(sums.shape[0]):
                sums[j] += x * columns[i, j]
    return out


@njit(cache=True)
def _tanh(values):  # pragma: no cover - compiled
    """Tanh in place."""
    for row in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[row, j] = np.tanh(values[row, j])


OBSERVATION, BASE, GATE, MARGIN = "observation", "base", "gate", "margin"
INPUTS = (OBSERVATION, BASE, GATE, MARGIN)
MARGIN_RANGE = 0.5  # beyond which a larger margin makes no difference [m]

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
    if not residual and (foreign := [name for name in blocks if name in (BASE, GATE)]):
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
