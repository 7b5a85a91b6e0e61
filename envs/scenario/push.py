"""Pushes: a constant force on one body for a stated time; and kicks: jumps of the velocity of all bodies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from ...controllers.model.robot import Similarity
from ...controllers.validation import (
    require_choice,
    require_integer,
    require_keys,
    require_number,
    require_vector,
)

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


def mirrored_body(body: str) -> str:
    """The same part of the other side, by its name; pelvis and trunk have none."""
    parts = ("left", "right"), ("right", "left")
    return next((body.replace(side, other) for side, other in parts if side in body), body)


def require_body(body: object) -> None:
    """Raise UnknownNameError for a body that no push may name; which held joints there are a robot tells."""
    if not (isinstance(body, str) and body.startswith(LINK)):
        require_choice("push body", body, BODIES)


@dataclass(frozen=True)
class GaitEvent:
    """A moment of the gait: a fraction of the planned duration of one step.

    The step is the first one with index >= `step` (0-based from reset) whose stance foot is `side`; the event
    comes when its elapsed time reaches `fraction` times its planned duration, at the latest when it ends.
    """

    step: int
    side: Side
    fraction: float = 0.0  # of the planned step duration, in [0, 1]

    def __post_init__(self) -> None:
        object.__setattr__(self, "step", require_integer("GaitEvent.step", self.step, high=STEP_MAX))
        require_choice("stance side", self.side, SIDES)
        fraction = require_number("GaitEvent.fraction", self.fraction, 0.0, 1.0)
        object.__setattr__(self, "fraction", fraction)

    def step_index(self, first_side: Side) -> int:
        """Index of the step the event falls in, when step 0 stands on `first_side` and sides alternate."""
        stance = first_side if self.step % 2 == 0 else other_side(first_side)
        return self.step if stance == self.side else self.step + 1

    def mirrored(self) -> GaitEvent:
        """The same event on the other foot."""
        return GaitEvent(self.step, other_side(self.side), self.fraction)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return {"step": self.step, "side": self.side, "fraction": self.fraction}

    @classmethod
    def from_dict(cls, data: object) -> GaitEvent:
        """Inverse of `to_dict`."""
        return cls(**require_keys("gait event", data, {"step", "side"}, {"fraction"}))


@dataclass(frozen=True)
class Push:
    """A constant force F [N] on a body for a duration d [s]; it delivers the impulse F d [N s].

    Each component of the force is at most FORCE_MAX, the duration DURATION_MAX, both far beyond what leaves a
    robot standing; beyond them simulated states overflow.
    The force has world axes, which at heading 0 are forward, left and up; in the frame "heading" forward and
    left are those of the robot when the push starts. It stays as it is in the world from then on.
    A thigh is the link from the last axis of the hip to the knee, a shank that from knee to ankle. Another
    body is "link:JOINT", the one that a held joint of the robot moves, such as an arm's.
    """

    force: tuple[float, float, float]  # [N]
    duration: float  # [s]
    start: float | GaitEvent  # seconds from reset, or a moment of the gait
    body: Body | str = "pelvis"
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # point of attack from the body's CoM, body axes [m]
    frame: PushFrame = "world"  # of the force

    def __post_init__(self) -> None:
        object.__setattr__(self, "force", require_vector("Push.force [N]", self.force, FORCE_MAX))
        object.__setattr__(self, "offset", require_vector("Push.offset [m]", self.offset, OFFSET_MAX))
        duration = require_number("Push.duration [s]", self.duration, 0.0, DURATION_MAX, open_low=True)
        object.__setattr__(self, "duration", duration)
        require_body(self.body)
        require_choice("push frame", self.frame, FRAMES)
        if not isinstance(self.start, GaitEvent):
            object.__setattr__(self, "start", require_number("Push.start [s]", self.start, 0.0))

    @property
    def impulse(self) -> tuple[float, float, float]:
        """F d, (3,) [N s]."""
        x, y, z = self.force
        return (x * self.duration, y * self.duration, z * self.duration)

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
        (fx, fy, fz), (px, py, pz) = self.force, self.offset
        start = self.start.mirrored() if isinstance(self.start, GaitEvent) else self.start
        body, offset = mirrored_body(self.body), (px, 0.0 - py, pz)
        return Push((fx, 0.0 - fy, fz), self.duration, start, body, offset, self.frame)

    def scaled(self, scale: Similarity) -> Push:
        """The same push for a robot of another size; a gait event stays."""
        force, offset = _times(self.force, scale.mass), _times(self.offset, scale.length)
        start = self.start if isinstance(self.start, GaitEvent) else self.start * scale.time
        return Push(force, self.duration * scale.time, start, self.body, offset, self.frame)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types; a gait event is an object, a time a number; the world's frame is left out."""
        values: dict[str, Any] = {
            "force": list(self.force),
            "duration": self.duration,
            "start": self.start.to_dict() if isinstance(self.start, GaitEvent) else self.start,
            "body": self.body,
            "offset": list(self.offset),
        }
        return values if self.frame == "world" else {**values, "frame": self.frame}

    @classmethod
    def from_dict(cls, data: object) -> Push:
        """Inverse of `to_dict`."""
        optional = {"body", "offset", "frame"}
        values = dict(require_keys("push", data, {"force", "duration", "start"}, optional))
        if isinstance(values["start"], Mapping):
            values["start"] = GaitEvent.from_dict(values["start"])
        return cls(**values)


@dataclass(frozen=True)
class Kick:
    """A jump of the velocity of the whole robot: an impulse m v through its CoM in no time.

    The velocity of its base changes by `velocity`, in world axes, and no joint's rate does, so that every
    body has the same jump. It comes at the beginning of the first planning period that begins at `start` or
    later, after the policy has chosen that period's action.
    """

    velocity: tuple[float, float, float]  # [m/s]
    start: float  # since reset [s]

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", require_vector("Kick.velocity [m/s]", self.velocity, JUMP_MAX))
        object.__setattr__(self, "start", require_number("Kick.start [s]", self.start, 0.0))

    def mirrored(self) -> Kick:
        """Reflection in the x-z plane."""
        x, y, z = self.velocity
        return Kick((x, 0.0 - y, z), self.start)

    def scaled(self, scale: Similarity) -> Kick:
        """The same kick for a robot of another size."""
        return Kick(_times(self.velocity, scale.velocity), self.start * scale.time)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return {"velocity": list(self.velocity), "start": self.start}

    @classmethod
    def from_dict(cls, data: object) -> Kick:
        """Inverse of `to_dict`."""
        return cls(**require_keys("kick", data, {"velocity", "start"}, set()))


def _times(vector: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
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
