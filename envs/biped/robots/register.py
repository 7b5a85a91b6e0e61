"""Environment ids for a robot of one's own."""

from __future__ import annotations

import gymnasium as gym
from gymnasium.envs.registration import register

from ....controllers.errors import InvalidValueError
from .description import robot_description

FORMS = "", "Residual", "Joint", "JointResidual"  # of an environment: what follows the robot's name


def register_robot(name: str, robot: str) -> tuple[str, ...]:
    """Register `PushRecovery/NAME-v0`, its forms Residual, Joint and JointResidual; returns their ids.

    The ids are known to this process. A module that calls this at its top is named in front of the id where
    others shall find it, as in `push-recovery evaluate --env my_robot:PushRecovery/Mine-v0`.

    Args:
        name: letters and digits, as `Mine`.
        robot: `module:attribute` of its `RobotDescription`, or a robot file.

    Raises:
        UnknownNameError, InvalidValueError: there is no description there.
        InvalidValueError: the name has other characters or is taken.
    """
    if not (isinstance(name, str) and name.isascii() and name.isalnum()):
        raise InvalidValueError(f"the name of a robot has letters and digits only, got {name!r}")
    robot_description(robot)
    ids = tuple(f"PushRecovery/{name}{form}-v0" for form in FORMS)
    for env_id in ids:
        if env_id in gym.registry:
            raise InvalidValueError(f"{env_id} is registered already; choose another name")
    for env_id, form in zip(ids, FORMS, strict=True):
        biped = gym.spec(f"PushRecovery/Biped{form}-v0")
        register(
            env_id,
            biped.entry_point,
            vector_entry_point=biped.vector_entry_point,
            kwargs={"robot": robot},
        )
    return ids
