"""A robot by its model, its body plan and its preset; environment ids for a robot of one's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import mujoco
from gymnasium.envs.registration import register

from ...controllers.errors import InvalidValueError
from ...controllers.files import is_file
from ...controllers.model.gait_box import GaitLimits
from ...controllers.model.robot import BodyPlan, RobotModel
from ...controllers.settings import load_preset
from ...controllers.validation import differences, require_number

BIPED = f"{__package__}.biped:ROBOT"
ADAPTED = f"{__package__}.adapt"  # reads robot files, shipped ones among them; no kernel depends on it


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
    whole: Callable[[], RobotDescription] | None = None  # with the joints that are fixed here, if any
    files: str = ""  # SHA-256 of what it is read from, robot file and model; empty: made in Python
    driven: bool = False  # whether the joints that the plan holds are driven by actions, as all others

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
    place = BIPED if robot == "biped" else robot if isinstance(robot, str) else ""
    module, _, attribute = place.partition(":")
    if not (module and attribute) or place.endswith(".json"):  # a folder may have a colon too
        return import_module(ADAPTED).robot_of_file(robot)
    try:
        description = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InvalidValueError(f"cannot load robot {robot!r}: {error}") from error
    if not isinstance(description, RobotDescription):
        raise InvalidValueError(
            f"robot {robot!r} must be a RobotDescription, got {type(description).__name__}"
        )
    return description


FORMS = "", "Residual", "Joint", "JointResidual", "FullBody"  # what follows the robot's name


def register_robot(name: str, robot: str) -> tuple[str, ...]:
    """Register `PushRecovery/NAME-v0`, its other forms, one for each of FORMS; returns their ids.

    The ids are known to this process. A module that calls this at its top is named in front of the id where
    others shall find it, as in `push-recovery evaluate --env my_robot:PushRecovery/Mine-v0`.

    Args:
        name: letters and digits, such as "Mine".
        robot: `module:attribute` of its `RobotDescription`, or a robot file.

    Raises:
        UnknownNameError, InvalidValueError: there is no description there.
        InvalidValueError: the name has other characters or is taken.
    """
    if not (isinstance(name, str) and name.isascii() and name.isalnum()):
        raise InvalidValueError(f"the name of a robot has letters and digits only, got {name!r}")
    robot_description(robot)
    if is_file(robot):
        robot = str(Path(robot).absolute())  # from whatever folder its environments are made
    ids = tuple(f"PushRecovery/{name}{form}-v0" for form in FORMS)
    for env_id in ids:
        if env_id in gym.registry:
            raise InvalidValueError(f"{env_id} is registered already; choose another name")
    for env_id, form in zip(ids, FORMS, strict=True):
        biped = gym.spec(f"PushRecovery/Biped{form}-v0")
        vector = biped.vector_entry_point
        register(env_id, biped.entry_point, vector_entry_point=vector, kwargs={"robot": robot})
    return ids


ROUNDING = 1e-9  # by which a CoP may lie beyond the sole [m]


def check_preset(preset: str, robot: RobotModel, limits: GaitLimits) -> None:
    """Raise InvalidValueError where a preset says that it is another robot's, or plans CoPs off the sole.

    Args:
        preset: by name or file; one that `push-recovery robot new` or a robot file brought says whose it is.
        robot: of the environment.
        limits: the preset's.
    """
    made_for = load_preset(preset).made_for
    if isinstance(made_for, dict) and (differing := differences(made_for, asdict(robot))):
        raise InvalidValueError(
            f"preset {preset!r} was made for another robot than the environment's: {differing}"
        )
    sole, own = (2.0 * limits.cop_x_max, 2.0 * limits.cop_y_max), (robot.foot_length, robot.foot_width)
    if any(asked > size + ROUNDING for asked, size in zip(sole, own, strict=True)):
        raise InvalidValueError(
            f"preset {preset!r} is for a sole of {sole[0]:.3g} x {sole[1]:.3g} m, the robot's is "
            f"{own[0]:.3g} x {own[1]:.3g} m: set limits.cop_x_max and limits.cop_y_max, or have "
            "push-recovery robot new scale one"
        )
