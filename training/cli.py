"""`push-recovery train` and `push-recovery policies`: from options to a run, and what it shows at the end."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, TypeVar

from tyro.conf import Positional, arg

from ..controllers.errors import InvalidValueError, MissingExtraError
from ..controllers.files import read_file, write_atomically
from ..controllers.policies.learned import policy_paths
from ..controllers.policies.residual import DEFAULT_FACTOR, default_residual_scale
from ..controllers.validation import require_choice
from ..eval.cli.options import Directory, Options, within
from ..eval.output.progress import Bars, Work, about, progress_bars
from .settings import RECIPES, Report, TrainingSettings, difference, file_settings, get_recipe


def require_training() -> None:
    """Raise MissingExtraError, naming the command that installs it, unless torch and SB3 are there."""
    for module in ("torch", "stable_baselines3", "tensorboard"):
        if find_spec(module) is None:
            raise MissingExtraError(module.replace("_", "-"), "train")


def runs() -> Any:
    """The module `training.run`, loaded only where a run is wanted: it needs torch."""
    require_training()
    from . import run

    return run


DEFAULTS = TrainingSettings()
T = TypeVar("T")
BEFORE = 20.0  # of a run, for walks and the first evaluation [s]
PERIODS = 4000.0  # of all robots together in a second, about, of two shared cores


@dataclass(frozen=True, kw_only=True)
class Train(Options):
    """Start a run, or go on with one; its settings are the defaults of what is then given."""

    settings: Annotated[TrainingSettings, arg(name="")] = DEFAULTS
    env: Annotated[str | None, arg(metavar="ID", help_behavior_hint=f"(default: {DEFAULTS.env_id})")] = None
    """Id of the plain environment, also for a residual, which is learned on top of it. The kinds joint and
    joint-residual take the form of the robot whose actions are those of joints."""
    out: Directory = None
    """Directory for policy, checkpoints and logs (default: one under runs/)."""
    resume: Directory = None
    """Go on from the last checkpoint of the run in DIR, with its settings."""
    recipe: Annotated[str | None, arg(metavar="NAME|FILE", help_behavior_hint="")] = None
    """Start a new run with the settings of a shipped policy, by name (docs/policies.md), or with those of the
    policy in FILE; options beside it change them."""
    scale: Annotated[float | None, arg(metavar="X", help_behavior_hint="(default: 1)")] = field(
        default=None, metadata=within(0, 10)
    )
    """Size of the residual, as a multiple of its default size (only for the kind residual)."""

    def defaults(self) -> Train | None:
        """Settings of a run to go on with, or of a recipe; the user has given what differs from them."""
        if self.resume is None:
            return None if self.recipe is None else Train(settings=get_recipe(self.recipe))
        return Train(settings=runs().load_checkpoint(Path(self.resume)).settings)

    def run(self) -> None:
        """Train, and print the curve.

        Raises:
            MissingExtraError: torch or Stable-Baselines3 is not installed.
            PushRecoveryError: An option is impossible, or contradicts the run to resume.
        """
        result = self._start() if self.resume is None else self._go_on(Path(self.resume))
        print(f"{'timesteps':>10} {'recovered':>10} {'survived':>10} {'reward':>10}")
        for p in result.curve:
            print(f"{p.timesteps:>10} {p.recovered:>10.3f} {p.survived:>10.3f} {p.mean_reward:>10.2f}")
        print(f"{result.timesteps} timesteps in {result.seconds:.0f} s; policy: {result.policy}")

    def _start(self) -> Any:
        """The `TrainingResult` of a new run."""
        run, settings = runs(), self._with_env(self.settings)
        name = run.environments.EnvName.parse(settings.env_id)
        if self.recipe is not None and self.env is None and name.runs_code:
            raise InvalidValueError(
                f"the recipe {self.recipe!r} is for {settings.env_id!r}, and training would run the code of "
                f"{name.module!r}: say --env {settings.env_id} where that is wanted"
            )
        settings = replace(settings, scale=self._residual_scale(settings))
        folder = f"{settings.kind}-{settings.env_id.split('/')[-1]}-seed{settings.seed}"
        out = Path("runs") / folder if self.out is None else Path(self.out)
        return with_progress(settings, out, lambda report: run.train(settings, out, report))

    def _go_on(self, path: Path) -> Any:
        """The `TrainingResult` of one that was there."""
        run = runs()
        for option in ("out", "recipe"):
            if getattr(self, option) is not None:
                raise InvalidValueError(f"--{option} is for a new run; --resume goes on in {path}")
        if self.scale is not None:
            raise InvalidValueError("--scale is for a new run; a resumed one keeps its own")
        theirs, ours = run.load_checkpoint(path).settings, self._with_env(self.settings)
        for entry in fields(TrainingSettings):
            old, new = getattr(theirs, entry.name), getattr(ours, entry.name)
            if entry.name not in {"timesteps", "device"} and old != new:
                raise InvalidValueError(
                    f"the run in {path} has {entry.name} {old!r}, not {new!r}; "
                    "leave the option out to go on, or start a new run with --out"
                )
        named = None if self.env is None else ours.env_id  # only what the user names may import a module
        return with_progress(
            ours, path, lambda report: run.resume(path, ours.timesteps, report, named, ours.device)
        )

    def _with_env(self, settings: TrainingSettings) -> TrainingSettings:
        return settings if self.env is None else replace(settings, env_id=self.env)

    def _residual_scale(self, settings: TrainingSettings) -> tuple[float, ...] | None:
        """The residual scale that `--scale` times the default stands for, in the environment's limits."""
        if self.scale is None:
            return settings.scale
        if not settings.residual:
            raise InvalidValueError(
                f"--scale belongs to `train residual`, which corrects gait actions, not to {settings.kind!r}"
            )
        env = runs().builders.make_plain_env(settings.env_id)
        unwrapped: Any = env.unwrapped
        scale = default_residual_scale(unwrapped.limits, self.scale * DEFAULT_FACTOR)
        env.close()
        return tuple(scale.tolist())


def with_progress(settings: TrainingSettings, out: Path, train: Callable[[Report], T]) -> T:
    """`train(report)` with a bar on standard error, which appears at the first report.

    By then all that the user has given is checked, so that an error remains the only line.
    """
    name, timesteps = "training", settings.timesteps
    what = f"{settings.kind} on {settings.env_id}, {timesteps} actions in all"
    with ExitStack() as stack:
        bars: list[Bars] = []

        def report(done: int, words: str) -> None:
            if not bars:
                left = max(timesteps - done, 0) * settings.periods / PERIODS  # [s]
                work = Work(what, about(BEFORE + left), out)
                bars.append(stack.enter_context(progress_bars([name], timesteps, work, {name: done})))
            bars[0].set(name, min(done, timesteps), words)

        return train(report)


FOLDER = Path("runs/policies")


@dataclass(frozen=True, kw_only=True)
class Policies(Options):
    """One run after the other; what is complete stays, what was stopped goes on."""

    names: Annotated[Positional[tuple[str, ...]], arg(metavar="[NAME ...]")] = tuple(RECIPES)
    """Names of the policies to train; without a name all of them."""
    out: Directory = None
    """Directory for NAME.safetensors and NAME.json; each run is in DIR/NAME (default: runs/policies)."""

    def run(self) -> None:
        """Train, and print where each policy is.

        Raises:
            UnknownNameError: No recipe has this name.
            InvalidValueError: A folder holds a run with other settings than the recipe's.
            MissingExtraError: torch or Stable-Baselines3 is not installed.
        """
        require_training()
        folder = FOLDER if self.out is None else Path(self.out)
        for name in self.names:
            require_choice("recipe", name, tuple(RECIPES))
        for name in self.names:
            if not is_complete(folder, name):
                settings = RECIPES[name]
                with_progress(
                    settings, folder / name, lambda report, name=name: train_recipe(name, folder, report)
                )
            print(policy_paths(folder / name)[1])


def is_complete(folder: Path, name: str) -> bool:
    """Whether a folder holds the policy of a recipe, trained with the recipe's settings of today."""
    weights, description = policy_paths(folder / name)
    if not (weights.is_file() and description.is_file()):
        return False
    return difference(RECIPES[name], file_settings(description)) is None


def train_recipe(name: str, folder: Path, report: Report) -> None:
    """Train by a recipe in FOLDER/NAME, or go on there; then put the best policy of its curve beside it.

    Raises:
        InvalidValueError: The run there has other settings.
    """
    run, settings, out = runs(), RECIPES[name], folder / name
    if run.find_checkpoints(out):
        theirs = run.load_checkpoint(out).settings
        if (differs := difference(settings, theirs)) is not None:
            raise InvalidValueError(
                f"the run in {out} has {differs} {getattr(theirs, differs)!r}, its recipe "
                f"{getattr(settings, differs)!r}: choose another --out, or remove that folder"
            )
        run.resume(out, report=report)
    else:
        run.train(settings, out, report, folder)
    for path, place in zip(policy_paths(out / run.BEST), policy_paths(folder / name), strict=True):
        write_atomically(place, read_file(path))  # the description last: it says that both are there
