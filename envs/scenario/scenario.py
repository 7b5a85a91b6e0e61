"""Scenarios: all that happens to the robot in one episode, fixed before it begins."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np

from ...controllers.errors import InvalidValueError, shown
from ...controllers.model.robot import Similarity
from ...controllers.validation import (
    changed_fields,
    require_all,
    require_choice,
    require_integer,
    require_kind,
    require_number,
    require_pair,
)
from .disturbances import read_disturbance
from .model_errors import EXACT_MODEL, PLAIN_PHYSICS, ModelErrors, PhysicsOptions
from .push import SIDES, TIME_MAX, Disturbance, Kick, Push, Side, other_side
from .record import JsonRecord, object_of

FASTEST_TURN = 0.6  # [rad/s]


@dataclass(frozen=True)
class Command(JsonRecord):
    """Commanded mean velocity in the heading frame, how fast the heading turns, and whether to stand.

    A robot that is told to stand keeps both feet on the floor as long as it can be caught in place; at rest
    without it, the robot steps in place.
    """

    json_name, left_out = "command", ("turn", "stand")

    vx: float = 0.0  # forward [m/s]
    vy: float = 0.0  # to the left [m/s]
    turn: float = 0.0  # to the left [rad/s]
    stand: bool = False  # on both feet; only at rest

    def __post_init__(self) -> None:
        self._set(vx=require_number("Command.vx [m/s]", self.vx, -5.0, 5.0))
        self._set(vy=require_number("Command.vy [m/s]", self.vy, -5.0, 5.0))
        self._set(turn=require_number("Command.turn [rad/s]", self.turn, -FASTEST_TURN, FASTEST_TURN))
        require_kind("Command.stand", self.stand, bool)
        if self.stand and (self.vx or self.vy or self.turn):
            raise InvalidValueError(
                f"a robot that stands has no velocity: Command.stand needs vx = vy = turn = 0, got {self}"
            )

    def mirrored(self) -> Command:
        """Sideways velocity and turning negated."""
        return Command(self.vx, 0.0 - self.vy, 0.0 - self.turn, self.stand)

    def scaled(self, scale: Similarity) -> Command:
        """The same command for a robot of another size; none turns faster than FASTEST_TURN."""
        turn = min(max(self.turn / scale.time, -FASTEST_TURN), FASTEST_TURN)
        return Command(self.vx * scale.velocity, self.vy * scale.velocity, turn, self.stand)


IN_PLACE, AT_REST = Command(), Command(stand=True)
SHIFT_MAX, LEAN_MAX = 0.05, 0.1  # of a start beside the nominal one [m], [rad]


@dataclass(frozen=True)
class StartOffset(JsonRecord):
    """How far a robot begins beside its nominal start, its feet where they belong: (forward, left) each.

    The trunk of a pendulum leans; that of another robot does together with its pelvis. A robot under servos
    of all its joints stands as these have it, and leans alone.
    """

    json_name, left_out = "start", None

    com: tuple[float, float] = (0.0, 0.0)  # [m]
    lean: tuple[float, float] = (0.0, 0.0)  # [rad]

    def __post_init__(self) -> None:
        self._set(
            com=require_pair("StartOffset.com [m]", self.com, SHIFT_MAX),
            lean=require_pair("StartOffset.lean [rad]", self.lean, LEAN_MAX),
        )

    def mirrored(self) -> StartOffset:
        """Shift and lean to the left negated."""
        (x, y), (forward, left) = self.com, self.lean
        return StartOffset((x, -y), (forward, -left))

    def scaled(self, scale: Similarity) -> StartOffset:
        """The same start for a robot of another size."""
        x, y = self.com
        return StartOffset((x * scale.length, y * scale.length), self.lean)


NOMINAL_START = StartOffset()


@dataclass(frozen=True)
class CommandChange(JsonRecord):
    """From the first planning period that begins at `time` or later, another command is in force."""

    json_name = "command change"

    time: float  # since reset [s]
    command: Command

    def __post_init__(self) -> None:
        self._set(time=require_number("CommandChange.time [s]", self.time, 0.0, TIME_MAX, open_low=True))
        require_kind("CommandChange.command", self.command, Command)

    def mirrored(self) -> CommandChange:
        """The mirrored command at the same time."""
        return CommandChange(self.time, self.command.mirrored())

    def scaled(self, scale: Similarity) -> CommandChange:
        """The same change for a robot of another size."""
        return CommandChange(self.time * scale.time, self.command.scaled(scale))

    @classmethod
    def _parsed(cls, name: str, value: Any) -> Any:
        return object_of(Command, value) if name == "command" else value


SETTLE_TIME = 4.0  # an episode ends this long after the last push ended [s]
STRIDE_MAX = 0.5  # [m]
ID_MAX = 1000  # characters
SEED_MAX = 2**128 - 1  # the noise takes the lowest 64 bits
# What control acts on: the true state, or the estimate by an `Estimator`, with the place where that is
SENSING: dict[str, str | None] = {
    "exact": None,
    "onboard": "push_recovery.controllers.estimation.base_estimate:CONTACT_FILTER",
}
EXACT_SENSING, ONBOARD = SENSING
__all__ = ["SETTLE_TIME", "Command", "CommandChange", "Kick", "Scenario"]


@dataclass(frozen=True)
class Scenario(JsonRecord):
    """One episode, complete: the same scenario and policy give the same outcome bit for bit.

    The robot starts at the beginning of a nominal step (for the command) on `stance_side`, or stands, with
    the other foot beside that one or `stride` ahead of it. The episode ends at `duration` where that is
    given, otherwise `settle_time` after the last push has ended, the last kick has come and the command has
    changed for the last time (after reset where there is none of them).
    """

    json_name = "scenario"
    left_out = ("errors", "changes", "physics", "sensing", "kicks", "disturbances", "stride", "start")

    id: str
    pushes: tuple[Push, ...] = ()
    command: Command = IN_PLACE  # until the first of `changes`
    stance_side: Side = "left"  # of step 0
    settle_time: float = SETTLE_TIME  # [s]
    duration: float | None = None  # [s] from reset
    noise_seed: int = 0  # of the noise of `errors` and of sensors
    errors: ModelErrors = EXACT_MODEL  # what planner and control do not know
    changes: tuple[CommandChange, ...] = ()  # of the command, rising in time
    physics: PhysicsOptions = PLAIN_PHYSICS  # how it is computed
    sensing: str = EXACT_SENSING  # what control acts on: the true state, or what "onboard" sensors measure
    kicks: tuple[Kick, ...] = ()  # jumps of the velocity
    disturbances: tuple[Disturbance, ...] = ()  # of kinds made of pushes and kicks
    stride: float = 0.0  # how far ahead of the stance foot the other one stands at first, of a stander [m]
    start: StartOffset = NOMINAL_START  # beside the nominal one

    def __post_init__(self) -> None:
        if not (isinstance(self.id, str) and 0 < len(self.id) <= ID_MAX and self.id.isprintable()):
            raise InvalidValueError(
                f"Scenario.id must be 1 to {ID_MAX} printable characters, got {shown(self.id)}"
            )
        for name, kind in _LISTS.items():
            self._set(**{name: require_all(f"Scenario.{name}", getattr(self, name), kind)})
        for part in self.disturbances:
            require_all(f"{type(part).__name__}.forces", part.forces, Push)
            require_all(f"{type(part).__name__}.jumps", part.jumps, Kick)
        require_kind("Scenario.command", self.command, Command)
        require_choice("stance side", self.stance_side, SIDES)
        times = {"settle_time": self.settle_time}
        if self.duration is not None:
            times["duration"] = self.duration
        for name, value in times.items():
            label = f"Scenario.{name} [s]"
            self._set(**{name: require_number(label, value, 0.0, TIME_MAX, open_low=True)})
        self._set(noise_seed=require_integer("Scenario.noise_seed", self.noise_seed, high=SEED_MAX))
        if not isinstance(self.errors, ModelErrors):
            raise InvalidValueError(f"Scenario.errors must be ModelErrors, got {shown(self.errors)}")
        require_kind("Scenario.physics", self.physics, PhysicsOptions)
        require_choice("sensing", self.sensing, list(SENSING))
        self._set(stride=require_number("Scenario.stride [m]", self.stride, -STRIDE_MAX, STRIDE_MAX))
        if self.stride and not self.command.stand:
            raise InvalidValueError(
                f"only a robot that stands begins astride: Scenario.stride must be 0 m without "
                f"Command(stand=True), got {self.stride:g}"
            )
        require_kind("Scenario.start", self.start, StartOffset)
        for before, change in pairwise(self.changes):
            if change.time <= before.time:
                raise InvalidValueError(
                    f"Scenario.changes must rise in time, got {change.time:g} s after {before.time:g} s"
                )

    @property
    def forces(self) -> tuple[Push, ...]:
        """The pushes of all disturbances, `pushes` first."""
        return self.pushes + tuple(push for other in self.disturbances for push in other.forces)

    @property
    def jumps(self) -> tuple[Kick, ...]:
        """The jumps of the velocity of all disturbances, first the kicks."""
        return self.kicks + tuple(kick for other in self.disturbances for kick in other.jumps)

    @property
    def floor_shifts(self) -> int:
        """By how many laws the floor accelerates, of which control knows nothing."""
        return sum(push.law is not None and push.law.accelerates for push in self.forces)

    @property
    def floor_goes(self) -> bool:
        """Whether the floor accelerates."""
        return self.floor_shifts > 0

    def end_time(self, last_push_end: float) -> float:
        """Time at which the episode is truncated [s].

        Args:
            last_push_end: latest of start + duration over the forces [s]; inf while a gait event has not come
                yet, 0 where there is no force.
        """
        last = max(last_push_end, self.last_sudden_change)
        return self.duration if self.duration is not None else last + self.settle_time

    @property
    def last_sudden_change(self) -> float:
        """Time of the last change of command or jump of the velocity [s], 0 without one."""
        times = (*(change.time for change in self.changes[-1:]), *(kick.start for kick in self.jumps))
        return max(times, default=0.0)

    @property
    def demands(self) -> frozenset[Any]:
        """What a robot has to be able to take, and may not be: kinds, bodies, names of errors and options."""
        forces, commands = self.forces, (self.command, *(change.command for change in self.changes))
        return frozenset(
            (
                *map(type, (*self.pushes, *self.kicks, *self.disturbances, *self.errors.terrains)),
                *((push.body, type(push.law)) for push in forces),
                *((command.turn != 0.0, command.stand) for command in commands),
                self.floor_shifts,
                *self.errors.names, self.errors.delay, *changed_fields(self.physics), self.sensing,
            )
        )  # fmt: skip

    def side_of_step(self, index: int) -> Side:
        """Stance side of the step with this index; sides alternate."""
        return self.stance_side if index % 2 == 0 else other_side(self.stance_side)

    def mirrored(self) -> Scenario:
        """Reflection in the x-z plane; the id gains or loses the suffix '~'."""
        return replace(
            self,
            id=self.id[:-1] if self.id.endswith("~") and len(self.id) > 1 else self.id + "~",
            command=self.command.mirrored(),
            stance_side=other_side(self.stance_side),
            errors=self.errors.mirrored(),
            start=self.start.mirrored(),
            **{name: tuple(part.mirrored() for part in getattr(self, name)) for name in _LISTS},
        )

    def scaled(self, scale: Similarity) -> Scenario:
        """The same scenario, of the same id, for a robot of another size."""
        return replace(
            self,
            command=self.command.scaled(scale),
            settle_time=self.settle_time * scale.time,
            duration=None if self.duration is None else self.duration * scale.time,
            errors=self.errors.scaled(scale),
            stride=self.stride * scale.length,
            start=self.start.scaled(scale),
            **{name: tuple(part.scaled(scale) for part in getattr(self, name)) for name in _LISTS},
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types, every field; those of `left_out` only where they are not at their default."""
        values = super().to_dict()
        for kept, other in zip(values.get("disturbances", ()), self.disturbances, strict=True):
            kept["kind"] = other.json_name
        return values

    @classmethod
    def _parsed(cls, name: str, value: Any) -> Any:
        if name in _LISTS:
            if not isinstance(value, list):
                raise InvalidValueError(f"scenario {name} must be a list, got {shown(value)}")
            read = read_disturbance if name == "disturbances" else _LISTS[name].from_dict
            return tuple(read(part) for part in value)
        return object_of(_OBJECTS[name], value) if name in _OBJECTS else value

    def to_json(self) -> str:
        """One line of canonical JSON: sorted keys, no spaces, shortest round-trip floats."""
        return json.dumps(self.to_dict(), sort_keys=True, separators=(",", ":"), allow_nan=False)


def one_of_each(scenarios: Iterable[Scenario]) -> Iterator[Scenario]:
    """Those scenarios that demand of a robot what none before did: it takes all if it takes these."""
    met: set[Any] = set()
    for scenario in scenarios:
        if not scenario.demands <= met:
            met |= scenario.demands
            yield scenario


_LISTS: dict[str, Any] = {
    "pushes": Push, "changes": CommandChange, "kicks": Kick, "disturbances": Disturbance
}  # fmt: skip
_OBJECTS = {"command": Command, "errors": ModelErrors, "physics": PhysicsOptions, "start": StartOffset}


MASS_STEP = 0.005  # of drawn masses: each has a MuJoCo model of its own


@dataclass(frozen=True)
class Profile:
    """Model errors, physics and sensing of every robot that it is applied to.

    Mass and the trunk's CoM are drawn from the noise seed of the scenario alone, uniform in their bounds.
    """

    name: str
    errors: ModelErrors = EXACT_MODEL
    physics: PhysicsOptions = PLAIN_PHYSICS
    sensing: str = EXACT_SENSING
    mass_within: float = 0.0  # relative, both ways
    trunk_com_within: float = 0.0  # [m], each axis, both ways

    def applied(self, scenario: Scenario) -> Scenario:
        """The scenario on such a robot, of the same id and noise seed; what it says itself stands."""
        return replace(
            scenario,
            errors=replace(self._drawn(scenario.noise_seed), **changed_fields(scenario.errors)),
            physics=replace(self.physics, **changed_fields(scenario.physics)),
            sensing=self.sensing if scenario.sensing == EXACT_SENSING else scenario.sensing,
        )

    def _drawn(self, noise_seed: int) -> ModelErrors:
        if not (self.mass_within or self.trunk_com_within):
            return self.errors
        heavy, *off = np.random.default_rng([noise_seed, *map(ord, self.name)]).uniform(-1.0, 1.0, 4).tolist()
        mass = round(MASS_STEP * round(heavy * self.mass_within / MASS_STEP), 6)
        x, y, z = (round(share * self.trunk_com_within, 4) for share in off)
        return replace(self.errors, mass=self.errors.mass + mass, trunk_com=(x, y, z))

    def scaled(self, scale: Similarity) -> Profile:
        """The same profile for a robot of another size."""
        within = self.trunk_com_within * scale.length
        return replace(self, errors=self.errors.scaled(scale), trunk_com_within=within)


EXACT = Profile("exact")
# whose legs do not pass through each other
COLLISIONS = Profile("collisions", ModelErrors(collisions=True))
HARDWARE = Profile(
    "hardware",
    ModelErrors(
        friction=0.7,
        delay=0.004,
        joint_friction=1.0,
        armature=0.03,
        collisions=True,
        motor_power=2000.0,
        bus_power=3000.0,
        continuous_torque=0.4,
    ),
    PhysicsOptions(time_step=0.001, cone="elliptic", impratio=10.0),
    ONBOARD,
)
# the same, whose mass and trunk are known as well as scales and a balance tell
WEIGHED = replace(HARDWARE, name="weighed", mass_within=0.02, trunk_com_within=0.01)
PROFILES: Mapping[str, Profile] = MappingProxyType(
    {one.name: one for one in (EXACT, COLLISIONS, HARDWARE, WEIGHED)}
)


@dataclass(frozen=True)
class Profiles:
    """Profiles of which the noise seed of each scenario draws one, all equally likely."""

    of: tuple[Profile, ...]

    def applied(self, scenario: Scenario) -> Scenario:
        """The scenario on a robot of the profile that is drawn, see `Profile.applied`."""
        index = np.random.default_rng([scenario.noise_seed, len(self.of)]).integers(len(self.of))
        return self.of[int(index)].applied(scenario)

    def scaled(self, scale: Similarity) -> Profiles:
        """The same profiles for a robot of another size."""
        return Profiles(tuple(one.scaled(scale) for one in self.of))


def get_profile(name: str) -> Profile:
    """A profile by name; raises UnknownNameError listing the valid ones."""
    require_choice("profile", name, list(PROFILES))
    return PROFILES[name]


def get_profiles(names: str | Sequence[str]) -> Profile | Profiles:
    """A profile by name, or several of which each scenario draws one.

    Raises:
        UnknownNameError: there is no such profile; lists the valid ones.
        InvalidValueError: no name at all.
    """
    names = tuple(names) if isinstance(names, Iterable) and not isinstance(names, str) else (names,)
    if not names:
        raise InvalidValueError("profile must be at least one name")
    found = tuple(get_profile(name) for name in names)
    return found[0] if len(found) == 1 else Profiles(found)
