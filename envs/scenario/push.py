"""Pushes: a constant force on one body for a stated time, and the exact share of it in any interval."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.kernels import njit
from ...controllers.validation import (
    require_choice,
    require_integer,
    require_keys,
    require_number,
    require_vector,
)

Side = Literal["left", "right"]
Body = Literal["pelvis", "trunk"]
PushFrame = Literal["world", "heading"]
SIDES: tuple[str, ...] = get_args(Side)
BODIES: tuple[Body, ...] = get_args(Body)
FRAMES: tuple[str, ...] = get_args(PushFrame)

FORCE_MAX = 1e7  # of each component [N]: 0.1 ms of it, which stand for a jump, shift 60 kg by 17 m/s
DURATION_MAX = 3600.0  # [s]
OFFSET_MAX = 10.0  # of each component [m]
STEP_MAX = 10**9  # of a gait event
PENDING = math.inf  # start time of a push whose gait event has not come yet [s]


def other_side(side: Side) -> Side:
    """The other foot."""
    return "right" if side == "left" else "left"


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
    """

    force: tuple[float, float, float]  # [N]
    duration: float  # [s]
    start: float | GaitEvent  # seconds from reset, or a moment of the gait
    body: Body = "pelvis"
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # point of attack from the body's CoM, body axes [m]
    frame: PushFrame = "world"  # of the force

    def __post_init__(self) -> None:
        object.__setattr__(self, "force", require_vector("Push.force [N]", self.force, FORCE_MAX))
        object.__setattr__(self, "offset", require_vector("Push.offset [m]", self.offset, OFFSET_MAX))
        duration = require_number("Push.duration [s]", self.duration, 0.0, DURATION_MAX, open_low=True)
        object.__setattr__(self, "duration", duration)
        require_choice("push body", self.body, BODIES)
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
        """Reflection in the x-z plane: y components negated, the event on the other foot."""
        (fx, fy, fz), (px, py, pz) = self.force, self.offset
        start = self.start.mirrored() if isinstance(self.start, GaitEvent) else self.start
        return Push((fx, 0.0 - fy, fz), self.duration, start, self.body, (px, 0.0 - py, pz), self.frame)

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


def polar_push(
    magnitude: float,
    direction: float,
    duration: float,
    start: float | GaitEvent,
    body: Body = "pelvis",
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


class PushArrays(NamedTuple):
    """The pushes of one scenario as arrays for compiled loops; P pushes."""

    force: NDArray[np.float64]  # (P, 3) [N]; the env writes here where it turns one into the world
    duration: NDArray[np.float64]  # (P,) [s]
    start: NDArray[np.float64]  # (P,) [s], PENDING until the gait event has come; the env writes here
    step: NDArray[np.int64]  # (P,) index of the event's step, -1 for a push at a time
    fraction: NDArray[np.float64]  # (P,) of the planned step duration
    body: NDArray[np.int64]  # (P,) index into BODIES
    offset: NDArray[np.float64]  # (P, 3) [m]
    frame: NDArray[np.int64]  # (P,) of the force, index into FRAMES; the env writes here


def push_arrays(pushes: Sequence[Push], first_side: Side) -> PushArrays:
    """Arrays of the pushes for an episode whose step 0 stands on `first_side`; a fresh copy each time."""
    events = [push.start if isinstance(push.start, GaitEvent) else None for push in pushes]
    times = [PENDING if isinstance(push.start, GaitEvent) else push.start for push in pushes]
    return PushArrays(
        force=np.array([push.force for push in pushes], dtype=np.float64).reshape(-1, 3),
        duration=np.array([push.duration for push in pushes], dtype=np.float64),
        start=np.array(times, dtype=np.float64),
        step=np.array([-1 if e is None else e.step_index(first_side) for e in events], dtype=np.int64),
        fraction=np.array([0.0 if e is None else e.fraction for e in events], dtype=np.float64),
        body=np.array([BODIES.index(push.body) for push in pushes], dtype=np.int64),
        offset=np.array([push.offset for push in pushes], dtype=np.float64).reshape(-1, 3),
        frame=np.array([FRAMES.index(push.frame) for push in pushes], dtype=np.int64),
    )


@njit(cache=True)
def resolve_starts(
    start: NDArray[np.float64],
    step: NDArray[np.int64],
    fraction: NDArray[np.float64],
    step_index: int,
    step_start: float,
    planned_duration: float,
    t0: float,
    t1: float,
) -> None:
    """Write the start times of the gait events that come within [t0, t1) into `start`, in place.

    start = max(t0, step_start + fraction * planned_duration) in the event's step, t0 if that step is over.
    `step_index` and `step_start` [s] are those of the present step, `planned_duration` its planned T [s].
    """
    for i in range(start.shape[0]):
        if step[i] < 0 or start[i] != np.inf or step_index < step[i]:
            continue
        moment = step_start + fraction[i] * planned_duration if step_index == step[i] else t0
        if moment < t1:
            start[i] = max(t0, moment)


@njit(cache=True)
def turn_forces(
    force: NDArray[np.float64],
    frame: NDArray[np.int64],
    start: NDArray[np.float64],
    heading: float,
    t1: float,
) -> None:
    """Turn forces in the heading's frame by the heading [rad] where their push starts before t1, in place.

    They are in the world's frame from then on: F_world = R_z(heading) F.
    """
    for i in range(start.shape[0]):
        if frame[i] == 0 or start[i] >= t1:
            continue
        cos, sin, x, y = math.cos(heading), math.sin(heading), force[i, 0], force[i, 1]
        force[i, 0], force[i, 1] = cos * x - sin * y, sin * x + cos * y
        frame[i] = 0


@njit(cache=True)
def overlap(start: float, duration: float, t0: float, t1: float) -> float:
    """Length of [start, start + duration] within [t0, t1] [s]; PENDING starts give 0."""
    return max(0.0, min(t1, start + duration) - max(t0, start))


@njit(cache=True)
def mean_force(
    force: NDArray[np.float64],
    duration: NDArray[np.float64],
    start: NDArray[np.float64],
    index: int,
    t0: float,
    t1: float,
    out: NDArray[np.float64],
) -> bool:
    """Write the force of push `index` averaged over [t0, t1] into `out` (3,) [N]; True where it is not zero.

    mean = F * |[start, start + d] and [t0, t1]| / (t1 - t0), so that the sum of mean * (t1 - t0) over any
    partition of time is F d exactly (to rounding), at every control rate.
    """
    share = overlap(start[index], duration[index], t0, t1) / (t1 - t0)
    for axis in range(3):
        out[axis] = force[index, axis] * share
    return share > 0.0
