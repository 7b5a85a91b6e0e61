"""The benchmark's way to a waypoint: velocity proportional to what is missing, within a robot's limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...envs.scenario.command import FASTEST_TURN
from .tour import Waypoint, wrapped

GAIN = 1.5  # of position and of heading [1/s]
REACHED, LOST = (0.10, 0.05), (0.20, 0.12)  # distance [m], heading [rad]
SLOWEST_X, FASTEST_X, FASTEST_Y = -0.25, 0.5, 0.2  # that a robot of 0.8 m is told to walk [m/s]


@dataclass(frozen=True)
class Pose:
    """Place [m] and heading [rad] of the pelvis over the floor."""

    x: float
    y: float
    yaw: float


def missing(pose: Pose, target: Waypoint) -> tuple[float, float, float]:
    """Position error in the heading's frame, forward and to the left [m], and heading error [rad]."""
    east, north = target.x - pose.x, target.y - pose.y
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return cos * east + sin * north, cos * north - sin * east, wrapped(target.yaw - pose.yaw)


def in_frame(pose: Pose, origin: Pose) -> Pose:
    """A pose as seen from another one."""
    x, y, yaw = missing(origin, Waypoint(pose.x, pose.y, pose.yaw))
    return Pose(x, y, yaw)


class Follower:
    """Tells one robot how to walk to one waypoint after the other.

    A waypoint counts as reached until it is lost again by more than the bounds of REACHED; meanwhile nothing
    is asked. Position and heading are reached each for itself.

    Args:
        velocity: of the robot against one whose CoM is 0.8 m high.
    """

    def __init__(self, velocity: float = 1.0) -> None:
        self._slowest_x, self._fastest_x, self._fastest_y = (
            velocity * speed for speed in (SLOWEST_X, FASTEST_X, FASTEST_Y)
        )
        self._target: Waypoint | None = None
        self._there = [False, False]  # position, heading

    def command(self, pose: Pose, target: Waypoint) -> tuple[float, float, float]:
        """Velocity forward and to the left [m/s] and turn [rad/s]."""
        if target != self._target:
            self._target, self._there = target, [False, False]
        forward, left, turn = missing(pose, target)
        for i, error in enumerate((math.hypot(forward, left), abs(turn))):
            bound = LOST[i] if self._there[i] else REACHED[i]
            self._there[i] = error < bound
        walk, face = (0.0 if there else GAIN for there in self._there)
        return (
            min(max(walk * forward, self._slowest_x), self._fastest_x),
            min(max(walk * left, -self._fastest_y), self._fastest_y),
            min(max(face * turn, -FASTEST_TURN), FASTEST_TURN),
        )
