"""Disturbances of a robot: forces on its bodies, jumps of its velocity, and what is made of both.

To the compiled loops every disturbance is a number of constant forces (`Push`) and of jumps (`Kick`). A new
kind is one class that says which ones it is made of:

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
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Literal, Self, get_args

from ...controllers.model.robot import Similarity
from ...controllers.validation import (
    require_choice,
    require_integer,
    require_number,
    require_vector,
)
from .record import JsonRecord, Kinds, object_of

Vector = tuple[float, float, float]
Side = Literal["left", "right"]
Body = Literal[
    "pelvis", "trunk", "left_thigh", "left_shank", "left_foot", "right_thigh", "right_shank", "right_foot"
]
PushFrame = Literal["world", "heading"]
SIDES: tuple[str, ...] = get_args(Side)
BODIES: tuple[Body, ...] = get_args(Body)
FRAMES: tuple[str, ...] = get_args(PushFrame)
LINK = "link:"  # before the name of a held joint whose link is pushed

FORCE_MAX = 1e7  # of each component [N]: 0.1 ms of it, which stand for a jump, shift 60 kg by 17 m/s
DURATION_MAX = 3600.0  # [s]
OFFSET_MAX = 10.0  # of each component [m]
JUMP_MAX = 100.0  # of each component of a kick [m/s]
STEP_MAX = 10**9  # of a gait event
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
        """The constant forces that it is made of."""
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


DISTURBANCES: Kinds[Disturbance] = Kinds("disturbance")
register_disturbance, read_disturbance = DISTURBANCES.register, DISTURBANCES.read


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
    """

    json_name = "push"
    left_out = ("frame",)

    force: Vector  # [N]
    duration: float  # [s]
    start: float | GaitEvent  # seconds from reset, or a moment of the gait
    body: Body | str = "pelvis"
    offset: Vector = (0.0, 0.0, 0.0)  # point of attack from the body's CoM, body axes [m]
    frame: PushFrame = "world"  # of the force

    def __post_init__(self) -> None:
        self._set(force=require_vector("Push.force [N]", self.force, FORCE_MAX))
        self._set(offset=require_vector("Push.offset [m]", self.offset, OFFSET_MAX))
        self._set(
            duration=require_number("Push.duration [s]", self.duration, 0.0, DURATION_MAX, open_low=True)
        )
        require_body(self.body)
        require_choice("push frame", self.frame, FRAMES)
        if not isinstance(self.start, GaitEvent):
            self._set(start=require_number("Push.start [s]", self.start, 0.0))

    @property
    def forces(self) -> tuple[Push, ...]:
        """The push itself."""
        return (self,)

    @property
    def impulse(self) -> Vector:
        """F d, (3,) [N s]."""
        return _times(self.force, self.duration)

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
        start = self.start.mirrored() if isinstance(self.start, GaitEvent) else self.start
        swaps = (("left", "right"), ("right", "left"))
        body = next((self.body.replace(*swap) for swap in swaps if swap[0] in self.body), self.body)
        return Push(_mirrored(self.force), self.duration, start, body, _mirrored(self.offset), self.frame)

    def scaled(self, scale: Similarity) -> Push:
        """The same push for a robot of another size; a gait event stays."""
        force, offset = _times(self.force, scale.mass), _times(self.offset, scale.length)
        start = self.start if isinstance(self.start, GaitEvent) else self.start * scale.time
        return Push(force, self.duration * scale.time, start, self.body, offset, self.frame)

    @classmethod
    def _parsed(cls, name: str, value: Any) -> Any:
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
        self._set(start=require_number("Kick.start [s]", self.start, 0.0))

    @property
    def jumps(self) -> tuple[Kick, ...]:
        """The kick itself."""
        return (self,)

    def mirrored(self) -> Kick:
        """Reflection in the x-z plane."""
        return Kick(_mirrored(self.velocity), self.start)

    def scaled(self, scale: Similarity) -> Kick:
        """The same kick for a robot of another size."""
        return Kick(_times(self.velocity, scale.velocity), self.start * scale.time)


def _mirrored(vector: Vector) -> Vector:
    x, y, z = vector
    return x, 0.0 - y, z


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
