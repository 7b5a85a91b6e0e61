"""What the robot is told to do: a velocity, and changes of it while it walks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ...controllers.errors import InvalidValueError, shown
from ...controllers.model.similarity import Similarity
from ...controllers.validation import require_keys, require_number

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
