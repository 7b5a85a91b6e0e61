"""Environment ids for a robot of one's own."""

from __future__ import annotations

import gymnasium as gym
from gymnasium.envs.registration import register

from ....controllers.errors import InvalidValueError
from .description import robot_description

PACKAGE = __package__.rsplit(".envs.", 1)[0] if __package__ else ""


def register_robot(name: str, robot: str) -> tuple[str, str]:
    """Register `PushRecovery/NAME-v0` and `PushRecovery/NAMEResidual-v0`; returns both ids.

    The ids are known to this process. A module that calls this at its top is named in front of the id where
    others shall find it, as in `push-recovery evaluate --env my_robot:PushRecovery/Mine-v0`.

    Args:
        name: letters and digits, as `Mine`.
        robot: `module:attribute` of its `RobotDescription`.

    Raises:
        UnknownNameError, InvalidValueError: there is no description there.
        InvalidValueError: the name has other characters or is taken.
    """
    if not (isinstance(name, str) and name.isascii() and name.isalnum()):
        raise InvalidValueError(f"the name of a robot has letters and digits only, got {name!r}")
    robot_description(robot)
    ids = f"PushRecovery/{name}-v0", f"PushRecovery/{name}Residual-v0"
    for env_id in ids:
        if env_id in gym.registry:
            raise InvalidValueError(f"{env_id} is registered already; choose another name")
    rooms = ("biped.env:BipedEnv", "biped.env:make_biped_vector"), (
        "residual.wrapper:make_biped_residual", "residual.vector_env:make_biped_residual_vector",
    )  # fmt: skip
    for env_id, (single, vector) in zip(ids, rooms, strict=True):
        register(
            env_id,
            f"{PACKAGE}.envs.{single}",
            vector_entry_point=f"{PACKAGE}.envs.{vector}",
            kwargs={"robot": robot},
        )
    return ids
