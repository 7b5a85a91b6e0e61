"""How suites are drawn: stratified points, and pushes of every kind on robots that walk or stand.

Points fill a unit cube evenly: every pair of factors has every pair of levels once. A scenario of every kind
of push has a coordinate for each field of `Point`; its ranges were chosen on a draw of another seed, with two
policies, so that strong ones lose some pushes and weak ones not all.

A scenario of standing has a coordinate for each field of `Standing`. Its pushes are shares of F*_stand of the
robot that suites are made for, from what ankles catch up to twice what can be caught without a step.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.robot import REFERENCE, RobotModel
from ...controllers.model.standing import Feet, max_standing_force
from ...envs.scenario.distribution import COMMAND_KINDS, PushDistribution
from ...envs.scenario.push import Body, GaitEvent, Push, Side, other_side
from ...envs.scenario.scenario import AT_REST, FASTEST_TURN, Command, Scenario

LEVELS = 16  # of each factor
BLOCK = LEVELS**2  # scenarios in which every pair of factors has every pair of levels once
BASE = 5  # coordinates of a push at the pelvis
ForceOf = Callable[[float, float, str], float]  # [N], of a share in [0, 1], psi and the stance side
Points = NDArray[np.float64]  # in the unit cube, or one of them


def gf16_multiply(a: int, b: int) -> int:
    """Product in the field of 16 elements, modulo x^4 + x + 1."""
    product = 0
    while b:
        if b & 1:
            product ^= a
        a, b = a << 1, b >> 1
        if a & 16:
            a ^= 0b10011
    return product


def orthogonal_array(factors: int) -> np.ndarray:
    """Strength-2 orthogonal array (256, factors) of 16 levels (Bush 1952), up to 17 factors.

    Row (a, b) holds a, b, a + b, a + 2 b, ... in the field of 16 elements: any two columns take each of the
    256 pairs of levels exactly once.
    """
    pairs = product(range(LEVELS), repeat=2)
    rows = [[a, *(b if k == 0 else a ^ gf16_multiply(k, b) for k in range(factors - 1))] for a, b in pairs]
    return np.array(rows, dtype=np.int64)


def uniforms(generator: np.random.PCG64, *shape: int) -> np.ndarray:
    """Uniforms in [0, 1) from raw bits, whose stream numpy guarantees across versions."""
    raw = np.asarray(generator.random_raw(math.prod(shape)), dtype=np.uint64)
    return ((raw >> np.uint64(11)).astype(np.float64) * 2.0**-53).reshape(shape)


def stratified_uniforms(blocks: int, factors: int, seed: int) -> np.ndarray:
    """Points (256 blocks, factors) in the unit cube, stratified in every block of 256.

    In each block every pair of factors falls once into each of 16 x 16 cells, and each factor once into each
    of 256 intervals; over all blocks each factor falls once into each of 256 x blocks intervals.
    """
    generator = np.random.PCG64(np.random.SeedSequence(seed))
    array = orthogonal_array(factors)
    quarter = np.argsort(uniforms(generator, factors, blocks), axis=1)  # of the finest interval, by block
    points = np.empty((blocks, BLOCK, factors))
    for block in range(blocks):
        order = np.argsort(uniforms(generator, BLOCK))
        for factor in range(factors):
            level = np.argsort(uniforms(generator, LEVELS))[array[:, factor]]
            rank = np.empty(BLOCK, dtype=np.int64)
            for value in range(LEVELS):
                rank[level == value] = np.argsort(uniforms(generator, LEVELS))
            inner = (quarter[factor, block] + uniforms(generator, BLOCK)) / blocks
            points[block, :, factor] = ((level + (rank + inner) / LEVELS) / LEVELS)[order]
    return points.reshape(-1, factors)


@dataclass(frozen=True)
class Draw:
    """How scenarios of one kind are drawn: each is made of a point of the unit cube."""

    coordinates: int
    scenario: Callable[[str, Points, int], Scenario]  # of an id, a point (coordinates,) and the noise seed

    def stratified(self, name: str, blocks: int, seed: int) -> tuple[Scenario, ...]:
        """256 scenarios a block, every pair of factors stratified in each."""
        points = stratified_uniforms(blocks, self.coordinates, seed)
        return tuple(self.scenario(f"{name}-{i:04d}", u, i) for i, u in enumerate(points))

    def sample(self, rng: np.random.Generator, scenario_id: str | None = None) -> Scenario:
        """One scenario of a point that is uniform in the cube, whatever was drawn before."""
        noise_seed = int(rng.integers(2**31))
        point = rng.random(self.coordinates)
        return self.scenario(scenario_id or f"random-{noise_seed:08x}", point, noise_seed)


def between(bounds: tuple[float, float], u: float, digits: int = 4) -> float:
    """The point of a range at a share u in [0, 1), rounded far below what matters."""
    low, high = bounds
    return round(low + u * (high - low), digits) + 0.0  # no -0.0


def horizontal(magnitude: float, psi: float) -> tuple[float, float, float]:
    """A horizontal force towards psi [rad], rounded far below what matters."""
    return round(magnitude * math.cos(psi), 3) + 0.0, round(magnitude * math.sin(psi), 3) + 0.0, 0.0


def uniform_force(ranges: PushDistribution) -> ForceOf:
    """Forces whose impulse is uniform in the range of a distribution, all round."""

    def force_of(share: float, _psi: float, _side: str) -> float:
        return (ranges.impulse_min + share * (ranges.impulse_max - ranges.impulse_min)) / ranges.push_duration

    return force_of


def stratified_scenario(
    scenario_id: str, ranges: PushDistribution, force_of: ForceOf, u: np.ndarray, noise_seed: int
) -> Scenario:
    """Scenario of one stratified point: direction, force, phase, command speed, kind and sides.

    Values are rounded far below what matters so that the content does not hang on a platform's libm.
    """
    category = int(u[4] * LEVELS)  # 4 kinds of command x side of the push x first stance side
    side = "left" if category & 4 else "right"
    psi = (2 * u[0] - 1) * math.pi
    force = force_of(u[1], psi, side)
    vector = horizontal(force, psi)
    event = GaitEvent(ranges.first_step, side, round(u[2] * ranges.phase_max, 4))
    signed = 2 * u[3] - 1
    speed = abs(signed) if COMMAND_KINDS[category & 3] == "sideways" else u[3]
    return Scenario(
        id=scenario_id,
        pushes=(Push(vector, ranges.push_duration, event),),
        command=ranges.command(category & 3, round(speed, 4), bool(signed > 0)),
        stance_side="left" if category & 8 else "right",
        settle_time=ranges.settle_time,
        noise_seed=noise_seed,
    )


def pelvis_draw(ranges: PushDistribution) -> Draw:
    """One push each from `ranges`, through the CoM of the pelvis."""
    force = uniform_force(ranges)
    return Draw(BASE, lambda name, u, noise_seed: stratified_scenario(name, ranges, force, u, noise_seed))


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
TARGETS: Targets = {
    "pelvis": Target((50.0, 160.0), (-0.08, -0.10, -0.08), (0.08, 0.10, 0.08)),
    "trunk": Target((30.0, 110.0), (-0.10, -0.16, -0.15), (0.10, 0.16, 0.25)),
}


HARDEST = 200.0, 140.0  # impulses of `quick` at the pelvis and at the trunk [N s]


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


def varied_draw(targets: Targets = TARGETS) -> Draw:
    """Pushes of every kind on robots that walk."""
    return Draw(
        len(Point._fields),
        lambda name, u, noise_seed: varied_scenario(name, Point(*u.tolist()), noise_seed, targets),
    )


def varied_scenario(scenario_id: str, u: Point, noise_seed: int, targets: Targets = TARGETS) -> Scenario:
    """Scenario of one point; values are rounded far below what matters, as in `stratified_scenario`."""
    bits = int(u.sides * LEVELS)
    stance: Side = "left" if bits & 2 else "right"
    event = GaitEvent(FIRST_STEP, "left" if bits & 4 else "right", round(u.phase, 4))
    walk, sign = WALKS[int(u.walk * LEVELS)], 1.0 if bits & 8 else -1.0
    velocity = u.speed * walk.vx, sign * u.speed * walk.vy, sign * u.turn * walk.turn
    vx, vy, turn = (round(value, 4) + 0.0 for value in velocity)  # + 0.0: no -0.0
    return Scenario(
        id=scenario_id,
        pushes=_pushes(u, "trunk" if bits & 1 else "pelvis", event, stance, targets),
        command=Command(vx, vy, turn),
        stance_side=stance,
        noise_seed=noise_seed,
    )


def count_of(scenario: Scenario) -> str:
    """How often the scenario pushes: one of COUNTS, or none."""
    return {0: "none", 1: "single", 2: "double"}.get(len(scenario.forces), "repeated")


def walk_of(scenario: Scenario) -> str:
    """Command at the start: turning, sideways (also aslant), in place, forward or backward."""
    command = scenario.command
    if command.turn or command.vy:
        return "turning" if command.turn else "sideways"
    return "in place" if not command.vx else "forward" if command.vx > 0.0 else "backward"


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
        vector = horizontal(force, psi)
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


class Standing(NamedTuple):
    """Coordinates of a scenario of a robot that stands, each in [0, 1)."""

    direction: float
    share: float  # of F*_stand
    time: float
    duration: float
    sides: float  # 16 levels: body, stance foot, feet side by side or astride, direction of later pushes
    pushes: float  # 16 levels: COUNTS
    stride: float
    pause: float
    second_direction: float
    offset_x: float
    offset_y: float
    offset_z: float


TRUNK_SHARE = 0.6  # of the pelvis' impulse: 48-120 N s, after which about as many robots stand
STANDING_SHARES = (0.4, 2.0)  # of F*_stand, of the first push or of the only one
STANDING_TIMES, PAUSES = (0.5, 1.5), (0.5, 2.0)  # of the first push, and from one to the next [s]
STRIDES = (-0.25, 0.25)  # of feet astride [m]


def feet_at_first(robot: RobotModel, stance: Side, stride: float) -> Feet:
    """Where the feet of a robot that stands are at first, from its stance foot, in the world's axes."""
    return Feet((stride, -robot.pelvis_width if stance == "left" else robot.pelvis_width))


def standing_scenario(scenario_id: str, u: Standing, noise_seed: int) -> Scenario:
    """Scenario of one point; values are rounded far below what matters, as in `stratified_scenario`.

    A push at the trunk has TRUNK_SHARE of the force, each of several pushes SHARE of it.
    """
    bits, count = int(u.sides * LEVELS), COUNTS[int(u.pushes * LEVELS)]
    body: Body = "trunk" if bits & 1 else "pelvis"
    stance: Side = "left" if bits & 2 else "right"
    stride = between(STRIDES, u.stride) if bits & 4 else 0.0
    shortest, longest = DURATIONS
    duration = round(shortest * (longest / shortest) ** u.duration, 4)
    feet = feet_at_first(REFERENCE, stance, stride)
    low, high = STANDING_SHARES
    share = SHARE[count] * (low + u.share * (high - low)) * (TRUNK_SHARE if body == "trunk" else 1.0)
    ranges = zip(u[-3:], TARGETS[body].offset_low, TARGETS[body].offset_high, strict=True)
    x, y, z = (between((least, most), along) for along, least, most in ranges)
    first, pause = between(STANDING_TIMES, u.time), between(PAUSES, u.pause)
    later = u.second_direction if count == "double" else u.direction
    pushes = []
    for i in range({"single": 1, "double": 2, "repeated": REPEATS}[count]):
        psi = (2.0 * (later if i else u.direction) - 1.0) * math.pi
        force = share * max_standing_force(REFERENCE, psi, duration, feet=feet)
        vector = horizontal(force, psi)
        pushes.append(Push(vector, duration, round(first + i * pause, 4), body, (x, y, z), "heading"))
    return Scenario(scenario_id, tuple(pushes), AT_REST, stance, noise_seed=noise_seed, stride=stride)
