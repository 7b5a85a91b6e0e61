"""Options that several commands share, the bounds of their numbers, and how results are printed.

A command is a frozen dataclass: its fields are the options, the texts below them the help, with units.
What is slow to load is imported by the functions that need it, so that `--help` stays quick.
"""

import json
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from ...controllers.errors import InvalidValueError, MissingExtraError, is_finite_number, shown
from ...envs.scenario.model_errors import ModelErrors
from ...envs.scenario.push import Body
from ...envs.scenario.scenario import Command
from ..output.tables import Table
from ..rollout import DEFAULT_ENV, REPLICAS, SUITE_NAMES, default_workers

SUITES_TEXT = f"Suite of pushes: {', '.join(SUITE_NAMES)}, or a JSON file."
POLICIES_TEXT = "Policies to run: names (see list), policy files, or MODULE:ATTRIBUTE."
PROFILE_TEXT = (
    "How real the robot is: exact, as the planner takes it to be; collisions, the same with legs, arms and "
    "trunk that collide; hardware, with its own sensors, losses and delay, too; or weighed, the same with "
    "masses known to 2 % (docs/scenarios.md)."
)
ERRORS_TEXT = (
    "How robot and floor differ from what the planner believes, in every scenario, such as "
    '\'{"mass": 0.1, "friction": 0.6, "delay": 0.01, "dcm_noise": 0.01}\' (docs/scenarios.md).'
)
Flag = Annotated[bool, arg(help_behavior_hint="")]
Directory = Annotated[str | None, arg(metavar="DIR", help_behavior_hint="")]
FileName = Annotated[str | None, arg(metavar="FILE", help_behavior_hint="")]
NameOrFile = Annotated[str | None, arg(metavar="NAME|FILE", help_behavior_hint="")]
Count = Annotated[int, arg(metavar="N")]
CountOrNone = Annotated[int | None, arg(metavar="N", help_behavior_hint="")]
Real = Annotated[float, arg(metavar="X")]
RealOrNone = Annotated[float | None, arg(metavar="X", help_behavior_hint="")]
PolicyName = Annotated[str, arg(metavar="NAME|FILE")]
Policies = Annotated[tuple[str, ...], arg(metavar="NAME|FILE", help=POLICIES_TEXT)]
SuiteName = Annotated[str, arg(metavar="NAME|FILE", help=SUITES_TEXT)]


def within(low: float, high: float = math.inf) -> dict[str, tuple[float, float]]:
    """Metadata of a field whose number must be finite and in [low, high], or None."""
    return {"bounds": (low, high)}


def pushes_of(command: Any, suite: str | None, profile: str, sample: int | None = None) -> Any:
    """A suite on the robots of a command, with its model errors, or a sample evenly spread over it."""
    from ..score import sensitivity, suites

    found = suites.pushes_on(command.env_id, suite, command.model_errors, profile)
    return found if sample is None else sensitivity.sample_of(found, sample)


def page_lines(write: Callable[[], Path]) -> list[str]:
    """Write a page, and say where it is; where its extra is missing, say so on standard error and go on."""
    try:
        return [f"page: {write()}"]
    except MissingExtraError as error:
        print(f"no report.html: {error}", file=sys.stderr)
        return []


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a command.

    Raises:
        InvalidValueError: A number is out of its bounds, a list that needs a value is empty, or a directory
            has an empty name, as of an unset variable.
    """

    @classmethod
    def epilog(cls) -> str:
        """Text that follows the help; by default none."""
        return ""

    def __post_init__(self) -> None:
        for entry in fields(self):
            value, option = getattr(self, entry.name), "--" + entry.name.replace("_", "-")
            low, high = entry.metadata.get("bounds", (-math.inf, math.inf))
            if "bounds" in entry.metadata and value is not None and not (
                is_finite_number(value) and low <= value <= high
            ):  # fmt: skip
                bound = f">= {low:g}" if high == math.inf else f"in [{low:g}, {high:g}]"
                kind = "an integer" if isinstance(value, int) else "a number"
                raise InvalidValueError(f"{option} must be {kind} {bound}, got {shown(value)}")
            if value == ():
                raise InvalidValueError(f"{option} needs at least one value")
            if entry.name in {"out", "resume"} and value is not None and not str(value).strip():
                raise InvalidValueError(f"{option} must name a directory or a file, got an empty string")

    def defaults(self) -> "Options | None":
        """Values of the options that are not given, where they depend on the ones given; else None."""
        return None

    def run(self) -> None:
        """Do what the command says."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class JsonOption(Options):
    """Options of a command that can print its result as JSON."""

    json: Flag = False
    """Print one JSON object on standard output, and nothing else there."""

    def show(self, content: dict[str, Any], tables: Iterable[Table] = (), lines: Iterable[str] = ()) -> None:
        """Print a result: as the one object of `--json`, or else its tables and then lines of text."""
        if self.json:
            print(json.dumps(content, allow_nan=False))
            return
        for table in tables:
            table.print()
        for line in lines:
            print(line)


ARCHIVE = ".zip"  # of Stable-Baselines3
ARCHIVES = "...training.model_policy"  # a package after this one, which is loaded only where it is needed


@dataclass(frozen=True, kw_only=True)
class TrustOption(Options):
    """Whether policies may be files that run code when they are loaded."""

    trust: Flag = False
    """Take archives of Stable-Baselines3 (FILE.zip) and networks in TorchScript as policies: loading one runs
    the code that is in it, as you (docs/reliability.md). An archive does not show wrappers of its training
    that keep both spaces."""

    def trusted(self, policies: Sequence[str]) -> list[Any]:
        """The policies, those that may run code under their label; without trust they stay, to be refused."""
        from ..rollout.contract_files import trusted

        if not self.trust:
            return list(policies)

        def one(name: str) -> Any:
            if name.endswith(ARCHIVE):
                return {name: import_module(ARCHIVES, __package__).ArchivePolicy.of(name)}
            return trusted(name)

        return [one(name) for name in policies]


@dataclass(frozen=True, kw_only=True)
class EnvOptions(Options):
    """Options of a command that makes environments."""

    env: Annotated[str, arg(metavar="ID")] = DEFAULT_ENV
    """Id of the environment (see list)."""
    preset: NameOrFile = None
    """Preset of planner and robot, such as one that tune has found (by default the environment's own)."""

    @property
    def env_id(self) -> str:
        """Environment id with its preset."""
        from ..rollout.environments import with_preset

        return with_preset(self.env, self.preset)


@dataclass(frozen=True, kw_only=True)
class ErrorOptions(Options):
    """Options of a command whose robots may be off from the planner's model."""

    errors: Annotated[str, arg(metavar="JSON", help=ERRORS_TEXT)] = "{}"

    @property
    def model_errors(self) -> ModelErrors:
        """The errors, checked."""
        return ModelErrors.from_json(self.errors)


@dataclass(frozen=True, kw_only=True)
class RobotOptions(ErrorOptions):
    """Options of a command whose robots are of a profile."""

    profile: Annotated[str, arg(metavar="NAME", help=PROFILE_TEXT)] = "exact"


@dataclass(frozen=True, kw_only=True)
class WorkerOptions(JsonOption):
    """Options of a command that runs episodes in processes."""

    workers: Count = field(default_factory=default_workers, metadata=within(1))
    """Number of processes; it changes no result."""
    ray: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="")] = None
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
    """Options of a command that runs episodes in processes and keeps their rows."""

    out: Directory = None
    """Directory for the results. One of the same configuration is resumed (by default a directory under runs/
    that is named after the configuration)."""
    overwrite: Flag = False
    """Start over if DIR already holds results."""

    @property
    def directory(self) -> Path | None:
        """Where the results go; None: a directory named after the configuration."""
        return None if self.out is None else Path(self.out)


@dataclass(frozen=True, kw_only=True)
class PushOptions(RobotOptions):
    """Options of a push but for its force and direction."""

    vx: Real = field(default=0.0, metadata=within(-2, 2))
    """Commanded forward velocity [m/s]."""
    vy: Real = field(default=0.0, metadata=within(-2, 2))
    """Commanded velocity to the left [m/s]."""
    stand: Flag = False
    """The robot stands on both feet when it is pushed, and need not step (docs/standing.md)."""
    duration: Real = field(default=0.1, metadata=within(1e-3, 2))
    """Duration of the push [s]."""
    body: Body = "pelvis"
    """The body that is pushed."""
    replicas: Count = field(default=REPLICAS, metadata=within(1, 4096))
    """Number of replicas of a push, which differ in phase of the step, start (1 mm, 1 degree) and noise; 1:
    the nominal trajectory, pushed at the start of a step."""
    replica_seed: Count = field(default=0, metadata=within(0))
    """Seed that the replicas are drawn from."""

    def scanned(self, env_id: str, **more: Any) -> Any:
        """The frontier's push with these options, and with others of `FrontierSettings`."""
        from ..score.frontier import FrontierSettings

        return FrontierSettings(
            env_id, duration=self.duration, body=self.body,
            command=Command(self.vx, self.vy, stand=self.stand), errors=self.model_errors,
            profile=self.profile, replicas=self.replicas, replica_seed=self.replica_seed, **more,
        )  # fmt: skip
