"""Physical constants of the linear inverted pendulum with flywheel."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ..errors import InvalidValueError, is_finite_number, shown
from ..validation import require_kind

GRAVITY = 9.81  # [m/s^2]
SMALLEST, LARGEST = 1e-4, 1e6  # of any constant of a robot, in its unit


def natural_frequency(com_height: float) -> float:
    """Natural frequency sqrt(g / h) [1/s] of a pendulum of constant height h [m]."""
    if not com_height > 0:
        raise InvalidValueError(f"com_height must be positive [m], got {com_height}")
    return math.sqrt(GRAVITY / com_height)


@dataclass(frozen=True)
class RobotModel:
    """What the planner knows of a robot; the defaults are the paper's Table II.

    The paper leaves the foot's size and the pelvis width open; 0.20 x 0.10 m and 0.20 m are plausible and
    its claims hold with them. Where the waist lacks an axis there is no flywheel about it; inertia, torque
    and angle of a trunk without any axis have no meaning and may be any numbers in range.
    """

    mass: float = 60.0  # [kg]
    com_height: float = 0.8  # [m]
    trunk_inertia: float = 8.0  # j [kg m^2]
    trunk_torque_max: float = 150.0  # [N m]
    trunk_angle_max: float = math.pi / 3  # [rad], both ways
    foot_length: float = 0.20  # [m]
    foot_width: float = 0.10  # [m]
    pelvis_width: float = 0.20  # l_p [m], lateral distance of the feet when standing
    trunk_pitch: bool = True  # whether the waist can swing the trunk forward and back
    trunk_roll: bool = True  # whether it can swing it aside

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(field.default, bool):
                require_kind(f"RobotModel.{field.name}", value, bool)
                continue
            if not (is_finite_number(value) and value > 0):
                raise InvalidValueError(
                    f"RobotModel.{field.name} must be positive and finite, got {shown(value)}"
                )
            if not SMALLEST <= value <= LARGEST:
                raise InvalidValueError(
                    f"RobotModel.{field.name} must lie in [{SMALLEST:g}, {LARGEST:g}], got {value:g}"
                )

    @property
    def omega(self) -> float:
        """Natural frequency sqrt(g / h) [1/s]."""
        return natural_frequency(self.com_height)

    @property
    def weight(self) -> float:
        """Weight m g [N]."""
        return self.mass * GRAVITY

    @property
    def cmp_per_trunk_acceleration(self) -> float:
        """Gain j / (m g) [m s^2]: CMP = CoP + this x trunk acceleration (eqs. 5, 9)."""
        return self.trunk_inertia / self.weight
