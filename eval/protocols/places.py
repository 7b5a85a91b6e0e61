"""Where the benchmark's punches act on a robot: a body and a point of it for each joint of the G1."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...envs.biped.robots.compiled_robot import CompiledRobot
from ...envs.biped.robots.indices import MISSING
from ...envs.scenario.push import BODIES, Body, Side

SIDES: tuple[Side, Side] = "left", "right"
WAIST, ARM = 3, 7  # joints of the G1's waist and of an arm
SHOULDER = (0.10, 0.24)  # of the G1, aside and over the waist [m]


class Place(NamedTuple):
    """A body, and an offset from its CoM in the body's axes [m]."""

    body: Body
    offset: tuple[float, float, float]


def places_of(robot: CompiledRobot) -> tuple[Place, ...]:
    """Places in the order of the G1's joints: left leg, right leg, waist, left arm, right arm.

    A punch of a leg's joint acts at that joint on the link that it moves, whichever axis of the hip it is on
    the thigh. One of the waist acts on the trunk at the waist. One of an arm acts on the trunk where the G1
    has its shoulders, since arms are held.
    """
    data, legs = robot.in_reference_posture(), robot.indices.legs
    joint = next((number for number in robot.indices.joints[1:3] if number != MISSING), None)
    waist = data.xpos[robot.indices.trunk] if joint is None else data.xanchor[joint]
    found = []
    for side, leg in zip(SIDES, legs, strict=True):
        links = (*3 * ("thigh",), "shank", *2 * ("foot",))
        found += [
            _place(robot, BODIES[BODIES.index(f"{side}_{link}")], data.xanchor[number])
            for link, number in zip(links, leg, strict=True)
        ]
    found += WAIST * [_place(robot, "trunk", waist)]
    aside, above = SHOULDER
    for left in (aside, -aside):
        found += ARM * [_place(robot, "trunk", waist + [0.0, left, above])]
    return tuple(found)


def _place(robot: CompiledRobot, body: Body, point: NDArray[np.float64]) -> Place:
    """A point of the world in the axes of a body, as the robot stands."""
    data, number = robot.in_reference_posture(), robot.indices.pushed[BODIES.index(body)]
    x, y, z = (data.xmat[number].reshape(3, 3).T @ (point - data.xipos[number])).round(6).tolist()
    return Place(body, (x + 0.0, y + 0.0, z + 0.0))
