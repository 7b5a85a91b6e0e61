"""Disturbances that laboratories use, each made of pushes that follow a `Law`.

All of them start at a time or at an event of the gait. Directions are counter-clockwise from the robot's
forward at that moment. The impulse by which one is reported is nominal, as its class says; what it delivered
is measured (`Pushes.delivered`, `info["delivered"]`, `delivered` of a row).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple, Self

from ...controllers.errors import InvalidValueError
from ...controllers.model.robot import GRAVITY, Similarity
from ...controllers.validation import (
    require_choice,
    require_keys,
    require_kind,
    require_number,
    require_vector,
)
from .model_errors import CONTROL_STEP
from .push import (
    DURATION_MAX,
    FORCE_MAX,
    OFFSET_MAX,
    SIDES,
    TIME_MAX,
    Body,
    Coupling,
    Disturbance,
    FloorShift,
    FloorTilt,
    GaitEvent,
    Grip,
    Push,
    Ramp,
    Side,
    Vector,
    mirrored_body,
    mirrored_start,
    mirrored_vector,
    other_side,
    read_disturbance,
    register_disturbance,
    require_body,
    scaled_start,
)
from .record import Quantities, Quantity, checked, object_of, resized

__all__ = [
    "Impactor", "Payload", "Platform", "Slip", "SteadyForce", "TiltingPlatform", "Trip", "WaistPull",
    "WeightPull", "read_disturbance",
]  # fmt: skip

CENTRE: Vector = (0.0, 0.0, 0.0)
ANGLE = Quantity("rad", -2.0 * math.pi, 2.0 * math.pi)
DURATION = Quantity("s", CONTROL_STEP, DURATION_MAX, "time")
STIFFNESS, DAMPING = Quantity("N/m", 1.0, 1e5, "stiffness"), Quantity("N s/m", 0.0, 1e3, "viscosity")
TRAVEL, ACCELERATION = Quantity("m", 1e-3, 2.0, "length"), Quantity("m/s^2", 0.01, 100.0)
SPEED = Quantity("m/s", 1e-3, 10.0, "velocity")
STEEPEST = 0.5  # sqrt(k / m) dt / e of a contact, at most: an explicit step that gains no energy


class Shift(NamedTuple):
    """A way, gone from rest to rest: evenly accelerated, at most at `fastest`, evenly slowed down."""

    travel: float  # [m]
    fastest: float  # [m/s]
    acceleration: float  # [m/s^2]

    @property
    def duration(self) -> float:
        """How long it takes: D / v + v / a, or 2 sqrt(D / a) where v is not reached [s]."""
        way, speed, acceleration = self
        if speed * speed >= way * acceleration:
            return 2.0 * math.sqrt(way / acceleration)
        return way / speed + speed / acceleration


class Apparatus(Disturbance):
    """A disturbance of named quantities: what to check, to mirror and to scale follows from the fields.

    `quantities` has the numbers; `start`, `direction`, `body`, `side` and `offset` are what they are called
    in every kind.
    """

    quantities: ClassVar[Quantities]
    start: Any  # seconds from reset, or a moment of the gait

    def __post_init__(self) -> None:
        kind = type(self).__name__
        self._set(**checked(kind, self, self.quantities))
        if not isinstance(self.start, GaitEvent):
            self._set(start=require_number(f"{kind}.start [s]", self.start, 0.0, TIME_MAX))
        checks = {
            "body": require_body,
            "side": lambda value: require_choice("side", value, SIDES),
            "offset": lambda value: self._set(offset=require_vector(f"{kind}.offset [m]", value, OFFSET_MAX)),
        }
        for name in self._own(checks):
            checks[name](getattr(self, name))

    def _own(self, names: Any) -> list[str]:
        return [entry.name for entry in fields(self) if entry.name in names]  # type: ignore[arg-type]

    def mirrored(self) -> Self:
        """Reflection in the x-z plane."""
        changes: dict[str, Any] = {
            "start": mirrored_start,
            "direction": lambda angle: 0.0 - angle,
            "body": mirrored_body,
            "side": other_side,
            "offset": mirrored_vector,
        }
        return self._changed({name: changes[name](getattr(self, name)) for name in self._own(changes)})

    def scaled(self, scale: Similarity) -> Self:
        """The same disturbance for a robot of another size; a gait event stays."""
        values: dict[str, Any] = dict(resized(self, self.quantities, scale))
        values["start"] = scaled_start(self.start, scale)
        for name in self._own(["offset"]):
            values[name] = tuple(scale.length * x for x in getattr(self, name))
        return self._changed(values)

    def _changed(self, values: Mapping[str, Any]) -> Self:
        return replace(self, **values)  # type: ignore[type-var]

    @classmethod
    def _parsed(cls, name: str, value: Any) -> Any:
        return object_of(GaitEvent, value) if name == "start" else super()._parsed(name, value)


def towards(direction: float, size: float = 1.0) -> Vector:
    """A horizontal vector, the direction counter-clockwise from x [rad]."""
    return size * math.cos(direction), size * math.sin(direction), 0.0


def require_soft(kind: str, mass: float, stiffness: float, restitution: float = 1.0) -> None:
    """Raise InvalidValueError for a contact that is over within too few steps of control."""
    hardest = mass * (STEEPEST * restitution / CONTROL_STEP) ** 2
    if stiffness > hardest:
        raise InvalidValueError(
            f"{kind}.stiffness [N/m] must be at most {hardest:g} with {mass:g} kg and restitution "
            f"{restitution:g}, since forces are held for {CONTROL_STEP:g} s, got {stiffness:g}"
        )


def require_hold(kind: str, ways: float, hold: float) -> None:
    """Raise InvalidValueError for a hold [s] that lasts too long beside the time of all `ways` [s]."""
    if ways + hold > DURATION_MAX:
        raise InvalidValueError(
            f"{kind}.hold [s] must be at most {DURATION_MAX - ways:g} with {ways:g} s of motion, since "
            f"disturbances end after {DURATION_MAX:g} s, got {hold:g}"
        )


@register_disturbance
@dataclass(frozen=True)
class Impactor(Apparatus):
    """A guided mass m that hits a body at a speed v through a pad of stiffness k and restitution e.

    Against a wall it would be in contact for T = (pi / 2) sqrt(m / k) (1 + e), and give m v (1 + e); what a
    robot gets of it, m (v - v'), hangs on how it gives way. The nominal impulse is the momentum m v.
    """

    json_name = "impactor"
    quantities: ClassVar[Quantities] = {
        "mass": Quantity("kg", 0.1, 1000.0, "mass"),
        "speed": Quantity("m/s", 0.01, 20.0, "velocity"),
        "direction": ANGLE,
        "stiffness": STIFFNESS,
        "restitution": Quantity("", 0.3, 0.9),
    }

    mass: float  # [kg]
    speed: float  # [m/s]
    start: float | GaitEvent  # of the contact, since reset [s]
    direction: float = 0.0  # in which it flies [rad]
    body: Body | str = "pelvis"
    offset: Vector = CENTRE  # of the pad from the body's CoM, body axes [m]
    stiffness: float = 2e4  # of the pad [N/m]
    restitution: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require_soft("Impactor", self.mass, self.stiffness, self.restitution)

    @classmethod
    def pendulum(
        cls, mass: float, length: float, distance: float, start: float | GaitEvent, **rest: Any
    ) -> Self:
        """A mass on a cable, drawn back by a horizontal distance d and let go, as in RoboCup's contest.

        It hits at the lowest point, with v = sqrt(2 g h), h = l - sqrt(l^2 - d^2).

        Args:
            mass: [kg].
            length: l of the cable [m].
            distance: d over the floor, at most l [m].
            start: of the contact.
            rest: other fields.

        Raises:
            UnknownNameError: there is no other field of that name.
            InvalidValueError: an impossible value.
        """
        own = {"mass", "speed", "start"}
        require_keys("Impactor.pendulum", rest, set(), {entry.name for entry in fields(cls)} - own)
        length = require_number("pendulum's length [m]", length, 0.01, 100.0)
        distance = require_number("pendulum's distance [m]", distance, 0.0, length, open_low=True)
        height = length - math.sqrt(length**2 - distance**2)
        return cls(mass, math.sqrt(2.0 * GRAVITY * height), start, **rest)

    @property
    def momentum(self) -> float:
        """Mass times speed [N s]."""
        return self.mass * self.speed

    @property
    def contact_time(self) -> float:
        """T against a wall [s]; against what gives way it is shorter."""
        return 0.5 * math.pi * math.sqrt(self.mass / self.stiffness) * (1.0 + self.restitution)

    @property
    def forces(self) -> tuple[Push, ...]:
        """One, for twice T, after which it is held back."""
        time = 2.0 * self.contact_time
        law = Coupling(self.stiffness, self.mass, self.speed, restitution=self.restitution)
        force = towards(self.direction, self.momentum / time)
        return (Push(force, time, self.start, self.body, self.offset, "heading", law),)


@register_disturbance
@dataclass(frozen=True)
class WeightPull(Apparatus):
    """A weight that falls and pulls a body by a cable over a pulley, until it is cut loose.

    The cable is a spring k with a damper c that cannot push. The nominal force is the weight's, m g.
    """

    json_name = "weight pull"
    quantities: ClassVar[Quantities] = {
        "mass": Quantity("kg", 0.1, 1000.0, "mass"),
        "duration": DURATION,
        "direction": ANGLE,
        "drop": Quantity("m", 0.0, 2.0, "length"),
        "reach": Quantity("m", 0.5, 100.0, "length"),
        "stiffness": STIFFNESS,
        "damping": DAMPING,
    }

    mass: float  # [kg]
    start: float | GaitEvent  # when the weight is let go, since reset [s]
    duration: float  # after which it is cut loose [s]
    direction: float = 0.0  # of the pull [rad]
    drop: float = 0.0  # by which the weight falls before the cable is taut [m]
    reach: float = 3.0  # from the body to the pulley [m]
    body: Body | str = "pelvis"
    offset: Vector = CENTRE  # of the belt from the body's CoM, body axes [m]
    stiffness: float = 5000.0  # of the cable [N/m]
    damping: float = 100.0  # [N s/m]

    def __post_init__(self) -> None:
        super().__post_init__()
        require_soft("WeightPull", self.mass, self.stiffness)

    @property
    def forces(self) -> tuple[Push, ...]:
        """One, as long as the weight hangs there."""
        law = Coupling(
            self.stiffness, self.mass, gap=self.drop, damping=self.damping, drive=GRAVITY, reach=self.reach
        )
        force = towards(self.direction, self.mass * GRAVITY)
        return (Push(force, self.duration, self.start, self.body, self.offset, "heading", law),)


@register_disturbance
@dataclass(frozen=True)
class WaistPull(Apparatus):
    """A motor that pulls a body by a cable over a way D, as studies of human balance do, and then lets go.

    The cable's end goes D from rest to rest, accelerated and slowed down evenly, at most at `fastest`, and
    stays there for `hold`. The cable is a spring k with a damper c that cannot push. The nominal force is
    k D, what a robot would feel that does not give way.
    """

    json_name = "waist pull"
    quantities: ClassVar[Quantities] = {
        "travel": TRAVEL,
        "fastest": SPEED,
        "acceleration": ACCELERATION,
        "direction": ANGLE,
        "hold": Quantity("s", 0.0, DURATION_MAX, "time"),
        "reach": Quantity("m", 0.5, 100.0, "length"),
        "stiffness": STIFFNESS,
        "damping": DAMPING,
    }

    travel: float  # D [m]
    fastest: float  # [m/s]
    start: float | GaitEvent  # since reset [s]
    direction: float = 0.0  # of the pull [rad]
    acceleration: float = 7.2  # [m/s^2]
    hold: float = 0.1  # [s]
    reach: float = 3.0  # from the body to the motor [m]
    body: Body | str = "pelvis"
    offset: Vector = CENTRE  # of the belt from the body's CoM, body axes [m]
    stiffness: float = 5000.0  # of the cable [N/m]
    damping: float = 100.0  # [N s/m]

    def __post_init__(self) -> None:
        super().__post_init__()
        require_hold("WaistPull", self._way.duration, self.hold)

    @property
    def _way(self) -> Shift:
        return Shift(self.travel, self.fastest, self.acceleration)

    @property
    def forces(self) -> tuple[Push, ...]:
        """One, until the cable is let go."""
        law = Coupling(
            self.stiffness, damping=self.damping, travel=self.travel, fastest=self.fastest,
            acceleration=self.acceleration, reach=self.reach,
        )  # fmt: skip
        force, time = towards(self.direction, self.stiffness * self.travel), self._way.duration + self.hold
        return (Push(force, time, self.start, self.body, self.offset, "heading", law),)


@register_disturbance
@dataclass(frozen=True)
class SteadyForce(Apparatus):
    """A force F of constant direction for seconds; it rises and falls linearly, its impulse is F (d - r)."""

    json_name = "steady force"
    quantities: ClassVar[Quantities] = {
        "force": Quantity("N", 0.0, FORCE_MAX, "mass"),
        "duration": DURATION,
        "direction": ANGLE,
        "rise": Quantity("s", 1e-3, DURATION_MAX, "time"),
    }

    force: float  # F [N]
    start: float | GaitEvent  # since reset [s]
    duration: float  # d, rise and fall included [s]
    direction: float = 0.0  # [rad]
    rise: float = 0.2  # r [s]
    body: Body | str = "pelvis"
    offset: Vector = CENTRE  # of attack from the body's CoM, body axes [m]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.duration < 2.0 * self.rise:
            raise InvalidValueError(
                f"SteadyForce.duration [s] must be at least twice its rise of {self.rise:g}, "
                f"got {self.duration:g}"
            )

    @property
    def forces(self) -> tuple[Push, ...]:
        """One."""
        force, law = towards(self.direction, self.force), Ramp(self.rise)
        return (Push(force, self.duration, self.start, self.body, self.offset, "heading", law),)


@register_disturbance
@dataclass(frozen=True)
class Slip(Apparatus):
    """The friction between one sole and the floor falls to a coefficient for a time, and comes back."""

    json_name = "slip"
    quantities: ClassVar[Quantities] = {"friction": Quantity("", 0.01, 2.0), "duration": DURATION}

    side: Side  # of the sole
    friction: float
    start: float | GaitEvent  # since reset [s]
    duration: float  # [s]

    @property
    def forces(self) -> tuple[Push, ...]:
        """One without a force, at the foot."""
        return (Push(CENTRE, self.duration, self.start, f"{self.side}_foot", law=Grip(self.friction)),)


@register_disturbance
@dataclass(frozen=True)
class Trip(Apparatus):
    """A block before the swing foot, which holds it up with a limited force until it is pushed away.

    It stands `gap` ahead of the middle of the sole's front edge when the event comes, and acts on that point
    along the robot's backward, as a wall of stiffness k and restitution 0.5, while the point is no higher
    than the block over the level floor. A foot that comes over it higher has passed it for good. The nominal
    force is the largest one, as long as the block is there.
    """

    json_name = "trip"
    quantities: ClassVar[Quantities] = {
        "gap": Quantity("m", 0.0, 1.0, "length"),
        "height": Quantity("m", 0.001, 1.0, "length"),
        "force": Quantity("N", 1.0, 1e4, "mass"),
        "duration": DURATION,
        "stiffness": Quantity("N/m", 1.0, 2e4, "stiffness"),
    }

    start: GaitEvent  # with the stance foot's side; the other one trips
    gap: float = 0.02  # [m]
    height: float = 0.15  # of the block [m]
    force: float = 150.0  # beyond which it gives way [N]
    duration: float = 0.3  # for which it stands there [s]
    stiffness: float = 1e4  # k [N/m]

    def __post_init__(self) -> None:
        require_kind("Trip.start", self.start, GaitEvent)
        super().__post_init__()

    @property
    def forces(self) -> tuple[Push, ...]:
        """One, at the swing foot."""
        foot = f"{other_side(self.start.side)}_foot"
        law = Coupling(
            self.stiffness, gap=self.gap, restitution=0.5, limit=self.force, height=self.height, at_toe=True
        )
        force = (-self.force, 0.0, 0.0)
        return (Push(force, self.duration, self.start, foot, frame="heading", law=law),)


@register_disturbance
@dataclass(frozen=True)
class Payload(Apparatus):
    """A mass m that falls by h onto a body and stays there, such as a box dropped into the arms.

    It meets the body at sqrt(2 g h), straight down, through a spring k with 0.7 of critical damping, which
    holds it aside as well: from then on the robot carries its weight and its inertia. The point stays where
    it is in the body's axes. The nominal impulse is its momentum, within half a second.
    """

    json_name = "payload"
    quantities: ClassVar[Quantities] = {
        "mass": Quantity("kg", 0.1, 100.0, "mass"),
        "height": Quantity("m", 0.0, 5.0, "length"),
        "stiffness": STIFFNESS,
        "settling": Quantity("s", 0.01, 10.0, "time"),
    }

    mass: float  # [kg]
    height: float  # h [m]
    start: float | GaitEvent  # of the contact, since reset [s]
    body: Body | str = "trunk"
    offset: Vector = (0.25, 0.0, 0.0)  # where it lies, from the body's CoM, body axes [m]
    stiffness: float = 5000.0  # [N/m]
    settling: float = 0.5  # after which it counts as part of the robot [s]

    def __post_init__(self) -> None:
        super().__post_init__()
        require_soft("Payload", self.mass, self.stiffness)

    @property
    def forces(self) -> tuple[Push, ...]:
        """One; the mass stays beyond it."""
        speed = math.sqrt(2.0 * GRAVITY * self.height)
        damping = 1.4 * math.sqrt(self.stiffness * self.mass)
        law = Coupling(
            self.stiffness, self.mass, speed, damping=damping, drive=GRAVITY, bound=True, stays=True
        )
        force = (0.0, 0.0, -self.mass * max(speed, GRAVITY * CONTROL_STEP) / self.settling)
        return (Push(force, self.settling, self.start, self.body, self.offset, law=law),)


@register_disturbance
@dataclass(frozen=True)
class Platform(Apparatus):
    """The floor goes a way D from rest to rest, evenly accelerated and slowed down, at most at `fastest`.

    Positions and velocities are those in the floor's axes, in which every body feels gravity g - a: exact for
    a floor that does not turn. Neither planner nor control knows of it. There is no nominal impulse.
    """

    json_name = "platform"
    quantities: ClassVar[Quantities] = {
        "travel": TRAVEL, "fastest": SPEED, "acceleration": ACCELERATION, "direction": ANGLE,
    }  # fmt: skip

    travel: float  # D [m]
    fastest: float  # [m/s]
    start: float | GaitEvent  # since reset [s]
    direction: float = 0.0  # of the floor's way [rad]
    acceleration: float = 5.0  # and deceleration [m/s^2]

    @property
    def forces(self) -> tuple[Push, ...]:
        """One without a force."""
        way = Shift(self.travel, self.fastest, self.acceleration)
        return (Push(CENTRE, way.duration, self.start, law=FloorShift(self.direction, *way)),)


@register_disturbance
@dataclass(frozen=True)
class TiltingPlatform(Apparatus):
    """The floor tilts by an angle under the robot, stays so for `hold`, and tilts back.

    Both ways are evenly accelerated and slowed down, at most at `fastest`, about a level axis through the
    point of the floor under the robot's CoM. All quantities are in the axes of the floor, with the inertial
    forces of a frame that turns (`FloorTilt`). Neither planner nor control knows of it. There is no nominal
    impulse.
    """

    json_name = "tilting platform"
    quantities: ClassVar[Quantities] = {
        "angle": Quantity("rad", 1e-3, 0.5),
        "fastest": Quantity("rad/s", 1e-3, 10.0, "rate"),
        "direction": ANGLE,
        "hold": Quantity("s", 0.0, DURATION_MAX, "time"),
        "acceleration": Quantity("rad/s^2", 0.01, 500.0, "angular_acceleration"),
    }

    angle: float  # [rad]
    fastest: float  # [rad/s]
    start: float | GaitEvent  # since reset [s]
    direction: float = 0.0  # to which the floor goes down: 0 lowers the toes [rad]
    hold: float = 0.5  # between the way there and the way back [s]
    acceleration: float = 10.0  # and deceleration [rad/s^2]

    def __post_init__(self) -> None:
        super().__post_init__()
        require_hold("TiltingPlatform", 2.0 * self._way.duration, self.hold)

    @property
    def _way(self) -> Shift:
        return Shift(self.angle, self.fastest, self.acceleration)

    @property
    def forces(self) -> tuple[Push, ...]:
        """One without a nominal force, there and back."""
        way = self._way
        back = way.duration + self.hold
        law = FloorTilt(self.direction, *way, back)
        return (Push(CENTRE, back + way.duration, self.start, law=law),)
