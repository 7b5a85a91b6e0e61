"""Ranges of model errors: the robot of every drawn scenario is off in its own way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.model.similarity import Similarity
from ...controllers.validation import require_keys, require_number
from .model_errors import SCALES, ModelErrors
from .physics_options import CONTROL_STEP

DRAWS = 12  # numbers that a draw takes of its generator, whatever is given
LATER = ("joint_friction", "joint_damping", "armature", "motor_power", "bus_power", "continuous_torque")

Range = tuple[float, float]


@dataclass(frozen=True)
class ErrorRanges:
    """Uniform ranges (low, high) of model errors for domain randomisation; None: always the default.

    A range of `trunk_com` holds for each of its three components. A delay is drawn in whole control steps of
    the biped.
    """

    mass: Range | None = None
    payload: Range | None = None  # [kg]
    trunk_com: Range | None = None  # [m]
    friction: Range | None = None
    slope_forward: Range | None = None  # [rad]
    slope_left: Range | None = None  # [rad]
    delay: Range | None = None  # [s]
    dcm_noise: Range | None = None  # [m]
    joint_noise: Range | None = None  # [rad]
    floor_step: Range | None = None  # [m]
    joint_friction: Range | None = None  # [N m]
    joint_damping: Range | None = None  # [N m s/rad]
    armature: Range | None = None  # [kg m^2]
    motor_power: Range | None = None  # [W]
    bus_power: Range | None = None  # [W]
    continuous_torque: Range | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None:
                continue
            if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != 2:
                raise InvalidValueError(f"ErrorRanges.{field.name} must be (low, high), got {value!r}")
            low, high = (require_number(f"ErrorRanges.{field.name}", entry) for entry in value)
            if low > high:
                raise InvalidValueError(f"ErrorRanges.{field.name} must have low <= high, got {low} > {high}")
            for bound in (low, high):  # raises where it is out of bounds
                _errors({field.name: (bound,) * 3 if field.name == "trunk_com" else bound})
            object.__setattr__(self, field.name, (low, high))
        if self.delay is not None and math.ceil(self._delay_steps[0]) > math.floor(self._delay_steps[1]):
            raise InvalidValueError(
                f"ErrorRanges.delay must hold a multiple of {CONTROL_STEP} s, got {self.delay}"
            )

    def scaled(self, scale: Similarity) -> ErrorRanges:
        """The same ranges for a robot of another size."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        for name, quantity in SCALES.items():
            if values[name] is not None:
                values[name] = tuple(getattr(scale, quantity) * bound for bound in values[name])
        return ErrorRanges(**values)

    @property
    def _delay_steps(self) -> Range:
        """Range of the delay in control steps, a hair wider than stated."""
        low, high = self.delay or (0.0, 0.0)
        return low / CONTROL_STEP - 1e-9, high / CONTROL_STEP + 1e-9

    def sample(self, rng: np.random.Generator) -> ModelErrors:
        """Draw errors; always the same number of draws, so that one more range changes no other draw."""
        u, index = rng.random(DRAWS), 0
        # Fields that came later draw from a generator that those numbers seed, so that they change none.
        u = np.concatenate([u, np.random.default_rng(u.view(np.uint64)).random(len(LATER))])
        values: dict[str, Any] = {}
        for field in fields(self):
            count = 3 if field.name == "trunk_com" else 1
            mine = u[index : index + count]
            index += count
            bounds = getattr(self, field.name)
            if bounds is None:
                continue
            if field.name == "delay":
                first, last = math.ceil(self._delay_steps[0]), math.floor(self._delay_steps[1])
                drawn = [CONTROL_STEP * min(first + int(mine[0] * (last - first + 1)), last)]
            else:
                drawn = [float(bounds[0] + x * (bounds[1] - bounds[0])) for x in mine]
            values[field.name] = tuple(drawn) if count == 3 else drawn[0]
        return _errors(values)

    def to_dict(self) -> dict[str, list[float]]:
        """Plain JSON types; fields without a range are left out."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: list(value) for name, value in values.items() if value is not None}

    @classmethod
    def from_dict(cls, data: object) -> ErrorRanges:
        """Inverse of `to_dict`."""
        return cls(**require_keys("error ranges", data, set(), {f.name for f in fields(cls)}))


def _errors(values: dict[str, Any]) -> ModelErrors:
    return ModelErrors(**values)
