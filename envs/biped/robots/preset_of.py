"""Whether a preset belongs to a robot: one that was made for another is refused with what differs."""

from __future__ import annotations

from dataclasses import asdict

from ....controllers.errors import InvalidValueError
from ....controllers.made_for import differences
from ....controllers.model.gait_box import GaitLimits
from ....controllers.model.robot import RobotModel
from ....controllers.settings.presets import load_preset

ROUNDING = 1e-9  # by which a CoP may lie beyond the sole [m]


def check_preset(preset: str, robot: RobotModel, limits: GaitLimits) -> None:
    """Raise InvalidValueError where a preset says that it is another robot's, or plans CoPs off the sole.

    Args:
        preset: by name or file; one that `push-recovery robot new` or a robot file brought says whose it is.
        robot: of the environment.
        limits: the preset's.
    """
    made_for = load_preset(preset).made_for
    if isinstance(made_for, dict) and (told := differences(made_for, asdict(robot))):
        raise InvalidValueError(
            f"preset {preset!r} was made for another robot than the environment's: {told}"
        )
    sole, own = (2.0 * limits.cop_x_max, 2.0 * limits.cop_y_max), (robot.foot_length, robot.foot_width)
    if any(asked > size + ROUNDING for asked, size in zip(sole, own, strict=True)):
        raise InvalidValueError(
            f"preset {preset!r} is for a sole of {sole[0]:.3g} x {sole[1]:.3g} m, the robot's is "
            f"{own[0]:.3g} x {own[1]:.3g} m: set limits.cop_x_max and limits.cop_y_max, or have "
            "push-recovery robot new scale one"
        )
