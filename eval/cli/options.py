"""Options that several commands share, and the bounds of their numbers.

Archives of Stable-Baselines3 among the policies of a command, where the user trusts what is in them.

The page of a command: written where its extra is installed, and how to get it where not.

What the options of several commands have in common, and the bounds of their numbers.

A command is a frozen dataclass: its fields are the options, the texts below them the help, with units.
What is slow to load is imported by the functions that need it, so that `--help` stays quick.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from ...controllers.errors import InvalidValueError, MissingExtraError, is_finite_number, shown
from ...envs.scenario.model_errors import ModelErrors
from ...envs.scenario.push import Body
from ..rollout.names import DEFAULT_ENV, SUITE_NAMES, default_workers

ARCHIVE = ".zip"
LOADER = "...training.model_policy"  # a package after this one, which is loaded only where it is needed


def trusted(policies: Sequence[str], trust: bool) -> list[Any]:
    """The policies with every FILE.zip as a policy of that label; without trust they stay, to be refused.

    Raises:
        InvalidValueError: a file can't be read.
    """
    if not trust or not any(name.endswith(ARCHIVE) for name in policies):
        return list(policies)
    archive = import_module(LOADER, __package__).ArchivePolicy
    return [{name: archive.of(name)} if name.endswith(ARCHIVE) else name for name in policies]


def write_or_say(write: Callable[[], Path]) -> Path | None:
    """Write a page; where its extra is missing, say so in one line on standard error and go on."""
    try:
        return write()
    except MissingExtraError as error:
        print(f"no report.html: {error}", file=sys.stderr)
        return None


def print_page(path: Path | None) -> None:
    """Where the page is, if there is one."""
    if path is not None:
        print(f"page: {path}")


Flag = Annotated[bool, arg(help_behavior_hint="")]
Directory = Annotated[str | None, arg(metavar="DIR", help_behavior_hint="")]
Preset = Annotated[str | None, arg(metavar="NAME|FILE", help_behavior_hint="")]
Count = Annotated[int, arg(metavar="N")]
Address = Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="")]
Real = Annotated[float, arg(metavar="X")]
PolicyName = Annotated[str, arg(metavar="NAME|FILE")]
SUITES_TEXT = f"Suite of pushes: {', '.join(SUITE_NAMES)}, or a JSON file."
PROFILE_TEXT = (
    "How real the robot is: exact, as the planner takes it to be, or hardware, with its own sensors, losses, "
    "delay and collisions (docs/scenarios.md)."
)
ERRORS_TEXT = (
    "How robot and floor differ from what the planner believes, in every scenario, such as "
    '\'{"mass": 0.1, "friction": 0.6, "delay": 0.01, "dcm_noise": 0.01}\' (docs/scenarios.md).'
)


def within(low: float, high: float = math.inf) -> dict[str, tuple[float, float]]:
    """Metadata of a field whose number must be finite and in [low, high], or None."""
    return {"bounds": (low, high)}


def option(name: str) -> str:
    """An option as the user writes it, from the name of its field."""
    return "--" + name.replace("_", "-")


def check_bounds(name: str, value: object, low: float, high: float) -> None:
    """Raise InvalidValueError where a number is not finite or not in [low, high]."""
    if not (is_finite_number(value) and low <= float(value) <= high):  # pyright: ignore[reportArgumentType]
        bound = f">= {low:g}" if high == math.inf else f"in [{low:g}, {high:g}]"
        kind = "an integer" if isinstance(value, int) else "a number"
        raise InvalidValueError(f"{option(name)} must be {kind} {bound}, got {shown(value)}")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a command.

    Raises:
        InvalidValueError: A number is out of its bounds, a list that needs a value is empty, or a directory
            has an empty name, as of an unset variable.
    """

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if "bounds" in entry.metadata and value is not None:
                check_bounds(entry.name, value, *entry.metadata["bounds"])
            if value == ():
                raise InvalidValueError(f"{option(entry.name)} needs at least one value")
            if entry.name in {"out", "resume"} and value is not None and not str(value).strip():
                raise InvalidValueError(
                    f"{option(entry.name)} must name a directory or a file, got an empty string"
                )

    def defaults(self) -> Options | None:
        """What the options not given stand for, where it depends on the ones given."""
        return None

    def run(self) -> None:
        """Do what the command says."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class JsonOption(Options):
    """Of a command that can tell its result as JSON."""

    json: Flag = False
    """Print one JSON object on standard output, and nothing else there."""

    def print_json(self, content: dict[str, Any]) -> None:
        """The one object of `--json`."""
        print(json.dumps(content, allow_nan=False))


@dataclass(frozen=True, kw_only=True)
class EnvOptions(Options):
    """Of a command that makes environments."""

    env: Annotated[str, arg(metavar="ID")] = DEFAULT_ENV
    """Id of the environment (see list)."""
    preset: Preset = None
    """Preset of planner and robot, such as one that tune has found (by default the environment's own)."""

    @property
    def env_id(self) -> str:
        """Environment id with its preset."""
        from ..rollout.environments import with_preset

        return with_preset(self.env, self.preset)


@dataclass(frozen=True, kw_only=True)
class ErrorOptions(Options):
    """Of a command whose robots may be off from the planner's model."""

    errors: Annotated[str, arg(metavar="JSON", help=ERRORS_TEXT)] = "{}"

    @property
    def model_errors(self) -> ModelErrors:
        """The errors, checked."""
        return ModelErrors.from_json(self.errors)


@dataclass(frozen=True, kw_only=True)
class RobotOptions(ErrorOptions):
    """Of a command whose robots are of a profile."""

    profile: Annotated[str, arg(metavar="NAME", help=PROFILE_TEXT)] = "exact"


@dataclass(frozen=True, kw_only=True)
class WorkerOptions(JsonOption):
    """Of a command that runs episodes in processes."""

    workers: Count = field(default_factory=default_workers, metadata=within(1))
    """Number of processes; it changes no result."""
    ray: Address = None
    """Run on a Ray cluster instead (extra `ray`): HOST:PORT, auto, or local for one of this machine alone
    with --workers processes; changes no result (docs/your_own.md)."""

    @cached_property
    def processes(self) -> int:
        """Where episodes run; connects to the cluster that is named."""
        if self.ray is None:
            return self.workers
        from ..output.processes import ray_workers

        return ray_workers(self.ray, self.workers)


@dataclass(frozen=True, kw_only=True)
class RunningOptions(WorkerOptions):
    """Of a command that runs episodes in processes and keeps their rows."""

    out: Directory = None
    """Directory for the results. One of the same configuration is resumed (by default a directory under runs/
    that is named after the configuration)."""
    overwrite: Flag = False
    """Start over if DIR already holds results."""

    @property
    def directory(self) -> Path | None:
        """Where the results go; None: by the configuration."""
        return None if self.out is None else Path(self.out)


@dataclass(frozen=True, kw_only=True)
class VelocityOptions(Options):
    """Commanded velocity."""

    vx: Real = field(default=0.0, metadata=within(-2, 2))
    """Commanded forward velocity [m/s]."""
    vy: Real = field(default=0.0, metadata=within(-2, 2))
    """Commanded velocity to the left [m/s]."""


@dataclass(frozen=True, kw_only=True)
class PushOptions(VelocityOptions):
    """What all pushes of a scan have in common."""

    duration: Real = field(default=0.1, metadata=within(1e-3, 2))
    """Duration of the push [s]."""
    body: Body = "pelvis"
    """The body that is pushed."""
