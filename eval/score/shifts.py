"""Pushes that differ from those that learned policies are trained on in one thing each.

The base of every shift is a push like those of `hard`, 80-200 N s for 0.1 s through the pelvis' CoM of the
nominal robot on a level floor. A shift takes such a scenario and further coordinates of its point in the unit
cube, and changes one thing. The ranges were looked at once, with two-stage on 64 pushes of another seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from ...envs.scenario.model_errors import ModelErrors
from ...envs.scenario.physics_options import CONTROL_STEP
from ...envs.scenario.push import Body, GaitEvent, Push
from ...envs.scenario.push_distribution import PushDistribution
from ...envs.scenario.scenario import Scenario
from .stratified import stratified_scenario, stratified_uniforms, uniform_force
from .varied import DURATIONS, TARGETS, step_side

HARD = PushDistribution(impulse_min=80.0, impulse_max=200.0)
BEYOND = replace(HARD, impulse_min=210.0, impulse_max=250.0)  # no recipe trains beyond 210 N s
BASE = 5  # coordinates of the push that is shifted
TRUNK_SHARE = 0.6  # of the pelvis' impulse: 48-120 N s, after which about as many robots stand
REPEATED_SHARE = 0.55  # of the impulse, each of several pushes
MOST_PUSHES, LONGEST_GAP = 5, 3  # of repeated pushes: how many at most, and steps from one to the next
TURN = 2.0 * math.pi

Coordinates = Sequence[float]  # each in [0, 1)
Range = tuple[float, float]


def between(bounds: Range, u: float, digits: int = 4) -> float:
    """The point of a range at a share u in [0, 1), rounded far below what matters."""
    low, high = bounds
    return round(low + u * (high - low), digits) + 0.0  # no -0.0


def longer_or_shorter(scenario: Scenario, u: Coordinates) -> Scenario:
    """The same impulse within 0.02-0.5 s, uniform in the logarithm."""
    (push,) = scenario.pushes
    shortest, longest = DURATIONS
    duration = round(shortest * (longest / shortest) ** u[0], 4)
    force = _scaled(push.force, push.duration / duration)
    return replace(scenario, pushes=(replace(push, force=force, duration=duration),))


def elsewhere(scenario: Scenario, u: Coordinates) -> Scenario:
    """Half at the trunk with TRUNK_SHARE of the impulse, half at the pelvis; off the body's CoM."""
    (push,) = scenario.pushes
    body: Body = "trunk" if u[0] < 0.5 else "pelvis"
    low, high = TARGETS[body].offset_low, TARGETS[body].offset_high
    x, y, z = (
        between(bounds, share) for bounds, share in zip(zip(low, high, strict=True), u[1:], strict=True)
    )
    force = _scaled(push.force, TRUNK_SHARE) if body == "trunk" else push.force
    return replace(scenario, pushes=(replace(push, force=force, body=body, offset=(x, y, z)),))


def another_robot(scenario: Scenario, u: Coordinates) -> Scenario:
    """Other mass, CoM and losses, late torques and a noisy DCM, all of them at once."""
    x, y, z = (between((-0.03, 0.03), share) for share in u[2:5])
    errors = ModelErrors(
        mass=between((-0.15, 0.15), u[0]),
        payload=between((0.0, 8.0), u[1]),
        trunk_com=(x, y, z),
        joint_friction=between((0.0, 1.5), u[5]),
        armature=between((0.0, 0.04), u[6]),
        delay=round(int(u[7] * 5) * CONTROL_STEP, 6),  # 0-8 ms
        dcm_noise=between((0.0, 0.004), u[8]),
    )
    return replace(scenario, errors=errors)


def another_floor(scenario: Scenario, u: Coordinates) -> Scenario:
    """A third each: slippery, sloping to any side, or of tiles of different height."""
    kind, along, turn = int(3.0 * u[0]), u[1], TURN * u[2]
    if kind == 0:
        errors = ModelErrors(friction=between((0.3, 0.6), along))
    elif kind == 1:
        slope = between((0.02, 0.07), along, 6)  # 1-4 degrees
        errors = ModelErrors(
            slope_forward=round(slope * math.cos(turn), 6), slope_left=round(slope * math.sin(turn), 6)
        )
    else:
        errors = ModelErrors(floor_step=between((0.005, 0.02), along))
    return replace(scenario, errors=errors)


def repeated(scenario: Scenario, u: Coordinates) -> Scenario:
    """Two to five pushes of REPEATED_SHARE each, one to three steps apart, each turned by the same angle."""
    (push,) = scenario.pushes
    count, gap = 2 + int(u[0] * (MOST_PUSHES - 1)), 1 + int(u[1] * LONGEST_GAP)
    turn, event = TURN * u[2], push.start
    assert isinstance(event, GaitEvent)  # noqa: S101
    magnitude = REPEATED_SHARE * math.hypot(*push.force)
    first, pushes = event.step_index(scenario.stance_side), []
    for i in range(count):
        index, psi = first + i * gap, push.direction + i * turn
        force = (round(magnitude * math.cos(psi), 3), round(magnitude * math.sin(psi), 3), 0.0)
        moment = GaitEvent(index, step_side(scenario.stance_side, index), event.fraction)
        pushes.append(Push(force, push.duration, moment))
    return replace(scenario, pushes=tuple(pushes))


def _scaled(force: tuple[float, float, float], share: float) -> tuple[float, float, float]:
    x, y, z = (round(share * component, 3) + 0.0 for component in force)
    return x, y, z


@dataclass(frozen=True)
class Shift:
    """What is changed of a push, and from which coordinates."""

    change: Callable[[Scenario, Coordinates], Scenario] | None  # None: the ranges alone are others
    coordinates: int  # that the change takes
    seed: int  # of the named suite
    ranges: PushDistribution = HARD


SHIFTS: Mapping[str, Shift] = MappingProxyType(
    {
        "shift-duration": Shift(longer_or_shorter, 1, 20261201),
        "shift-body": Shift(elsewhere, 4, 20261202),
        "shift-model": Shift(another_robot, 9, 20261205),
        "shift-magnitude": Shift(None, 0, 20261206, BEYOND),
        "shift-floor": Shift(another_floor, 3, 20261207),
        "shift-repeated": Shift(repeated, 3, 20261208),
    }
)


def shifted_scenarios(kind: str, name: str, blocks: int, seed: int) -> tuple[Scenario, ...]:
    """256 scenarios a block of a kind of SHIFTS, every pair of factors stratified in each."""
    shift = SHIFTS[kind]
    force = uniform_force(shift.ranges)
    drawn = []
    for i, u in enumerate(stratified_uniforms(blocks, BASE + shift.coordinates, seed)):
        scenario = stratified_scenario(f"{name}-{i:04d}", shift.ranges, force, u[:BASE], i)
        drawn.append(scenario if shift.change is None else shift.change(scenario, u[BASE:].tolist()))
    return tuple(drawn)
