"""Disturbances of a robot: forces on its bodies, jumps of its velocity, and what is made of both.

To the compiled loops every disturbance is a number of forces (`Push`) and of jumps (`Kick`). A force is
constant, or follows a `Law`: it rises slowly, comes from something that meets the body, or stands for a
change of the floor. A new kind is one class that says which ones it is made of:

    @register_disturbance
    @dataclass(frozen=True)
    class DoubleTap(Disturbance):
        json_name = "double tap"
        first: Push
        pause: float  # [s]

        @property
        def forces(self): ...
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, NamedTuple, Self, get_args

from ...controllers.errors import InvalidValueError
from ...controllers.model.robot import Similarity
from ...controllers.validation import (
    require_choice,
    require_integer,
    require_kind,
    require_number,
    require_vector,
)
from .record import JsonRecord, Kinds, Quantities, Quantity, checked, object_of, resized

Vector = tuple[float, float, float]
Side = Literal["left", "right"]
Body = Literal[
    "pelvis", "trunk", "left_thigh", "left_shank", "left_foot", "right_thigh", "right_shank", "right_foot"
]
PushFrame = Literal["world", "heading"]
SIDES: tuple[str, ...] = get_args(Side)
BODIES: tuple[Body, ...] = get_args(Body)
FEET = "left_foot", "right_foot"
FRAMES: tuple[str, ...] = get_args(PushFrame)
LINK = "link:"  # before the name of a held joint whose link is pushed

FORCE_MAX = 1e7  # of each component [N]: 0.1 ms of it, which stand for a jump, shift 60 kg by 17 m/s
DURATION_MAX = 3600.0  # [s]
TIME_MAX = 1e6  # of any moment since reset [s]
OFFSET_MAX = 10.0  # of each component [m]
JUMP_MAX = 100.0  # of each component of a kick [m/s]
STEP_MAX = 100_000  # of a gait event
PENDING = math.inf  # start time of a push whose gait event has not come yet [s]


def other_side(side: Side) -> Side:
    """The other foot."""
    return "right" if side == "left" else "left"


def require_body(body: object) -> None:
    """Raise UnknownNameError for a body that no push may name; which held joints there are a robot knows."""
    if not (isinstance(body, str) and body.startswith(LINK)):
        require_choice("push body", body, BODIES)


@dataclass(frozen=True)
class GaitEvent(JsonRecord):
    """A moment of the gait: a fraction of the planned duration of one step.

    The step is the first one with index >= `step` (0-based from reset) whose stance foot is `side`; the event
    comes when its elapsed time reaches `fraction` times its planned duration, at the latest when it ends.
    """

    json_name = "gait event"

    step: int
    side: Side
    fraction: float = 0.0  # of the planned step duration, in [0, 1]

    def __post_init__(self) -> None:
        self._set(step=require_integer("GaitEvent.step", self.step, high=STEP_MAX))
        require_choice("stance side", self.side, SIDES)
        self._set(fraction=require_number("GaitEvent.fraction", self.fraction, 0.0, 1.0))

    def step_index(self, first_side: Side) -> int:
        """Index of the step the event falls in, when step 0 stands on `first_side` and sides alternate."""
        stance = first_side if self.step % 2 == 0 else other_side(first_side)
        return self.step if stance == self.side else self.step + 1

    def mirrored(self) -> GaitEvent:
        """The same event on the other foot."""
        return GaitEvent(self.step, other_side(self.side), self.fraction)


class Disturbance(JsonRecord, ABC):
    """Something that disturbs a robot from outside: forces for a time, jumps of its velocity, or both.

    A kind is a frozen dataclass. It is over when the last of its forces has ended and the last of its jumps
    has come; forces at gait events start when the robot's steps say so.
    """

    @property
    def forces(self) -> tuple[Push, ...]:
        """The pushes that it is made of, each a constant force or one that follows a `Law`."""
        return ()

    @property
    def jumps(self) -> tuple[Kick, ...]:
        """The jumps of the robot's velocity that it is made of."""
        return ()

    @abstractmethod
    def mirrored(self) -> Self:
        """Reflection in the x-z plane."""

    @abstractmethod
    def scaled(self, scale: Similarity) -> Self:
        """The same disturbance for a robot of another size."""

    @property
    def impulse(self) -> Vector:
        """Sum of F d over its forces, (3,) [N s]."""
        x, y, z = (sum((push.impulse[axis] for push in self.forces), 0.0) for axis in range(3))
        return x, y, z


DISTURBANCES: Kinds[Disturbance] = Kinds("disturbance", Disturbance)
register_disturbance, read_disturbance = DISTURBANCES.register, DISTURBANCES.read


TERMS = 14  # numbers that compiled code reads of a law, at most


class Law(JsonRecord, ABC):
    """How the force of a push comes about where it is not constant; the push says when, where and which way.

    Compiled code (`envs/biped/laws.py`) knows it by its `number`, and reads its `terms`.
    """

    left_out = None
    number: ClassVar[int]
    moves_floor: ClassVar[bool] = False  # whether it changes the floor, in a model of the robot's own
    accelerates: ClassVar[bool] = False  # whether the floor accelerates, of which control knows nothing
    quantities: ClassVar[Quantities]

    def __post_init__(self) -> None:
        self._set(**checked(type(self).__name__, self, self.quantities))

    @property
    @abstractmethod
    def terms(self) -> tuple[float, ...]:
        """At most TERMS numbers."""

    def check(self, push: Push) -> None:
        """Raise InvalidValueError for a push that cannot follow it."""

    def full_time(self, duration: float) -> float:
        """Time of the full force that gives the impulse of a push of this duration [s]."""
        return duration

    def mirrored(self) -> Self:
        """Reflection in the x-z plane."""
        return self

    def scaled(self, scale: Similarity) -> Self:
        """The same law for a robot of another size."""
        return replace(self, **resized(self, self.quantities, scale))  # type: ignore[type-var]

    def to_dict(self) -> dict[str, Any]:
        """Its fields and its kind."""
        return {"kind": self.json_name} | super().to_dict()


LAWS: Kinds[Law] = Kinds("law of a push", Law)
RAMPED, COUPLED, GRIPPED, MOVED, TILTED = 1, 2, 3, 4, 5  # numbers of laws; 0: a constant force


@LAWS.register
@dataclass(frozen=True)
class Ramp(Law):
    """A force that rises linearly over `rise` and falls as long at its end; its impulse is F (d - rise)."""

    json_name, number = "ramp", RAMPED
    quantities: ClassVar[Quantities] = {"rise": Quantity("s", 1e-3, DURATION_MAX, "time")}

    rise: float  # [s]

    @property
    def terms(self) -> tuple[float, ...]:
        """The rise."""
        return (self.rise,)

    def check(self, push: Push) -> None:
        """It lasts long enough to rise and to fall."""
        if push.duration < 2.0 * self.rise - 1e-9:
            raise InvalidValueError(
                f"Push.duration [s] must be at least twice the rise of {self.rise:g}, got {push.duration:g}"
            )

    def full_time(self, duration: float) -> float:
        """Duration less rise [s]."""
        return duration - self.rise


class CouplingTerms(NamedTuple):
    """Numbers of a `Coupling` as compiled code reads them; inf where there is no such bound."""

    inverse_mass: float
    speed: float
    gap: float
    stiffness: float
    damping: float
    restitution: float
    drive: float
    travel: float
    fastest: float
    acceleration: float
    reach: float
    limit: float
    height: float
    bits: float  # AT_TOE, BOUND, STAYS


AT_TOE, BOUND, STAYS = 1, 2, 4


@LAWS.register
@dataclass(frozen=True)
class Coupling(Law):
    """Something that meets the body along a line and presses on it through a one-sided spring.

    With s its place along the line, q that of the point of attack and d = s - q > 0 the depth of contact,

        F = min(F_max, max(0, min(k d, k (d - (1 - e^2) d_max) / e^2) + c dd/dt)),    m dv/dt = m g' - F,

    a spring that is stiffer when it lets go (Walton and Braun 1986), so that e is the coefficient of
    restitution whatever both masses are; g' drives the mass. Without a mass the other end moves as a motor
    moves it: at rest, or over `travel`, accelerated and slowed down evenly, at most at `fastest`. Mass and
    momentum are exact: what the body gets is what the mass loses, m (v_before - v_after), to rounding.

    The line points along the force of the push through where the point is when that starts. With `reach` it
    ends at a pulley so far away, towards which the body is then pulled; otherwise it is infinitely long.
    """

    json_name, number = "coupling", COUPLED
    quantities: ClassVar[Quantities] = {
        "mass": Quantity("kg", 0.01, 1000.0, "mass"),
        "speed": Quantity("m/s", 0.0, 30.0, "velocity"),
        "gap": Quantity("m", 0.0, 10.0, "length"),
        "stiffness": Quantity("N/m", 1.0, 1e6, "stiffness"),
        "damping": Quantity("N s/m", 0.0, 1e4, "viscosity"),
        "restitution": Quantity("", 0.3, 1.0),
        "drive": Quantity("m/s^2", 0.0, 100.0),
        "travel": Quantity("m", 0.0, 10.0, "length"),
        "fastest": Quantity("m/s", 1e-3, 30.0, "velocity"),
        "acceleration": Quantity("m/s^2", 1e-3, 1000.0),
        "reach": Quantity("m", 0.1, 1000.0, "length"),
        "limit": Quantity("N", 0.0, FORCE_MAX, "mass"),
        "height": Quantity("m", 0.0, 10.0, "length"),
    }

    stiffness: float  # k [N/m]
    mass: float | None = None  # m [kg]; None: the other end is at rest or moved by a motor
    speed: float = 0.0  # of the mass at the start, towards the body [m/s]
    gap: float = 0.0  # from the mass to the point of attack at the start, or slack of a cable [m]
    damping: float = 0.0  # c [N s/m]
    restitution: float = 1.0  # e
    drive: float = 0.0  # g', such as gravity on a falling weight [m/s^2]
    travel: float = 0.0  # of the motor [m]
    fastest: float | None = None  # of the motor; None: as it gets [m/s]
    acceleration: float = 10.0  # of the motor, and its deceleration [m/s^2]
    reach: float | None = None  # from the point of attack to a pulley; None: far away [m]
    limit: float | None = None  # F_max [N]; None: any
    height: float | None = None  # what is higher than this passes over it [m]; None: nothing does
    at_toe: bool = False  # the point of attack counts from the middle of the sole's front edge, of a foot
    bound: bool = False  # mass and body hold together aside by k and c as well while they touch
    stays: bool = False  # the mass stays after the push is over, to the end

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("at_toe", "bound", "stays"):
            require_kind(f"Coupling.{name}", getattr(self, name), bool)

    def check(self, push: Push) -> None:
        """It has a direction, and a toe where it acts on one."""
        if not any(push.force):
            raise InvalidValueError(
                "Push.force [N] must not be zero, since it gives a coupling its direction"
            )
        if self.at_toe:
            require_choice("body with a toe", push.body, FEET)

    @property
    def terms(self) -> CouplingTerms:
        """All its numbers."""
        open_ends = self.fastest, self.reach, self.limit, self.height
        fastest, reach, limit, height = (math.inf if value is None else value for value in open_ends)
        bits = AT_TOE * self.at_toe + BOUND * self.bound + STAYS * self.stays
        return CouplingTerms(
            0.0 if self.mass is None else 1.0 / self.mass, self.speed, self.gap, self.stiffness, self.damping,
            self.restitution, self.drive, self.travel, fastest, self.acceleration, reach, limit, height,
            float(bits),
        )  # fmt: skip


@LAWS.register
@dataclass(frozen=True)
class Grip(Law):
    """No force: the friction under the sole of the foot that is named falls to `friction` while it lasts."""

    json_name, number, moves_floor = "grip", GRIPPED, True
    quantities: ClassVar[Quantities] = {"friction": Quantity("", 0.01, 2.0)}

    friction: float  # coefficient; a floor that is more slippery stays as it is

    def check(self, push: Push) -> None:
        """It is that of a sole."""
        require_choice("body with a sole", push.body, FEET)

    @property
    def terms(self) -> tuple[float, ...]:
        """The friction."""
        return (self.friction,)


@LAWS.register
@dataclass(frozen=True)
class FloorShift(Law):
    """No force on a body: the floor goes a way, and stays where it is then.

    All quantities are in the axes of the floor, so that gravity is g - a(t) for every body: exact for a floor
    that does not turn.
    """

    json_name, number, moves_floor, accelerates = "floor shift", MOVED, True, True
    quantities: ClassVar[Quantities] = {
        "direction": Quantity("rad", -math.inf, math.inf),
        "travel": Quantity("m", 0.0, 10.0, "length"),
        "fastest": Quantity("m/s", 1e-3, 10.0, "velocity"),
        "acceleration": Quantity("m/s^2", 1e-3, 100.0),
    }

    direction: float  # of the floor's way, from the robot's forward at its start, counter-clockwise [rad]
    travel: float  # [m]
    fastest: float  # [m/s]
    acceleration: float  # and deceleration [m/s^2]

    @property
    def terms(self) -> tuple[float, ...]:
        """Direction, and the way."""
        return self.direction, self.travel, self.fastest, self.acceleration

    def mirrored(self) -> FloorShift:
        """It goes to the other side."""
        return replace(self, direction=0.0 - self.direction)


@LAWS.register
@dataclass(frozen=True)
class FloorTilt(Law):
    """No force on a body by name: the floor turns by an angle phi about a level axis n, and later back.

    All quantities are in the axes of the floor, which turn at omega = phi' n about the point of the floor
    that is under the robot's CoM when the law begins. So gravity is R(-phi n) g, and each body of mass m,
    inertia I and S = tr(I) / 2 - I, r from that point, with the velocity v and the angular velocity w, also
    feels

        F = -m (omega' x r + omega x (omega x r) + 2 omega x v)
        M = -(I omega' + omega x I omega + 2 (S omega) x w)
    """

    json_name, number, moves_floor, accelerates = "floor tilt", TILTED, True, True
    quantities: ClassVar[Quantities] = {
        "direction": Quantity("rad", -math.inf, math.inf),
        "angle": Quantity("rad", 0.0, 1.0),
        "fastest": Quantity("rad/s", 1e-3, 10.0, "rate"),
        "acceleration": Quantity("rad/s^2", 1e-3, 1000.0, "angular_acceleration"),
        "back": Quantity("s", 0.0, DURATION_MAX, "time"),
    }

    direction: float  # to which the floor goes down, from the robot's forward at its start [rad]
    angle: float  # [rad]
    fastest: float  # [rad/s]
    acceleration: float  # and deceleration [rad/s^2]
    back: float  # from the start until it begins to turn back [s]

    @property
    def terms(self) -> tuple[float, ...]:
        """Direction, the way, and when it goes back."""
        return self.direction, self.angle, self.fastest, self.acceleration, self.back

    def mirrored(self) -> FloorTilt:
        """It goes down to the other side."""
        return replace(self, direction=0.0 - self.direction)


FLOOR_LAWS = tuple(law.number for law in LAWS.by_name.values() if law.moves_floor)
ACCELERATING = tuple(law.number for law in LAWS.by_name.values() if law.accelerates)


@register_disturbance
@dataclass(frozen=True)
class Push(Disturbance):
    """A constant force F [N] on a body for a duration d [s]; it delivers the impulse F d [N s].

    Each component of the force is at most FORCE_MAX, the duration DURATION_MAX, both far beyond what leaves a
    robot standing; beyond them simulated states overflow.
    The force has world axes, which at heading 0 are forward, left and up; in the frame "heading" forward and
    left are those of the robot when the push starts. It stays as it is in the world from then on.
    A thigh is the link from the last axis of the hip to the knee, a shank that from knee to ankle. Another
    body is "link:JOINT", the one that a held joint of the robot moves, such as an arm's.

    Where there is a `law`, it says what acts; the force is then the nominal one, by which a push is reported,
    and its direction that of the law. What was delivered is measured.
    """

    json_name = "push"
    left_out = ("frame", "law")

    force: Vector  # [N]
    duration: float  # [s]
    start: float | GaitEvent  # seconds from reset, or a moment of the gait
    body: Body | str = "pelvis"
    offset: Vector = (0.0, 0.0, 0.0)  # point of attack from the body's CoM, body axes [m]
    frame: PushFrame = "world"  # of the force
    law: Law | None = None  # that the force follows; None: it is constant

    def __post_init__(self) -> None:
        self._set(force=require_vector("Push.force [N]", self.force, FORCE_MAX))
        self._set(offset=require_vector("Push.offset [m]", self.offset, OFFSET_MAX))
        self._set(
            duration=require_number("Push.duration [s]", self.duration, 0.0, DURATION_MAX, open_low=True)
        )
        require_body(self.body)
        require_choice("push frame", self.frame, FRAMES)
        if not isinstance(self.start, GaitEvent):
            self._set(start=require_number("Push.start [s]", self.start, 0.0, TIME_MAX))
        if self.law is not None:
            require_kind("Push.law", self.law, Law).check(self)

    @property
    def forces(self) -> tuple[Push, ...]:
        """The push itself."""
        return (self,)

    @property
    def impulse(self) -> Vector:
        """F d, or what the law makes of it, (3,) [N s]."""
        return _times(self.force, self.full_time)

    @property
    def full_time(self) -> float:
        """Time of the full force that gives the impulse: the duration, where there is no law [s]."""
        return self.duration if self.law is None else self.law.full_time(self.duration)

    @property
    def impulse_magnitude(self) -> float:
        """|F| d [N s]."""
        return math.hypot(*self.impulse)

    @property
    def direction(self) -> float:
        """psi, horizontal direction in its frame, counter-clockwise from x [rad], in (-pi, pi]."""
        return math.atan2(self.force[1], self.force[0])

    def mirrored(self) -> Push:
        """Reflection in the x-z plane: y components negated, body and event those of the other side."""
        law = None if self.law is None else self.law.mirrored()
        return Push(
            mirrored_vector(self.force), self.duration, mirrored_start(self.start), mirrored_body(self.body),
            mirrored_vector(self.offset), self.frame, law,
        )  # fmt: skip

    def scaled(self, scale: Similarity) -> Push:
        """The same push for a robot of another size; a gait event stays."""
        force, offset = _times(self.force, scale.mass), _times(self.offset, scale.length)
        law = None if self.law is None else self.law.scaled(scale)
        start = scaled_start(self.start, scale)
        return Push(force, self.duration * scale.time, start, self.body, offset, self.frame, law)

    @classmethod
    def _parsed(cls, name: str, value: Any) -> Any:
        if name == "law" and isinstance(value, Mapping):
            return LAWS.read(value)
        return object_of(GaitEvent, value) if name == "start" else value


@register_disturbance
@dataclass(frozen=True)
class Kick(Disturbance):
    """A jump of the velocity of the whole robot: an impulse m v through its CoM in no time.

    The velocity of its base changes by `velocity`, in world axes, and no joint's rate does, so that every
    body has the same jump. It comes at the beginning of the first planning period that begins at `start` or
    later, after the policy has chosen that period's action.
    """

    json_name = "kick"

    velocity: Vector  # [m/s]
    start: float  # since reset [s]

    def __post_init__(self) -> None:
        self._set(velocity=require_vector("Kick.velocity [m/s]", self.velocity, JUMP_MAX))
        self._set(start=require_number("Kick.start [s]", self.start, 0.0, TIME_MAX))

    @property
    def jumps(self) -> tuple[Kick, ...]:
        """The kick itself."""
        return (self,)

    def mirrored(self) -> Kick:
        """Reflection in the x-z plane."""
        return Kick(mirrored_vector(self.velocity), self.start)

    def scaled(self, scale: Similarity) -> Kick:
        """The same kick for a robot of another size."""
        return Kick(_times(self.velocity, scale.velocity), self.start * scale.time)


def mirrored_vector(vector: Vector) -> Vector:
    """A vector reflected in the x-z plane."""
    x, y, z = vector
    return x, 0.0 - y, z


def mirrored_start(start: float | GaitEvent) -> float | GaitEvent:
    """A start, or the same one on the other foot."""
    return start.mirrored() if isinstance(start, GaitEvent) else start


OTHER_SIDE = {"left": "right", "right": "left", "l": "r", "r": "l"}
SIDE_IN_NAME = re.compile(r"left|right|(?<![a-z0-9])[lr](?![a-z0-9])", re.IGNORECASE)


def mirrored_body(body: str) -> str:
    """The same body on the other side, by its name: `left`, `Left`, `LEFT`, or `l` and `L` as words of it."""

    def other(side: re.Match[str]) -> str:
        name = OTHER_SIDE[side[0].lower()]
        return name.upper() if side[0].isupper() else name.title() if side[0].istitle() else name

    return SIDE_IN_NAME.sub(other, body)


def scaled_start(start: float | GaitEvent, scale: Similarity) -> float | GaitEvent:
    """A start for a robot of another size; a gait event stays."""
    return start if isinstance(start, GaitEvent) else start * scale.time


def _times(vector: Vector, factor: float) -> Vector:
    x, y, z = vector
    return x * factor, y * factor, z * factor


def polar_push(
    magnitude: float,
    direction: float,
    duration: float,
    start: float | GaitEvent,
    body: Body | str = "pelvis",
    frame: PushFrame = "world",
) -> Push:
    """A horizontal push of `magnitude` [N] towards `direction` psi [rad], counter-clockwise from forward.

    Raises:
        InvalidValueError: A magnitude outside [0, FORCE_MAX], a direction that is not finite, or an
            impossible field of `Push`.
    """
    magnitude = require_number("push magnitude [N]", magnitude, 0.0, FORCE_MAX)
    direction = require_number("push direction [rad]", direction)
    force = (magnitude * math.cos(direction), magnitude * math.sin(direction), 0.0)
    return Push(force, duration, start, body, frame=frame)
