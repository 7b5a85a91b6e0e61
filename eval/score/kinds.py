"""Kinds of suites: what laboratories use, floors that are not level, shifts of one thing each, and all draws.

A suite of terrain has robots that walk forward and are pushed on the floor of their kind, level for one
in eight. Where the robot is by then follows from the speed of its command, and the floor is laid around it.

A shift changes one thing of a push like those of `hard`, 80-200 N s for 0.1 s through the pelvis' CoM of the
nominal robot on a level floor, by further coordinates of its point. The ranges were looked at once, with
two-stage on 64 pushes of another seed.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from ...controllers.model.robot import SAME, Similarity
from ...envs.scenario.distribution import ErrorRanges, PushDistribution
from ...envs.scenario.disturbances import (
    Impactor,
    Payload,
    Platform,
    Slip,
    SteadyForce,
    Trip,
    WaistPull,
    WeightPull,
)
from ...envs.scenario.model_errors import CONTROL_STEP, STEEPEST_SLOPE, ModelErrors
from ...envs.scenario.push import Body, Disturbance, GaitEvent, Push, Side
from ...envs.scenario.scenario import Command, Scenario
from ...envs.scenario.terrain import Stairs
from .draw import (
    BASE,
    DURATIONS,
    FIRST_STEP,
    HARDEST,
    LEVELS,
    TARGETS,
    TRUNK_SHARE,
    Draw,
    Points,
    Standing,
    between,
    harder,
    horizontal,
    pelvis_draw,
    standing_scenario,
    step_side,
    varied_draw,
)

TURN = 2.0 * math.pi


class Laboratory(NamedTuple):
    """Coordinates of a scenario with one of the disturbances that laboratories use, each in [0, 1)."""

    kind: float  # 16 levels: KINDS
    strength: float
    direction: float
    phase: float
    sides: float  # 16 levels: first stance, stance foot of the disturbance, in place or forward
    speed: float
    shape: float  # what else a kind may vary


Maker = Callable[[float, float, float, GaitEvent], Disturbance]  # of strength, psi, shape and the moment


def impact(strength: float, psi: float, shape: float, event: GaitEvent) -> Impactor:
    """80-240 N s of momentum of 12-60 kg at the pelvis; heavy ones are slow."""
    mass = round(12.0 * 5.0**shape, 4)
    return Impactor(mass, round(between((80.0, 240.0), strength) / mass, 4), event, psi)


def weight(strength: float, psi: float, shape: float, event: GaitEvent) -> WeightPull:
    """10-60 kg that hang on a cable for 0.5-1.5 s."""
    return WeightPull(between((10.0, 60.0), strength), event, between((0.5, 1.5), shape), psi)


def waist(strength: float, psi: float, shape: float, event: GaitEvent) -> WaistPull:
    """0.2-0.9 m at up to 0.4-1.6 m/s."""
    return WaistPull(between((0.2, 0.9), strength), between((0.4, 1.6), shape), event, psi)


def steady(strength: float, psi: float, shape: float, event: GaitEvent) -> SteadyForce:
    """60-360 N for 1-4 s."""
    return SteadyForce(between((60.0, 360.0), strength), event, between((1.0, 4.0), shape), psi)


def slip(strength: float, psi: float, shape: float, event: GaitEvent) -> Slip:
    """Friction of 0.2 to 0.02 under the stance sole for 0.4-2 s."""
    friction = round(0.2 * (0.02 / 0.2) ** strength, 4)
    return Slip(event.side, friction, event, between((0.4, 2.0), shape))


def trip(strength: float, psi: float, shape: float, event: GaitEvent) -> Trip:
    """A block of 25 cm that holds the foot with up to 50-800 N for 0.3-1.5 s, in the first half of a step."""
    moment = replace(event, fraction=round(0.5 * event.fraction, 4))
    force, duration = between((50.0, 800.0), strength), between((0.3, 1.5), shape)
    return Trip(moment, height=0.25, force=force, duration=duration)


def payload(strength: float, psi: float, shape: float, event: GaitEvent) -> Payload:
    """4-30 kg that fall by 0.1-1 m onto the trunk, 0.1 m off its axis, to any side."""
    side = round(0.1 * math.cos(psi), 4) + 0.0, round(0.1 * math.sin(psi), 4) + 0.0, 0.1
    return Payload(between((4.0, 30.0), strength), between((0.1, 1.0), shape), event, offset=side)


def platform(strength: float, psi: float, shape: float, event: GaitEvent) -> Platform:
    """0.1-1 m, at up to 0.6-3 m/s, accelerated by 8 m/s^2."""
    way, fastest = between((0.1, 1.0), strength), between((0.6, 3.0), shape)
    return Platform(way, fastest, event, psi, acceleration=8.0)


KINDS: tuple[Maker, ...] = (impact, weight, waist, steady, slip, trip, payload, platform)


def laboratory_scenario(scenario_id: str, u: Laboratory, noise_seed: int) -> Scenario:
    """Scenario of one point, in place or walking forward at up to 0.5 m/s; who trips walks at 0.3 or more."""
    bits, maker = int(u.sides * LEVELS), KINDS[int(u.kind * len(KINDS))]
    event = GaitEvent(FIRST_STEP, "left" if bits & 2 else "right", round(u.phase, 4))
    psi = round((2.0 * u.direction - 1.0) * math.pi, 4)
    disturbance = maker(u.strength, psi, u.shape, event)
    slowest = 0.3 if maker is trip else 0.0
    return Scenario(
        scenario_id,
        disturbances=(disturbance,),
        command=Command(between((slowest, 0.5), u.speed) if slowest or bits & 4 else 0.0),
        stance_side="left" if bits & 1 else "right",
        noise_seed=noise_seed,
    )


class Ground(NamedTuple):
    """Coordinates of a scenario of terrain, each in [0, 1)."""

    floor: float  # 16 levels: FLOORS
    height: float  # how steep or how high
    uphill: float  # direction in which a slope rises, as a share of a turn
    tread: float
    start: float  # of the first step, on every floor of where a robot may be pushed
    place: float  # of the push, from there on
    direction: float
    impulse: float
    speed: float
    sides: float  # 16 levels: body, first stance, steps of a flight


STEP_TIME = 0.32  # of a step of the nominal gait [s]
PUSHED_FOR = 0.1  # [s]
SPEEDS = (0.2, 0.4)  # [m/s]
STARTS, TREADS, PLATEAU = (0.55, 0.8), (0.35, 0.45), 5.0  # [m]
BEYOND_EDGE = 0.1  # of the first step a robot is at least that is pushed: one that keeps behind is on it [m]
FEWEST = 2  # steps of a flight
RISES, TILE_STEPS = (0.02, 0.1), (0.005, 0.03)  # [m]
SLOPES = (0.02, math.floor(1e4 * STEEPEST_SLOPE) / 1e4)  # [rad]


def rising(angle: float, uphill: float) -> ModelErrors:
    """A floor that rises by an angle towards a direction [rad]."""
    forward, left = round(angle * math.cos(uphill), 6), round(angle * math.sin(uphill), 6)
    return ModelErrors(slope_forward=forward, slope_left=left)


def level(u: Ground, steps: int) -> ModelErrors:
    """The plane."""
    return ModelErrors()


def slope(u: Ground, steps: int) -> ModelErrors:
    """It rises by 1.1-5 degrees to any side."""
    return rising(between(SLOPES, u.height), TURN * u.uphill)


def tiles(u: Ground, steps: int) -> ModelErrors:
    """Tiles that are up to 5-30 mm higher than others."""
    return ModelErrors(floor_step=between(TILE_STEPS, u.height))


def sloping_tiles(u: Ground, steps: int) -> ModelErrors:
    """Such tiles on such a slope."""
    return replace(slope(u, steps), floor_step=between(TILE_STEPS, u.height))


def up(u: Ground, steps: int, sign: float = 1.0) -> ModelErrors:
    """Steps of 2-10 cm up to a plateau."""
    rise, start, tread = between(RISES, u.height), between(STARTS, u.start), between(TREADS, u.tread)
    return ModelErrors(terrain=Stairs(sign * rise, steps, start, tread, PLATEAU))


def down(u: Ground, steps: int) -> ModelErrors:
    """Such steps down to one."""
    return up(u, steps, -1.0)


FLOORS: tuple[tuple[Callable[[Ground, int], ModelErrors], int], ...] = (  # and most steps of a flight
    (level, 5), (slope, 5), (tiles, 5), (sloping_tiles, 5), (up, 1), (down, 1), (up, 5), (down, 5),
)  # fmt: skip


def terrain_scenario(scenario_id: str, u: Ground, noise_seed: int, floor_known: bool) -> Scenario:
    """Scenario of one point: a robot that walks forward at v over a floor and is pushed on it once.

    The push, 0.1 s through the CoM of pelvis or trunk and as hard as those of `varied`, comes when a robot
    that keeps to its command is at x = start + 0.1 m + place * steps * tread, in step floor(x / (v
    STEP_TIME)): on the flight where there is one. Values are rounded far below what matters.
    """
    bits, (floor, most) = int(u.sides * LEVELS), FLOORS[int(u.floor * len(FLOORS))]
    body: Body = "trunk" if bits & 1 else "pelvis"
    stance: Side = "left" if bits & 2 else "right"
    speed, steps = between(SPEEDS, u.speed), min(FEWEST + bits // 4, most)
    x = between(STARTS, u.start) + BEYOND_EDGE + u.place * steps * between(TREADS, u.tread)
    phase, index = math.modf(x / (speed * STEP_TIME))
    force = between(TARGETS[body].impulse, u.impulse) / PUSHED_FOR
    psi = (2.0 * u.direction - 1.0) * math.pi
    vector = horizontal(force, psi)
    event = GaitEvent(int(index), step_side(stance, int(index)), round(phase, 4))
    return Scenario(
        scenario_id,
        (Push(vector, PUSHED_FOR, event, body, frame="heading"),),
        Command(speed),
        stance,
        noise_seed=noise_seed,
        errors=replace(floor(u, steps), floor_known=floor_known),
    )


def terrain_draw(floor_known: bool) -> Draw:
    """Scenarios of terrain that control knows, or the same where it does not."""
    return Draw(
        len(Ground._fields),
        lambda name, u, noise_seed: terrain_scenario(name, Ground(*u.tolist()), noise_seed, floor_known),
    )


HARD = PushDistribution(impulse_min=80.0, impulse_max=200.0)
BEYOND = replace(HARD, impulse_min=210.0, impulse_max=250.0)  # no recipe trains beyond 210 N s
REPEATED_SHARE = 0.55  # of the impulse, each of several pushes
MOST_PUSHES, LONGEST_GAP = 5, 3  # of repeated pushes: how many at most, and steps from one to the next
Coordinates = Sequence[float]  # each in [0, 1)


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
    bounds = zip(TARGETS[body].offset_low, TARGETS[body].offset_high, strict=True)
    x, y, z = (between(ends, share) for ends, share in zip(bounds, u[1:], strict=True))
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
        errors = rising(between((0.02, 0.07), along, 6), turn)  # 1-4 degrees
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
        force = horizontal(magnitude, psi)
        moment = GaitEvent(index, step_side(scenario.stance_side, index), event.fraction)
        pushes.append(Push(force, push.duration, moment))
    return replace(scenario, pushes=tuple(pushes))


def _scaled(force: tuple[float, float, float], share: float) -> tuple[float, float, float]:
    x, y, z = (round(share * component, 3) + 0.0 for component in force)
    return x, y, z


@dataclass(frozen=True)
class Shift:
    """A change of pushes, and the coordinates that it takes."""

    change: Callable[[Scenario, Coordinates], Scenario] | None  # None: the ranges alone are others
    coordinates: int  # that the change takes
    seed: int  # of the named suite
    ranges: PushDistribution = HARD

    @property
    def draw(self) -> Draw:
        """Pushes of `ranges` with the change."""
        pushed = pelvis_draw(self.ranges)

        def scenario(name: str, u: Points, noise_seed: int) -> Scenario:
            base = pushed.scenario(name, u[:BASE], noise_seed)
            return base if self.change is None else self.change(base, u[BASE:].tolist())

        return Draw(BASE + self.coordinates, scenario)


SHIFTS: Mapping[str, Shift] = {
    "shift-duration": Shift(longer_or_shorter, 1, 20261201),
    "shift-body": Shift(elsewhere, 4, 20261202),
    "shift-model": Shift(another_robot, 9, 20261205),
    "shift-magnitude": Shift(None, 0, 20261206, BEYOND),
    "shift-floor": Shift(another_floor, 3, 20261207),
    "shift-repeated": Shift(repeated, 3, 20261208),
}


RANGES: Mapping[str, PushDistribution] = {"standard": PushDistribution(), "hard": HARD}
DRAWS: Mapping[str, Draw] = {  # by kind of suite
    **{kind: pelvis_draw(ranges) for kind, ranges in RANGES.items()},
    "varied": varied_draw(),
    "quick": varied_draw(harder(*HARDEST)),
    "standing": Draw(
        len(Standing._fields),
        lambda name, u, noise_seed: standing_scenario(name, Standing(*u.tolist()), noise_seed),
    ),
    "disturbances": Draw(
        len(Laboratory._fields),
        lambda name, u, noise_seed: laboratory_scenario(name, Laboratory(*u.tolist()), noise_seed),
    ),
    "terrain": terrain_draw(True),
    "terrain-blind": terrain_draw(False),
    **{kind: shift.draw for kind, shift in SHIFTS.items()},
}


@dataclass(frozen=True)
class SuiteDistribution:
    """Scenarios like those of some suites, all equally likely, as the suites' own generator draws them.

    Where `errors` are given, the robot's are drawn from them.
    """

    kinds: tuple[str, ...]  # of suites, keys of DRAWS
    settle_time: float  # of the biped [s]
    errors: ErrorRanges | None = None
    size: Similarity = SAME  # of the robot that they are for

    def sample(self, rng: np.random.Generator, scenario_id: str | None = None) -> Scenario:
        """Draw one scenario."""
        kind = self.kinds[int(rng.integers(len(self.kinds)))]
        scenario = replace(DRAWS[kind].sample(rng, scenario_id), settle_time=self.settle_time)
        if self.errors is not None:
            scenario = replace(scenario, errors=self.errors.sample(rng))
        return scenario.scaled(self.size)

    def scaled(self, size: Similarity) -> Self:
        """The same scenarios for a robot of another size."""
        return replace(self, size=size)
