"""Where the benchmark's punches act on a robot: a body and a point of it for each joint of the G1."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...envs.biped.robots.compiled_robot import CompiledRobot
from ...envs.biped.robots.indices import MISSING

SIDES = "left", "right"
WAIST = 3  # joints of the G1's
LINKS = *3 * ("thigh",), "shank", *2 * ("foot",)  # of a leg that its joints move
ARM = "shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw"
SHOULDER = (0.10, 0.24)  # of the G1, aside and over the waist [m]


class Place(NamedTuple):
    """A body, and an offset from its CoM in the body's axes [m]."""

    body: str
    offset: tuple[float, float, float]


@lru_cache(maxsize=8)
def places_of(robot: CompiledRobot) -> tuple[Place, ...]:
    """Places in the order of the G1's joints: left leg, right leg, waist, left arm, right arm.

    A punch of a leg's joint acts at that joint on the link that it moves, whichever axis of the hip it is on
    the thigh. One of the waist acts on the trunk at the waist. One of an arm acts on the arm's link, held or
    in one with a held one; on a robot without the G1's arms it acts on the trunk where the G1 has its
    shoulders.
    """
    data, legs = robot.in_reference_posture(), robot.indices.legs
    axis = next((joint for joint in robot.indices.joints[1:3] if joint != MISSING), None)
    waist = data.xpos[robot.indices.trunk] if axis is None else data.xanchor[axis]
    found = []
    for side, leg in zip(SIDES, legs, strict=True):
        found += [
            _place(robot, data, f"{side}_{link}", data.xanchor[joint])
            for link, joint in zip(LINKS, leg, strict=True)
        ]
    found += WAIST * [_place(robot, data, "trunk", waist)]
    for side, left in zip(SIDES, (1.0, -1.0), strict=True):
        shoulder = _place(robot, data, "trunk", waist + [0.0, left * SHOULDER[0], SHOULDER[1]])
        found += [_on_arm(robot, data, f"{side}_{part}") or shoulder for part in ARM]
    return tuple(found)


def _on_arm(robot: CompiledRobot, data: mujoco.MjData, part: str) -> Place | None:
    """The origin of a part of an arm, where its joint is, on the link that it is in one with."""
    first = mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_BODY, f"{part}_link")
    if first == MISSING:
        return None
    names, body = {number: name for name, number in robot.pushed.items()}, first
    while body not in robot.indices.pushed:
        body = int(robot.model.body_parentid[body])
    return _place(robot, data, names[robot.indices.pushed.index(body)], data.xpos[first])


def _place(robot: CompiledRobot, data: mujoco.MjData, body: str, point: NDArray[np.float64]) -> Place:
    """A point of the world in the axes of a body, as the robot stands in `data`."""
    number = robot.indices.pushed[robot.pushed[body]]
    x, y, z = (data.xmat[number].reshape(3, 3).T @ (point - data.xipos[number])).round(6).tolist()
    return Place(body, (x + 0.0, y + 0.0, z + 0.0))
