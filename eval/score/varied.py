"""Pushes of every kind: where, how long, how often, at which moment of which walk.

A scenario is a point of the unit cube with a coordinate for each field of `Point`. The ranges were chosen on
a draw of another seed, with two arms, so that strong arms lose some pushes and weak arms not all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

from ...envs.scenario.command import FASTEST_TURN, Command
from ...envs.scenario.push import Body, GaitEvent, Push, Side, other_side
from ...envs.scenario.scenario import Scenario
from .stratified import LEVELS, stratified_uniforms

FIRST_STEP = 4  # pushes start no earlier
COUNTS = ("single",) * 8 + ("double",) * 4 + ("repeated",) * 4  # by level
SHARE: dict[str, float] = {"single": 1.0, "double": 0.75, "repeated": 0.55}  # of an impulse, each push
REPEATS, REPEAT_STEPS = 4, 2  # pushes of a repeated one, and steps from one to the next
LATEST_SECOND = 4  # steps after the first push
DURATIONS = (0.02, 0.5)  # uniform in the logarithm [s]


@dataclass(frozen=True)
class Target:
    """Where a body is pushed, and how hard; uniform in each."""

    impulse: tuple[float, float]  # [N s]
    offset_low: tuple[float, float, float]  # point of attack from its CoM, body axes [m]
    offset_high: tuple[float, float, float]  # [m]


Targets = Mapping[Body, Target]
TARGETS: Targets = MappingProxyType(
    {
        "pelvis": Target((50.0, 160.0), (-0.08, -0.10, -0.08), (0.08, 0.10, 0.08)),
        "trunk": Target((30.0, 110.0), (-0.10, -0.16, -0.15), (0.10, 0.16, 0.25)),
    }
)


def harder(pelvis: float, trunk: float) -> Targets:
    """TARGETS with other largest impulses [N s]."""
    largest: dict[Body, float] = {"pelvis": pelvis, "trunk": trunk}
    return {
        body: replace(target, impulse=(target.impulse[0], largest[body])) for body, target in TARGETS.items()
    }


class Walk(NamedTuple):
    """Fastest command of a kind; speeds and turn are drawn from 0 up to it."""

    vx: float = 0.0  # [m/s]
    vy: float = 0.0  # [m/s], to either side
    turn: float = 0.0  # [rad/s], to either side


IN_PLACE, FORWARD, BACKWARD, SIDEWAYS = Walk(), Walk(0.6), Walk(-0.3), Walk(0.0, 0.25)
WALKS = (  # by level
    *[IN_PLACE] * 4, *[FORWARD] * 3, BACKWARD,
    *[SIDEWAYS] * 2, Walk(0.6, 0.2), Walk(-0.3, 0.2),
    Walk(turn=FASTEST_TURN), *[Walk(0.6, turn=FASTEST_TURN)] * 2, Walk(-0.3, turn=FASTEST_TURN),
)  # fmt: skip


class Point(NamedTuple):
    """Coordinates of a scenario in the unit cube, each in [0, 1)."""

    direction: float
    impulse: float
    phase: float
    duration: float
    sides: float  # 16 levels: body, first stance, stance of the push, side of the command
    pushes: float  # 16 levels: COUNTS
    walk: float  # 16 levels: WALKS
    speed: float
    turn: float
    offset_x: float
    offset_y: float
    offset_z: float
    second_direction: float
    second_time: float


FACTORS = len(Point._fields)


def varied_scenarios(name: str, blocks: int, seed: int, targets: Targets = TARGETS) -> tuple[Scenario, ...]:
    """256 scenarios a block, every pair of factors stratified in each."""
    points = stratified_uniforms(blocks, FACTORS, seed).tolist()
    return tuple(varied_scenario(f"{name}-{i:04d}", Point(*u), i, targets) for i, u in enumerate(points))


def varied_scenario(scenario_id: str, u: Point, noise_seed: int, targets: Targets = TARGETS) -> Scenario:
    """Scenario of one point; values are rounded far below what matters, as in `stratified_scenario`."""
    bits = int(u.sides * LEVELS)
    stance: Side = "left" if bits & 2 else "right"
    event = GaitEvent(FIRST_STEP, "left" if bits & 4 else "right", round(u.phase, 4))
    return Scenario(
        id=scenario_id,
        pushes=_pushes(u, "trunk" if bits & 1 else "pelvis", event, stance, targets),
        command=_command(u, to_left=bool(bits & 8)),
        stance_side=stance,
        noise_seed=noise_seed,
    )


def count_of(scenario: Scenario) -> str:
    """How often the scenario pushes: one of COUNTS, or none."""
    return {0: "none", 1: "single", 2: "double"}.get(len(scenario.pushes), "repeated")


def walk_of(scenario: Scenario) -> str:
    """What the robot is told at the start: in place, turning, sideways (also aslant), forward or backward."""
    command = scenario.command
    if command.turn:
        return "turning"
    if command.vy:
        return "sideways"
    return "in place" if not command.vx else "forward" if command.vx > 0.0 else "backward"


def _command(u: Point, to_left: bool) -> Command:
    """Command of the point, sideways and turning to one side."""
    walk, sign = WALKS[int(u.walk * LEVELS)], 1.0 if to_left else -1.0
    vx, vy, turn = u.speed * walk.vx, sign * u.speed * walk.vy, sign * u.turn * walk.turn
    return Command(*(round(value, 4) + 0.0 for value in (vx, vy, turn)))  # + 0.0: no -0.0


def _pushes(u: Point, body: Body, event: GaitEvent, stance: Side, targets: Targets) -> tuple[Push, ...]:
    """The pushes of a point: equal in force, duration and place, in the robot's frame."""
    target, count = targets[body], COUNTS[int(u.pushes * LEVELS)]
    shortest, longest = DURATIONS
    duration = round(shortest * (longest / shortest) ** u.duration, 4)
    low, high = target.impulse
    force = SHARE[count] * (low + u.impulse * (high - low)) / duration
    shares = zip((u.offset_x, u.offset_y, u.offset_z), target.offset_low, target.offset_high, strict=True)
    x, y, z = (round(least + share * (most - least), 4) for share, least, most in shares)
    pushes = []
    for moment, turn in _moments(u, count, event, stance):
        psi = (2.0 * turn - 1.0) * math.pi
        vector = (round(force * math.cos(psi), 3), round(force * math.sin(psi), 3), 0.0)
        pushes.append(Push(vector, duration, moment, body, (x, y, z), "heading"))
    return tuple(pushes)


def _moments(u: Point, count: str, event: GaitEvent, stance: Side) -> list[tuple[GaitEvent, float]]:
    """When each push starts, and its direction as a share of a turn."""
    moments, first = [(event, u.direction)], event.step_index(stance)
    if count == "double":
        later, fraction = divmod(u.second_time * LATEST_SECOND, 1.0)
        index = first + 1 + int(later)
        moments.append((GaitEvent(index, step_side(stance, index), round(fraction, 4)), u.second_direction))
    elif count == "repeated":
        for index in range(first + REPEAT_STEPS, first + REPEATS * REPEAT_STEPS, REPEAT_STEPS):
            moments.append((GaitEvent(index, step_side(stance, index), event.fraction), u.direction))
    return moments


def step_side(stance: Side, index: int) -> Side:
    """Stance side of the step with this index, where step 0 stands on `stance`."""
    return stance if index % 2 == 0 else other_side(stance)
