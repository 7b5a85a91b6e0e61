"""The open teleop-walking-benchmark on robots of this package: a tour of 18 waypoints under 18 punches.

Source: github.com/rhoyn/teleop-walking-benchmark, README of 6d331a85 and main.cpp of 2e8b4286, of which the
constants of the README stand where the two differ. Each task is a run id; its waypoints and punches come from
the benchmark's own random streams. A punch of a joint of the G1 acts where `places_of` says.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ...controllers.model.robot import RobotModel
from ...controllers.model.similarity import SAME, Similarity
from ...envs.biped.robots.compiled_robot import CompiledRobot
from ...envs.scenario.push import Push
from ...envs.scenario.scenario import Scenario
from .places import places_of
from .streams import SeededTwister

WAYPOINTS, PUNCHES = 2, 3  # streams
SEGMENTS, SEGMENT = 18, 5.0  # of the tour, and how long each is [s]
LENGTH = SEGMENTS * SEGMENT  # [s]
RADIUS, AHEAD = 1.0, 0.3  # of the disc that waypoints lie in, and how far ahead its centre is [m]
JOINTS = 29  # of the G1: 0-5 left leg, 6-11 right leg, 12-14 waist, 15-21 left arm, 22-28 right arm
FIRST_PUNCH, PUNCH_DURATION = 0.1, 0.08  # [s]
CEILING = 500.0  # of the punches on the G1 [N]
RAMP = 60.0  # time in which the ceiling rises from a third of that to all of it [s]
G1_MASS = 35.112  # [kg]


class Waypoint(NamedTuple):
    """Where the robot is told to stand, in the frame in which it began."""

    x: float  # forward [m]
    y: float  # to the left [m]
    yaw: float  # in (-pi, pi] [rad]


class Punch(NamedTuple):
    """One punch as the benchmark draws it, for the G1."""

    joint: int  # index
    direction: tuple[float, float, float]  # of length 1, world axes
    force: float  # [N]


def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi] [rad]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


def waypoints(run_id: int) -> tuple[Waypoint, ...]:
    """The 18 waypoints of a task."""
    stream, found = SeededTwister(run_id, WAYPOINTS), []
    for _ in range(SEGMENTS):
        radius = RADIUS * math.sqrt(stream.unit())
        bearing, yaw = 2.0 * math.pi * stream.unit(), 2.0 * math.pi * stream.unit()
        x, y = AHEAD + radius * math.cos(bearing), radius * math.sin(bearing)
        found.append(Waypoint(x, y, wrapped(yaw)))
    return tuple(found)


def punch_time(index: int) -> float:
    """When a punch begins [s]."""
    return FIRST_PUNCH + SEGMENT * index


def punches(run_id: int) -> tuple[Punch, ...]:
    """The 18 punches of a task."""
    stream, found = SeededTwister(run_id, PUNCHES), []
    for i in range(SEGMENTS):
        joint, z = stream.below(JOINTS), stream.between(-1.0, 1.0)
        phi, flat = stream.between(0.0, 2.0 * math.pi), math.sqrt(1.0 - z * z)
        ceiling = CEILING * (1.0 / 3.0 + 2.0 / 3.0 * min((punch_time(i) - FIRST_PUNCH) / RAMP, 1.0))
        direction = (flat * math.cos(phi), flat * math.sin(phi), z)
        found.append(Punch(joint, direction, ceiling * stream.between(0.5, 1.0)))
    return tuple(found)


def tour_scenario(run_id: int, robot: CompiledRobot) -> Scenario:
    """The punches of a task on a robot; it is told where to walk while it walks."""
    pushes, places, share = [], places_of(robot), force_share(robot.robot)
    for i, (joint, direction, force) in enumerate(punches(run_id)):
        x, y, z = (round(force * share * part, 3) + 0.0 for part in direction)
        body, offset = places[joint]
        pushes.append(Push((x, y, z), PUNCH_DURATION, round(punch_time(i), 6), body, offset))
    return Scenario(f"tour-{run_id:04d}", tuple(pushes), duration=LENGTH, noise_seed=run_id)


def force_share(robot: RobotModel) -> float:
    """What forces are multiplied by: the ratio of masses on the biped of 60 kg, 1 on robots that exist."""
    return robot.mass / G1_MASS if Similarity.of(robot) == SAME else 1.0


def run_id_of(scenario_id: str) -> int:
    """The task of a scenario of `tour_scenario`."""
    return int(scenario_id.rpartition("-")[2])
