"""The open teleop-walking-benchmark on this project's biped: a tour of 18 waypoints under 18 punches.

Source: github.com/rhoyn/teleop-walking-benchmark, README of 6d331a85 and main.cpp of 2e8b4286, of which the
constants of the README stand where the two differ. Each task is a run id; its waypoints and punches come from
the benchmark's own random streams. Forces are scaled by mass. This robot has no arms and its legs cannot be
pushed, so a punch of a joint of the G1 acts where `PLACES` says.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ...envs.biped.settings import BIPED
from ...envs.scenario.push import Body, Push
from ...envs.scenario.scenario import Scenario
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


class Place(NamedTuple):
    """Where this robot is punched: a body, and an offset from its CoM in the body's axes [m]."""

    body: Body
    offset: tuple[float, float, float]


HIP, SHOULDER = (0.10, -0.07), (0.10, 0.06)  # aside and up; the shoulders 0.24 m over the waist, as the G1's
PLACES = (  # by the last joint of a limb
    (5, Place("pelvis", (0.0, HIP[0], HIP[1]))),
    (11, Place("pelvis", (0.0, -HIP[0], HIP[1]))),
    (14, Place("trunk", (0.0, 0.0, -0.18))),  # the waist
    (21, Place("trunk", (0.0, SHOULDER[0], SHOULDER[1]))),
    (28, Place("trunk", (0.0, -SHOULDER[0], SHOULDER[1]))),
)


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


def place_of(joint: int) -> Place:
    """Where a punch of a joint of the G1 acts on this robot."""
    return next(place for last, place in PLACES if joint <= last)


def tour_scenario(run_id: int, mass: float = BIPED.mass) -> Scenario:
    """The punches of a task on a robot of a mass [kg]; it is told where to walk while it walks."""
    pushes = []
    for i, (joint, direction, force) in enumerate(punches(run_id)):
        x, y, z = (round(force * mass / G1_MASS * part, 3) + 0.0 for part in direction)
        body, offset = place_of(joint)
        pushes.append(Push((x, y, z), PUNCH_DURATION, round(punch_time(i), 6), body, offset))
    return Scenario(f"tour-{run_id:04d}", tuple(pushes), duration=LENGTH, noise_seed=run_id)


def run_id_of(scenario_id: str) -> int:
    """The task of a scenario of `tour_scenario`."""
    return int(scenario_id.rpartition("-")[2])
