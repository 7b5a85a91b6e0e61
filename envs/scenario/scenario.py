"""Scenarios: all that happens to the robot in one episode, fixed before it begins."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ...controllers.errors import InvalidValueError, shown
from ...controllers.json_text import parse_json
from ...controllers.validation import require_choice, require_integer, require_keys, require_number
from .command import IN_PLACE, Command, CommandChange, check_changes
from .error_ranges import ErrorRanges
from .model_errors import EXACT_MODEL, ModelErrors
from .push import (
    DURATION_MAX,
    FORCE_MAX,
    SIDES,
    STEP_MAX,
    GaitEvent,
    Push,
    Side,
    other_side,
    polar_push,
)

SETTLE_TIME = 4.0  # an episode ends this long after the last push ended [s]
SEED_MAX = 2**128 - 1  # the noise takes the lowest 64 bits
__all__ = ["SETTLE_TIME", "Command", "CommandChange", "PushDistribution", "Scenario"]


@dataclass(frozen=True)
class Scenario:
    """One episode, complete: the same scenario and policy give the same outcome bit for bit.

    The robot starts at the beginning of a nominal step (for the command) on `stance_side`. The episode ends
    at `duration` where that is given, otherwise `settle_time` after the last push has ended and the command
    has changed for the last time (after reset where there is neither).
    """

    id: str
    pushes: tuple[Push, ...] = ()
    command: Command = IN_PLACE  # until the first of `changes`
    stance_side: Side = "left"  # of step 0
    settle_time: float = SETTLE_TIME  # [s]
    duration: float | None = None  # [s] from reset
    noise_seed: int = 0  # of the noise of `errors`
    errors: ModelErrors = EXACT_MODEL  # what planner and control do not know
    changes: tuple[CommandChange, ...] = ()  # of the command, rising in time

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
        object.__setattr__(self, "changes", check_changes(self.changes))

    def end_time(self, last_push_end: float) -> float:
        """Time at which the episode is truncated [s].

        Args:
            last_push_end: latest of start + duration over the pushes [s]; inf while a gait event has not come
                yet, 0 where there is no push.
        """
        last = max(last_push_end, self.last_change)
        return self.duration if self.duration is not None else last + self.settle_time

    @property
    def last_change(self) -> float:
        """Time of the last change of command [s], 0 without one."""
        return self.changes[-1].time if self.changes else 0.0

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
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types, every field; `errors` and `changes` are left out where there are none."""
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
        return values

    @classmethod
    def from_dict(cls, data: object) -> Scenario:
        """Inverse of `to_dict`; fields other than the id may be left out."""
        optional = {f.name for f in fields(cls)} - {"id"}
        values = dict(require_keys("scenario", data, {"id"}, optional))
        for name, kind in (("pushes", Push), ("changes", CommandChange)):
            if not isinstance(values.get(name, []), list):
                raise InvalidValueError(f"scenario {name} must be a list, got {values[name]!r}")
            if name in values:
                values[name] = tuple(kind.from_dict(part) for part in values[name])
        if "command" in values:
            values["command"] = Command.from_dict(values["command"])
        if "errors" in values:
            values["errors"] = ModelErrors.from_dict(values["errors"])
        return cls(**values)

    def to_json(self) -> str:
        """One line of canonical JSON: sorted keys, no spaces, shortest round-trip floats."""
        return json.dumps(self.to_dict(), sort_keys=True, separators=(",", ":"), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Scenario:
        """Inverse of `to_json`; raises InvalidValueError on text that is no JSON."""
        return cls.from_dict(parse_json("scenario", text))


TURNS = 100.0 * math.pi  # bound of a direction, both ways [rad]
COMMAND_KINDS = ("in_place", "forward", "backward", "sideways")


@dataclass(frozen=True)
class PushDistribution:
    """Scenarios with one push each, drawn from a Generator; used by `reset` without a scenario.

    Impulse, direction and phase are uniform; the command is in place, forward, backward or sideways with
    equal probability and a uniform speed up to its maximum. Model errors come from `errors`.
    """

    impulse_min: float = 5.0  # [N s]
    impulse_max: float = 80.0  # [N s]
    direction_min: float = -math.pi  # psi, counter-clockwise from forward [rad]
    direction_max: float = math.pi  # [rad]
    phase_max: float = 0.9  # latest start, fraction of the step
    push_duration: float = 0.1  # [s]
    first_step: int = 4  # pushes start no earlier than this step
    forward_speed: float = 0.5  # [m/s]
    backward_speed: float = 0.25  # [m/s]
    sideways_speed: float = 0.2  # [m/s], to either side
    settle_time: float = SETTLE_TIME  # [s]
    errors: ErrorRanges | None = None  # of the robot, drawn anew for every scenario

    def __post_init__(self) -> None:
        if isinstance(self.errors, Mapping):  # of JSON
            object.__setattr__(self, "errors", ErrorRanges.from_dict(self.errors))
        if not isinstance(self.errors, ErrorRanges | None):
            raise InvalidValueError(f"PushDistribution.errors must be ErrorRanges, got {self.errors!r}")
        require_number("PushDistribution.impulse_min [N s]", self.impulse_min, 0.0)
        require_number("PushDistribution.impulse_max [N s]", self.impulse_max, self.impulse_min)
        require_number("PushDistribution.direction_min [rad]", self.direction_min, -TURNS, TURNS)
        require_number("PushDistribution.direction_max [rad]", self.direction_max, self.direction_min, TURNS)
        require_number("PushDistribution.phase_max", self.phase_max, 0.0, 1.0)
        duration = self.push_duration
        require_number("PushDistribution.push_duration [s]", duration, 0.0, DURATION_MAX, open_low=True)
        hardest = self.impulse_max / duration
        if not hardest <= FORCE_MAX:
            raise InvalidValueError(
                f"PushDistribution.impulse_max / push_duration must be at most {FORCE_MAX:g} N, got "
                f"{self.impulse_max:g} N s / {duration:g} s = {hardest:g} N"
            )
        require_integer("PushDistribution.first_step", self.first_step, high=STEP_MAX)
        for name in ("forward_speed", "backward_speed", "sideways_speed"):
            require_number(f"PushDistribution.{name} [m/s]", getattr(self, name), 0.0, 5.0)
        require_number("PushDistribution.settle_time [s]", self.settle_time, 0.0, open_low=True)

    def command(self, kind: int, speed: float, to_left: bool) -> Command:
        """Command of a kind (index into COMMAND_KINDS) at a fraction `speed` in [0, 1] of its maximum."""
        if COMMAND_KINDS[kind] == "forward":
            return Command(vx=speed * self.forward_speed)
        if COMMAND_KINDS[kind] == "backward":
            return Command(vx=-speed * self.backward_speed)
        if COMMAND_KINDS[kind] == "sideways":
            return Command(vy=(speed if to_left else -speed) * self.sideways_speed)
        return Command()

    def sample(self, rng: np.random.Generator, scenario_id: str | None = None) -> Scenario:
        """Draw one scenario; always the same number of draws, so that episodes stay comparable."""
        u = rng.random(8)
        noise_seed = int(rng.integers(2**31))
        errors = EXACT_MODEL if self.errors is None else self.errors.sample(rng)
        impulse = self.impulse_min + u[0] * (self.impulse_max - self.impulse_min)
        direction = self.direction_min + u[1] * (self.direction_max - self.direction_min)
        event = GaitEvent(self.first_step, "left" if u[2] < 0.5 else "right", float(u[3] * self.phase_max))
        kind = min(int(u[4] * len(COMMAND_KINDS)), len(COMMAND_KINDS) - 1)
        return Scenario(
            id=scenario_id or f"random-{noise_seed:08x}",
            pushes=(
                polar_push(float(impulse / self.push_duration), float(direction), self.push_duration, event),
            ),
            command=self.command(kind, float(u[5]), bool(u[6] < 0.5)),
            stance_side="left" if u[7] < 0.5 else "right",
            settle_time=self.settle_time,
            noise_seed=noise_seed,
            errors=errors,
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types; `errors` is left out where it is not given."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "errors"}
        return values if self.errors is None else {**values, "errors": self.errors.to_dict()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PushDistribution:
        """Inverse of `to_dict`; fields may be left out."""
        names = set(cls.__dataclass_fields__)
        return cls(**require_keys("push distribution", data, set(), names))
