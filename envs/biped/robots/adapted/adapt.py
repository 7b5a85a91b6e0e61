"""A robot description out of a robot file: the model is read when it is needed, and adapted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import mujoco

from .....controllers.errors import InvalidValueError, UnknownNameError
from ..description import RobotDescription
from .bare import NONE, SOLID, VISUAL, drop_shapes
from .feet import add_feet
from .joints import add_motors, fix_joints, largest_torques
from .model_place import read_model
from .robot_file import RobotFile, read_robot_file
from .scene import add_world, set_options
from .sketch import can_be_shown, draw_limbs


@dataclass(frozen=True)
class AdaptedSpec:
    """Makes the spec of a robot file, each time a fresh one, with the model's own shapes of a kind."""

    robot: RobotFile
    shapes: str = NONE  # or VISUAL or SOLID

    def __call__(self) -> mujoco.MjSpec:
        """The spec.

        Raises:
            PushRecoveryError: its model cannot be had, or is not what the file says.
        """
        robot, spec = self.robot, read_model(self.robot.model)
        spec.compiler.discardvisual = False  # as it is for a URDF, whose floor would go
        torques = largest_torques(spec)
        shapes = self.shapes if can_be_shown(spec) else NONE
        drop_shapes(spec, shapes, dict(robot.fixed))
        add_root(spec, robot.plan.pelvis)
        fix_joints(spec, robot.fixed)
        for leg in robot.plan.legs:
            require_joints(spec, leg)
        add_motors(spec, robot, torques)
        set_options(spec)
        add_world(spec)
        if self.shapes != shapes:  # which cannot be read
            draw_limbs(spec)
        add_feet(spec, robot)
        return spec


def add_root(spec: mujoco.MjSpec, pelvis: str) -> None:
    """A free joint on the pelvis where the model, as a URDF, stands on its own.

    Raises:
        UnknownNameError: no such body.
        InvalidValueError: it hangs from another one.
    """
    body = spec.body(pelvis)
    if body is None:
        raise UnknownNameError("pelvis", pelvis, [body.name for body in spec.bodies])
    if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints):
        return
    if body.parent.name != "world":
        raise InvalidValueError(
            f"pelvis {pelvis!r} must be the root of its robot, not a part of {body.parent.name!r}"
        )
    body.add_freejoint(name="root")


def require_joints(spec: mujoco.MjSpec, leg: tuple[str, ...]) -> None:
    """Raise UnknownNameError for a joint of a leg that the model does not have."""
    names = [joint.name for joint in spec.joints]
    for name in leg:
        if name not in names:
            raise UnknownNameError("joint of a leg", name, names)


def description_of(robot: RobotFile) -> RobotDescription:
    """The description of a robot file's robot."""
    return RobotDescription(
        robot.name,
        AdaptedSpec(robot),
        robot.plan,
        robot.com_height,
        robot.preset,
        looks=AdaptedSpec(robot, VISUAL),
        solid=AdaptedSpec(robot, SOLID),
    )


def robot_of_file(robot: object, names: Iterable[str]) -> RobotDescription:
    """`load_robot` of the path of a robot file.

    Raises:
        UnknownNameError: none; lists `names`, those that robots have otherwise.
    """
    if not (isinstance(robot, str) and robot.endswith(".json")):
        raise UnknownNameError("robot", robot, [*names, "FILE.json", "MODULE:ATTRIBUTE"])
    return load_robot(robot)


@lru_cache(maxsize=16)
def load_robot(path: str) -> RobotDescription:
    """The description of the robot in a file, read once per process.

    Raises:
        InvalidValueError, UnknownNameError: no such file, or not what a robot file says.
    """
    return description_of(read_robot_file(path))
