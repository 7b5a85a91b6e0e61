"""What makes a robot: where its model comes from, its body plan and the preset that belongs to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

import mujoco

from ....controllers.errors import InvalidValueError
from ....controllers.model.body_plan import BodyPlan
from ....controllers.model.robot import RobotModel
from ....controllers.validation import require_number

SHIPPED = {  # name -> module:attribute
    "biped": f"{__package__}.biped.robot:ROBOT",
    "g1": f"{__package__}.adapted.shipped:G1",
    "t1": f"{__package__}.adapted.shipped:T1",
    "jvrc1": f"{__package__}.adapted.shipped:JVRC1",
}
ADAPTED = f"{__package__}.adapted.adapt"  # reads robot files; no kernel depends on it


@dataclass(frozen=True)
class RobotDescription:
    """A robot by its parts.

    `spec` gives a fresh model each time: the robot over a plane named "floor" that its soles touch by contact
    pairs, torque motors on all joints, a touch sensor for each sole. A model of another kind is changed into
    one like that there, before it is compiled.
    """

    name: str
    spec: Callable[[], mujoco.MjSpec]
    plan: BodyPlan
    com_height: float  # at which it walks [m]
    preset: str = "biped"  # settings of planner, gait machine and whole-body control, by name or file
    model: RobotModel | None = None  # what the planner knows of it; None: read from the compiled model
    looks: Callable[[], mujoco.MjSpec] | None = None  # the same robot for the eye; None: as in the physics
    solid: Callable[[], mujoco.MjSpec] | None = None  # with all shapes that may collide; None: it has them

    def __post_init__(self) -> None:
        require_number("RobotDescription.com_height [m]", self.com_height, 0.0, open_low=True)


def robot_description(robot: str | RobotDescription) -> RobotDescription:
    """The robot of a name that is shipped, a robot file or a `module:attribute`; an object stays as it is.

    Raises:
        UnknownNameError: no such name.
        InvalidValueError: nothing to import there, or no RobotDescription.
    """
    if isinstance(robot, RobotDescription):
        return robot
    place = SHIPPED.get(robot, robot) if isinstance(robot, str) else ""
    module, _, attribute = place.partition(":")
    if not (module and attribute):
        return import_module(ADAPTED).robot_of_file(robot, SHIPPED)
    try:
        found = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InvalidValueError(f"cannot load robot {robot!r}: {error}") from error
    if not isinstance(found, RobotDescription):
        raise InvalidValueError(f"robot {robot!r} must be a RobotDescription, got {type(found).__name__}")
    return found
