"""The box of gait actions: the planner's constraint set and the environments' action space."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError, is_finite_number, shown
from ..jit import njit
from ..validation import keep_python_numbers, require_kind
from .robot import RobotModel

GAIT_NAMES = ("step_length", "step_width", "step_duration", "cop_x", "cop_y", "trunk_pitch_acceleration",
              "trunk_roll_acceleration")  # fmt: skip
# Columns of the gait variables and of actions; of a pair (x, y) the first one
STEP = 0  # pair, u_T: L, W [m]
DURATION = 2  # T [s]
COP = 3  # pair [m]
TRUNK = 5  # pair, trunk acceleration [rad/s^2]
GAIT_SIZE = 7

SHORTEST_STEP = 0.01  # least `duration_min` [s]


@dataclass(frozen=True)
class GaitLimits:
    """Bounds of the seven gait variables in the canonical frame (paper, Tables I and II).

    The canonical frame has its origin at the centre of the stance sole, x along the heading and y from the
    stance foot towards the swing side, so that left and right stance are one problem. Trunk accelerations
    are those of the lean angle towards +x and towards +y: positive moves the CMP the same way. About an axis
    that the waist lacks the range is the number 0.
    """

    length_min: float = -0.5  # [m]
    length_max: float = 0.5  # [m]
    width_min: float = 0.1  # [m], outward from the stance foot: l_p - 0.1
    width_max: float = 0.4  # [m]: l_p + 0.2
    duration_min: float = 0.3  # [s]
    duration_max: float = 1.0  # [s]
    cop_x_max: float = 0.10  # [m], both ways: half the foot length
    cop_y_max: float = 0.05  # [m], both ways: half the foot width
    trunk_acceleration_max: float = 18.75  # [rad/s^2], both ways: tau_max / j
    trunk_pitch: bool = True  # whether the trunk can be accelerated forward and back
    trunk_roll: bool = True  # whether it can be accelerated aside

    def __post_init__(self) -> None:
        keep_python_numbers(self)
        for field in fields(self):
            if isinstance(field.default, bool):
                require_kind(f"GaitLimits.{field.name}", getattr(self, field.name), bool)
            elif not is_finite_number(getattr(self, field.name)):
                raise InvalidValueError(
                    f"GaitLimits.{field.name} must be finite, got {shown(getattr(self, field.name))}"
                )
        for name in ("length", "width", "duration"):
            low, high = getattr(self, f"{name}_min"), getattr(self, f"{name}_max")
            if not low < high:
                raise InvalidValueError(
                    f"GaitLimits.{name}_min must be below {name}_max, got {low} >= {high}"
                )
        if not self.duration_min >= SHORTEST_STEP:
            raise InvalidValueError(
                f"GaitLimits.duration_min must be at least {SHORTEST_STEP} s, got {self.duration_min}"
            )
        for name in ("cop_x_max", "cop_y_max", "trunk_acceleration_max"):
            if not getattr(self, name) > 0:
                raise InvalidValueError(f"GaitLimits.{name} must be positive, got {getattr(self, name)}")

    @classmethod
    def of(cls, robot: RobotModel) -> GaitLimits:
        """The paper's limits for a robot: Table I about l_p, CoP in the foot, torque over inertia."""
        return cls(
            width_min=robot.pelvis_width - 0.1,
            width_max=robot.pelvis_width + 0.2,
            cop_x_max=robot.foot_length / 2,
            cop_y_max=robot.foot_width / 2,
            trunk_acceleration_max=robot.trunk_torque_max / robot.trunk_inertia,
            trunk_pitch=robot.trunk_pitch,
            trunk_roll=robot.trunk_roll,
        )

    @cached_property
    def trunk_accelerations(self) -> tuple[float, float]:
        """Bound of the trunk acceleration in pitch and roll, both ways [rad/s^2]; 0 about a missing axis."""
        bound = self.trunk_acceleration_max
        return bound if self.trunk_pitch else 0.0, bound if self.trunk_roll else 0.0

    @cached_property
    def box(self) -> NDArray[np.float64]:
        """Lower and upper bounds, (2, 7), in the units of GAIT_NAMES; read-only."""
        both_ways = self.cop_x_max, self.cop_y_max, *self.trunk_accelerations
        low = self.length_min, self.width_min, self.duration_min, *(-bound for bound in both_ways)
        box = np.array([low, (self.length_max, self.width_max, self.duration_max, *both_ways)])
        box.flags.writeable = False
        return box

    @cached_property
    def low(self) -> NDArray[np.float64]:
        """Lower bounds, (7,); read-only."""
        return self.box[0]

    @cached_property
    def high(self) -> NDArray[np.float64]:
        """Upper bounds, (7,); read-only."""
        return self.box[1]

    def to_action(self, gait: ArrayLike) -> NDArray[np.float32]:
        """Gait variables (..., 7) -> actions in [-1, 1], clipped, float32; 0 for one without a range."""
        span = self.high - self.low
        share = 2.0 * (np.asarray(gait, dtype=np.float64) - self.low) / np.where(span > 0.0, span, 1.0)
        return np.clip(np.where(span > 0.0, share - 1.0, 0.0), -1.0, 1.0).astype(np.float32)

    def from_action(self, action: ArrayLike) -> NDArray[np.float64]:
        """Actions (..., 7) in [-1, 1], clipped -> gait variables."""
        gait = np.array(action, dtype=np.float64, order="C")
        if gait.shape[-1:] != (GAIT_SIZE,):
            raise InvalidValueError(f"an action has {GAIT_SIZE} entries, got shape {gait.shape}")
        _scale(gait.reshape(-1, GAIT_SIZE), self.low, self.high)
        return gait


@njit(cache=True)
def unscaled(entry, low, high):  # pragma: no cover
    """The gait variable in [low, high] of an action's entry in [-1, 1]."""
    return low + 0.5 * (entry + 1.0) * (high - low)


@njit(cache=True)
def _scale(actions, low, high):  # pragma: no cover
    """Put low + (action + 1) (high - low) / 2 in the place of actions (n, 7); NaN stays."""
    for i in range(actions.shape[0]):
        for j in range(actions.shape[1]):
            clipped = actions[i, j]
            if clipped < -1.0:
                clipped = -1.0
            elif clipped > 1.0:
                clipped = 1.0
            actions[i, j] = unscaled(clipped, low[j], high[j])
