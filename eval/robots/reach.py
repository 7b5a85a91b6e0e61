"""How high a robot stands and how far it steps: postures that exist within the ranges of its joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from ...controllers.errors import InvalidValueError
from ...envs.biped.posture import posture
from ...envs.biped.robots.compiled_robot import CompiledRobot, compiled_robot
from ...envs.biped.robots.description import RobotDescription

BENT = 0.875  # length of a standing leg over that of a straight one, the biped's
LOWERED = 0.24  # of its height the CoM may sink for a long step, the biped's
FINE = 0.005  # of a height and of a step that are searched [m]
FARTHEST = 1.0  # step that is looked for [m]


def standing_height(description: RobotDescription) -> float:
    """CoM height over level soles at which the legs are bent as the biped's are [m].

    Raises:
        InvalidValueError: the robot cannot stand so.
    """
    body = compiled_robot(description)
    data = body.in_reference_posture()
    mujoco.mj_comPos(body.model, data)
    straight = data.subtree_com[0, 2] - data.site_xpos[body.indices.soles[0], 2]
    for height in np.arange(straight, 0.6 * straight, -FINE):
        share = _leg_share(body, height)
        if share is not None and share <= BENT:
            return round(float(height), 3)
    raise InvalidValueError(
        f"robot {description.name!r} does not stand with its CoM over its soles, {0.6 * straight:.2f} to "
        f"{straight:.2f} m high, within the ranges of its joints"
    )


def _leg_share(body: CompiledRobot, height: float) -> float | None:
    """Length of the left leg over that of a straight one, of a robot that stands; None where it cannot."""
    data, straight = mujoco.MjData(body.model), body.in_reference_posture()
    coordinates = _stands(body, height, (0.0, body.robot.pelvis_width))
    if coordinates is None:
        return None
    data.qpos[:] = coordinates
    mujoco.mj_kinematics(body.model, data)
    hip, ankle = body.indices.legs[0][0], body.indices.legs[0][4]
    lengths = [np.linalg.norm(one.xanchor[ankle] - one.xanchor[hip]) for one in (data, straight)]
    return float(lengths[0] / lengths[1])


def _stands(body: CompiledRobot, height: float, step: tuple[float, float]) -> np.ndarray | None:
    """Coordinates of a robot half-way between its soles, the left one a step before and beside the right."""
    x, y = step
    soles = np.array([[x, y, 0.0], [0.0, 0.0, 0.0]])
    try:
        coordinates = posture(body, np.array([0.5 * x, 0.5 * y, height]), np.zeros(3), soles)[0]
    except InvalidValueError:
        return None
    return coordinates if _within_ranges(body, coordinates) else None


def _within_ranges(body: CompiledRobot, coordinates: np.ndarray) -> bool:
    """Whether the joints of both legs are within their ranges."""
    model, joints = body.model, np.array([*body.indices.legs[0], *body.indices.legs[1]])
    angles, limited = coordinates[model.jnt_qposadr[joints]], model.jnt_limited[joints].astype(bool)
    low, high = model.jnt_range[joints].T
    return bool(np.all(~limited | ((low <= angles) & (angles <= high))))


def reachable_steps(description: RobotDescription, height: float) -> dict[str, float]:
    """Longest steps forward and back, and the widest, that a robot can stand in: fields of GaitLimits [m].

    The CoM is half-way between the soles and as high as it walks, or lower by up to what the biped sinks.
    """
    body = compiled_robot(replace(description, com_height=height))
    width = body.robot.pelvis_width

    def farthest(step: Callable[[float], tuple[float, float]]) -> float:
        """Largest length [m] up to which every step of FINE exists at some height."""
        reached = 0.0
        for length in np.arange(FINE, FARTHEST, 4.0 * FINE):
            heights = height * (1.0 - np.linspace(0.0, LOWERED, 5))
            if all(_stands(body, low, step(length)) is None for low in heights):
                break
            reached = float(length)
        return round(reached, 3)

    return {
        "length_max": farthest(lambda length: (length, width)),
        "length_min": -farthest(lambda length: (-length, width)),
        "width_max": round(width + farthest(lambda length: (0.0, width + length)), 3),
    }
