"""`push-recovery train`: from parsed options to a run, and what it tells at the end."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..controllers.errors import InvalidValueError
from ..controllers.policies.residual import DEFAULT_FACTOR, default_residual_scale
from ..eval.output.progress import Bars, progress_bars
from .extras import require_training
from .settings import TrainingSettings

if TYPE_CHECKING:
    from .ppo import Report, TrainingResult

DEFAULTS = TrainingSettings()


def run(args: argparse.Namespace) -> int:
    """Train as the options say; returns the exit code.

    Args:
        args: kind, env, timesteps, seed, n_envs, out, resume, scale; None means not given.

    Raises:
        MissingExtraError: torch or Stable-Baselines3 is not installed.
        PushRecoveryError: An option is impossible, or contradicts the run to resume.
    """
    require_training()
    result = _start(args) if args.resume is None else _go_on(args)
    _tell(result)
    return 0


def _start(args: argparse.Namespace) -> TrainingResult:
    from .ppo import train

    settings = TrainingSettings(
        kind=args.kind,
        env_id=DEFAULTS.env_id if args.env is None else args.env,
        timesteps=_or(args.timesteps, DEFAULTS.timesteps),
        seed=_or(args.seed, DEFAULTS.seed),
        n_envs=_or(args.n_envs, DEFAULTS.n_envs),
        scale=_scale(args),
    )
    out = args.out or Path("runs") / f"{settings.kind}-{settings.env_id.split('/')[-1]}-seed{settings.seed}"
    return _with_progress(settings.timesteps, lambda report: train(settings, Path(out), report))


def _go_on(args: argparse.Namespace) -> TrainingResult:
    from .checkpoint import load_checkpoint
    from .ppo import resume

    settings = load_checkpoint(args.resume).settings
    if args.out is not None:
        raise InvalidValueError(f"--out is for a new run; --resume goes on in {args.resume}")
    if args.scale is not None:
        raise InvalidValueError("--scale is for a new run; a resumed one keeps its own")
    given = {
        "kind": args.kind,
        "env_id": None if args.env is None else TrainingSettings(args.kind, args.env).env_id,
        "seed": args.seed,
        "n_envs": args.n_envs,
    }
    for name, value in given.items():
        if value is not None and value != getattr(settings, name):
            raise InvalidValueError(
                f"the run in {args.resume} has {name} {getattr(settings, name)!r}, not {value!r}; "
                "leave the option out to go on, or start a new run with --out"
            )
    end = _or(args.timesteps, settings.timesteps)
    return _with_progress(end, lambda report: resume(args.resume, args.timesteps, report, given["env_id"]))


def _or(value: int | None, default: int) -> int:
    return default if value is None else value


def _scale(args: argparse.Namespace) -> tuple[float, ...] | None:
    """The residual scale that `--scale` times the default stands for, in the environment's limits."""
    if args.scale is None:
        return None
    if args.kind != "residual":
        raise InvalidValueError("--scale belongs to `train residual`; from scratch the network acts alone")
    from .builders import make_plain_env

    env = make_plain_env(
        TrainingSettings(args.kind, DEFAULTS.env_id if args.env is None else args.env).env_id
    )
    unwrapped: Any = env.unwrapped
    scale = default_residual_scale(unwrapped.limits, args.scale * DEFAULT_FACTOR)
    env.close()
    return tuple(scale.tolist())


def _with_progress(timesteps: int, work: Callable[[Report], TrainingResult]) -> TrainingResult:
    """Run `work(report)` with a bar on standard error, which appears at the first report."""
    with ExitStack() as stack:
        bars: list[Bars] = []

        def report(done: int, recovered: float | None) -> None:
            if not bars:
                bars.append(stack.enter_context(progress_bars(["training"], timesteps)))
            note = "" if recovered is None else f"{100 * recovered:.0f} % recovered"
            bars[0].set("training", min(done, timesteps), note)

        return work(report)


def _tell(result: TrainingResult) -> None:
    print(f"{'timesteps':>10} {'recovered':>10} {'survived':>10} {'reward':>10}")
    for p in result.curve:
        print(f"{p.timesteps:>10} {p.recovered:>10.3f} {p.survived:>10.3f} {p.mean_reward:>10.2f}")
    print(f"{result.timesteps} timesteps in {result.seconds:.0f} s; policy: {result.policy}")
