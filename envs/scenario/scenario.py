"""Scenarios: all that happens to the robot in one episode, fixed before it begins.

What the robot is told to do: a velocity, and changes of it while it walks.

Profiles: how real the simulated robot is, as one name for model errors, physics and sensing.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Any

from ...controllers.errors import InvalidValueError, shown
from ...controllers.model.robot import Similarity
from ...controllers.validation import (
    changed_fields,
    parse_json,
    require_choice,
    require_integer,
    require_keys,
    require_kind,
    require_number,
)
from .model_errors import EXACT_MODEL, PLAIN_PHYSICS, ModelErrors, PhysicsOptions
from .push import SIDES, Kick, Push, Side, other_side

FASTEST_TURN = 0.6  # [rad/s]


@dataclass(frozen=True)
class Command:
    """Commanded mean velocity in the heading frame, and how fast the heading turns."""

    vx: float = 0.0  # forward [m/s]
    vy: float = 0.0  # to the left [m/s]
    turn: float = 0.0  # to the left [rad/s]

    def __post_init__(self) -> None:
        object.__setattr__(self, "vx", require_number("Command.vx [m/s]", self.vx, -5.0, 5.0))
        object.__setattr__(self, "vy", require_number("Command.vy [m/s]", self.vy, -5.0, 5.0))
        turn = require_number("Command.turn [rad/s]", self.turn, -FASTEST_TURN, FASTEST_TURN)
        object.__setattr__(self, "turn", turn)

    def mirrored(self) -> Command:
        """Sideways velocity and turning negated."""
        return Command(self.vx, 0.0 - self.vy, 0.0 - self.turn)

    def scaled(self, scale: Similarity) -> Command:
        """The same command for a robot of another size; none turns faster than FASTEST_TURN."""
        turn = min(max(self.turn / scale.time, -FASTEST_TURN), FASTEST_TURN)
        return Command(self.vx * scale.velocity, self.vy * scale.velocity, turn)

    def to_dict(self) -> dict[str, float]:
        """Plain JSON types; `turn` is left out where it is 0."""
        values = {"vx": self.vx, "vy": self.vy}
        return {**values, "turn": self.turn} if self.turn else values

    @classmethod
    def from_dict(cls, data: object) -> Command:
        """Inverse of `to_dict`."""
        return cls(**require_keys("command", data, set(), {"vx", "vy", "turn"}))


IN_PLACE = Command()


@dataclass(frozen=True)
class CommandChange:
    """From the first planning period that begins at `time` or later, another command is in force."""

    time: float  # since reset [s]
    command: Command

    def __post_init__(self) -> None:
        time = require_number("CommandChange.time [s]", self.time, 0.0, open_low=True)
        object.__setattr__(self, "time", time)
        if not isinstance(self.command, Command):
            raise InvalidValueError(f"CommandChange.command must be a Command, got {self.command!r}")

    def mirrored(self) -> CommandChange:
        """The mirrored command at the same time."""
        return CommandChange(self.time, self.command.mirrored())

    def scaled(self, scale: Similarity) -> CommandChange:
        """The same change for a robot of another size."""
        return CommandChange(self.time * scale.time, self.command.scaled(scale))

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return {"time": self.time, "command": self.command.to_dict()}

    @classmethod
    def from_dict(cls, data: object) -> CommandChange:
        """Inverse of `to_dict`."""
        values = require_keys("command change", data, {"time", "command"}, set())
        return cls(values["time"], Command.from_dict(values["command"]))


def check_changes(changes: object) -> tuple[CommandChange, ...]:
    """Changes of a scenario as a tuple.

    Raises:
        InvalidValueError: something else among them, or times that do not rise.
    """
    if not isinstance(changes, Iterable):
        raise InvalidValueError(f"Scenario.changes must be a sequence of CommandChange, got {shown(changes)}")
    checked: list[CommandChange] = []
    for change in changes:
        if not isinstance(change, CommandChange):
            raise InvalidValueError(f"Scenario.changes must hold CommandChange objects, got {change!r}")
        if checked and change.time <= checked[-1].time:
            raise InvalidValueError(
                f"Scenario.changes must rise in time, got {change.time:g} s after {checked[-1].time:g} s"
            )
        checked.append(change)
    return tuple(checked)


SETTLE_TIME = 4.0  # an episode ends this long after the last push ended [s]
SEED_MAX = 2**128 - 1  # the noise takes the lowest 64 bits
EXACT_SENSING, ONBOARD = SENSING = ("exact", "onboard")  # see `Scenario.sensing`
__all__ = ["SETTLE_TIME", "Command", "CommandChange", "Kick", "Scenario"]


@dataclass(frozen=True)
class Scenario:
    """One episode, complete: the same scenario and policy give the same outcome bit for bit.

    The robot starts at the beginning of a nominal step (for the command) on `stance_side`. The episode ends
    at `duration` where that is given, otherwise `settle_time` after the last push has ended, the last kick
    has come and the command has changed for the last time (after reset where there is none of them).
    """

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
    sensing: str = EXACT_SENSING  # what control acts on: the true state, or what "onboard" sensors tell
    kicks: tuple[Kick, ...] = ()  # jumps of the velocity

    def __post_init__(self) -> None:
        if not isinstance(self.id, str) or not self.id:
            raise InvalidValueError(f"Scenario.id must be a non-empty string, got {self.id!r}")
        if not isinstance(self.pushes, Iterable):
            raise InvalidValueError(f"Scenario.pushes must be a sequence of Push, got {shown(self.pushes)}")
        pushes = tuple(self.pushes)
        if bad := [push for push in pushes if not isinstance(push, Push)]:
            raise InvalidValueError(f"Scenario.pushes must hold Push objects, got {bad[0]!r}")
        object.__setattr__(self, "pushes", pushes)
        if not isinstance(self.command, Command):
            raise InvalidValueError(f"Scenario.command must be a Command, got {self.command!r}")
        require_choice("stance side", self.stance_side, SIDES)
        settle = require_number("Scenario.settle_time [s]", self.settle_time, 0.0, open_low=True)
        object.__setattr__(self, "settle_time", settle)
        if self.duration is not None:
            duration = require_number("Scenario.duration [s]", self.duration, 0.0, open_low=True)
            object.__setattr__(self, "duration", duration)
        object.__setattr__(
            self, "noise_seed", require_integer("Scenario.noise_seed", self.noise_seed, high=SEED_MAX)
        )
        if not isinstance(self.errors, ModelErrors):
            raise InvalidValueError(f"Scenario.errors must be ModelErrors, got {self.errors!r}")
        require_kind("Scenario.physics", self.physics, PhysicsOptions)
        require_choice("sensing", self.sensing, SENSING)
        object.__setattr__(self, "changes", check_changes(self.changes))
        kicks = tuple(self.kicks) if isinstance(self.kicks, Iterable) else (self.kicks,)
        if bad := [kick for kick in kicks if not isinstance(kick, Kick)]:
            raise InvalidValueError(f"Scenario.kicks must be a sequence of Kick, got {shown(bad[0])}")
        object.__setattr__(self, "kicks", kicks)

    def end_time(self, last_push_end: float) -> float:
        """Time at which the episode is truncated [s].

        Args:
            last_push_end: latest of start + duration over the pushes [s]; inf while a gait event has not come
                yet, 0 where there is no push.
        """
        last = max(last_push_end, self.last_change, self.last_kick)
        return self.duration if self.duration is not None else last + self.settle_time

    @property
    def last_change(self) -> float:
        """Time of the last change of command [s], 0 without one."""
        return self.changes[-1].time if self.changes else 0.0

    @property
    def last_kick(self) -> float:
        """Time of the last kick [s], 0 without one."""
        return max((kick.start for kick in self.kicks), default=0.0)

    def side_of_step(self, index: int) -> Side:
        """Stance side of the step with this index; sides alternate."""
        return self.stance_side if index % 2 == 0 else other_side(self.stance_side)

    def mirrored(self) -> Scenario:
        """Reflection in the x-z plane; the id gains or loses the suffix '~'."""
        name = self.id[:-1] if self.id.endswith("~") and len(self.id) > 1 else self.id + "~"
        return Scenario(
            id=name,
            pushes=tuple(push.mirrored() for push in self.pushes),
            command=self.command.mirrored(),
            stance_side=other_side(self.stance_side),
            settle_time=self.settle_time,
            duration=self.duration,
            noise_seed=self.noise_seed,
            errors=self.errors.mirrored(),
            changes=tuple(change.mirrored() for change in self.changes),
            physics=self.physics,
            sensing=self.sensing,
            kicks=tuple(kick.mirrored() for kick in self.kicks),
        )

    def scaled(self, scale: Similarity) -> Scenario:
        """The same scenario, of the same id, for a robot of another size."""
        return replace(
            self,
            pushes=tuple(push.scaled(scale) for push in self.pushes),
            command=self.command.scaled(scale),
            settle_time=self.settle_time * scale.time,
            duration=None if self.duration is None else self.duration * scale.time,
            errors=self.errors.scaled(scale),
            changes=tuple(change.scaled(scale) for change in self.changes),
            kicks=tuple(kick.scaled(scale) for kick in self.kicks),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types, every field; the last five only where they are not at their default."""
        values: dict[str, Any] = {
            "id": self.id,
            "pushes": [push.to_dict() for push in self.pushes],
            "command": self.command.to_dict(),
            "stance_side": self.stance_side,
            "settle_time": self.settle_time,
            "duration": self.duration,
            "noise_seed": self.noise_seed,
        }
        if self.errors != EXACT_MODEL:
            values["errors"] = self.errors.to_dict()
        if self.changes:
            values["changes"] = [change.to_dict() for change in self.changes]
        if self.physics != PLAIN_PHYSICS:
            values["physics"] = self.physics.to_dict()
        if self.sensing != EXACT_SENSING:
            values["sensing"] = self.sensing
        if self.kicks:
            values["kicks"] = [kick.to_dict() for kick in self.kicks]
        return values

    @classmethod
    def from_dict(cls, data: object) -> Scenario:
        """Inverse of `to_dict`; fields other than the id may be left out."""
        optional = {f.name for f in fields(cls)} - {"id"}
        values = dict(require_keys("scenario", data, {"id"}, optional))
        for name, kind in (("pushes", Push), ("changes", CommandChange), ("kicks", Kick)):
            if not isinstance(values.get(name, []), list):
                raise InvalidValueError(f"scenario {name} must be a list, got {values[name]!r}")
            if name in values:
                values[name] = tuple(kind.from_dict(part) for part in values[name])
        if "command" in values:
            values["command"] = Command.from_dict(values["command"])
        if "errors" in values:
            values["errors"] = ModelErrors.from_dict(values["errors"])
        if "physics" in values:
            values["physics"] = PhysicsOptions.from_dict(values["physics"])
        return cls(**values)

    def to_json(self) -> str:
        """One line of canonical JSON: sorted keys, no spaces, shortest round-trip floats."""
        return json.dumps(self.to_dict(), sort_keys=True, separators=(",", ":"), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Scenario:
        """Inverse of `to_json`; raises InvalidValueError on text that is no JSON."""
        return cls.from_dict(parse_json("scenario", text))


@dataclass(frozen=True)
class Profile:
    """Model errors, physics and sensing of every robot that it is applied to."""

    name: str
    errors: ModelErrors = EXACT_MODEL
    physics: PhysicsOptions = PLAIN_PHYSICS
    sensing: str = EXACT_SENSING

    def applied(self, scenario: Scenario) -> Scenario:
        """The scenario on such a robot, of the same id and noise seed; what it says itself stands."""
        return replace(
            scenario,
            errors=_completed(scenario.errors, self.errors),
            physics=_completed(scenario.physics, self.physics),
            sensing=self.sensing if scenario.sensing == EXACT_SENSING else scenario.sensing,
        )

    def scaled(self, scale: Similarity) -> Profile:
        """The same profile for a robot of another size."""
        return replace(self, errors=self.errors.scaled(scale))


def _completed(own: Any, common: Any) -> Any:
    """A dataclass with the fields of `common` where its own are at their default."""
    return replace(common, **changed_fields(own))


EXACT = Profile("exact")
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
PROFILES: Mapping[str, Profile] = MappingProxyType({profile.name: profile for profile in (EXACT, HARDWARE)})


def get_profile(name: str) -> Profile:
    """A profile by name; raises UnknownNameError listing the valid ones."""
    require_choice("profile", name, list(PROFILES))
    return PROFILES[name]
