"""Options of every subcommand, with units, defaults and bounds."""

from __future__ import annotations

import argparse
import importlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..bench.keys import EPILOG as BENCH_KEYS
from ..rollout.names import DEFAULT_ENV, SUITE_NAMES, TABLE_ARMS, default_workers

REPRODUCED = ("all", "scenario-1", "scenario-2", "ablations", "limits")  # sections of `reproduce`
Subparsers = Any  # argparse's own type is private


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Appends the default where there is one to tell."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        if action.default in (None, False):
            return action.help
        if isinstance(action.default, list):
            return f"{action.help} (default: {' '.join(action.default)})"
        return super()._get_help_string(action)


class _ListFormatter(HelpFormatter, argparse.RawDescriptionHelpFormatter):
    """Leaves the lines of the epilog as they are."""


def integer(low: int) -> Callable[[str], int]:
    """Argument type: an integer of at least `low`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"must be an integer >= {low}, got {text!r}") from None
        if value < low:
            raise argparse.ArgumentTypeError(f"must be an integer >= {low}, got {value}")
        return value

    return parse


def number(low: float, high: float = math.inf) -> Callable[[str], float]:
    """Argument type: a finite number in [low, high]."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(
                f"must be a number in [{low:g}, {high:g}], got {text!r}"
            ) from None
        if not (math.isfinite(value) and low <= value <= high):
            raise argparse.ArgumentTypeError(f"must be a number in [{low:g}, {high:g}], got {text}")
        return value

    return parse


def directory(text: str) -> Path:
    """Argument type: a directory by name; an empty one, as of an unset variable, is refused."""
    if not text.strip():
        raise argparse.ArgumentTypeError("must name a directory, got an empty string")
    return Path(text)


def markdown_file(text: str) -> Path:
    """Argument type: a Markdown file by name."""
    if Path(text).suffix != ".md":
        raise argparse.ArgumentTypeError(f"must name a .md file, got {text!r}")
    return Path(text)


def _handler(module: str, function: str) -> Callable[[argparse.Namespace], int]:
    """A handler whose module is imported only when it runs."""

    def handle(args: argparse.Namespace) -> int:
        return getattr(importlib.import_module(module, __package__), function)(args)

    return handle


def _command(commands: Subparsers, name: str, text: str) -> argparse.ArgumentParser:
    parser = commands.add_parser(name, help=text, description=text, formatter_class=HelpFormatter)
    parser.set_defaults(handler=_handler(".commands", f"run_{name}"))
    return parser


def _add_env(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--env", metavar="ID", default=DEFAULT_ENV, help="environment id")
    parser.add_argument(
        "--preset", metavar="NAME|FILE", help="of planner and robot, such as what tune has found (the "
        "environment's own)",
    )  # fmt: skip


def _add_suite(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--suite", metavar="NAME|FILE", default="quick", help=f"{', '.join(SUITE_NAMES)}, or a JSON file"
    )


def _add_errors(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--errors",
        metavar="JSON",
        default="{}",
        help="what robot and floor are off from what the planner believes, in every scenario, such as "
        '\'{"mass": 0.1, "friction": 0.6, "delay": 0.01, "dcm_noise": 0.01}\' (docs/scenarios.md)',
    )


def _add_running(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--workers",
        metavar="N",
        type=integer(1),
        default=default_workers(),
        help="processes; changes no result",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=directory,
        help="results; a directory of the same configuration is resumed (by default one under runs/ named "
        "after the configuration)",
    )
    parser.add_argument("--overwrite", action="store_true", help="start over where DIR holds results")
    _add_json(parser)


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, nothing else there"
    )


def _add_command_velocity(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--vx", type=number(-2, 2), default=0.0, help="commanded forward velocity [m/s]")
    parser.add_argument("--vy", type=number(-2, 2), default=0.0, help="commanded velocity to the left [m/s]")


def add_commands(commands: Subparsers) -> None:
    """Add every subcommand."""
    for add in (
        _add_evaluate,
        _add_compare,
        _add_frontier,
        _add_reproduce,
        _add_tune,
        _add_bench,
        _add_list,
        _add_warmup,
        _add_play,
        add_train_parser,
    ):
        add(commands)


def _add_evaluate(commands: Subparsers) -> None:
    parser = _command(commands, "evaluate", "Score policies on a suite: recovery rates on the same pushes.")
    _add_env(parser)
    parser.add_argument(
        "--policies",
        metavar="NAME|FILE",
        nargs="+",
        default=list(TABLE_ARMS),
        help="names (see list), policy files, or MODULE:ATTRIBUTE",
    )
    _add_suite(parser)
    _add_errors(parser)
    _add_running(parser)


def _add_compare(commands: Subparsers) -> None:
    parser = _command(
        commands, "compare", "Compare two policies on the same pushes: exact McNemar, score interval."
    )
    parser.add_argument("a", metavar="A", help="policy: name, file, or MODULE:ATTRIBUTE")
    parser.add_argument("b", metavar="B", help="policy: name, file, or MODULE:ATTRIBUTE")
    _add_env(parser)
    _add_suite(parser)
    _add_errors(parser)
    _add_running(parser)


def _add_frontier(commands: Subparsers) -> None:
    parser = _command(
        commands, "frontier",
        "Largest recoverable push by direction, at the start of a left stance after four nominal steps.",
    )  # fmt: skip
    _add_env(parser)
    parser.add_argument(
        "--policy", "--policies", dest="policies", metavar="NAME|FILE", nargs="+", default=["two-stage"],
        help="names, policy files, or MODULE:ATTRIBUTE, all in one picture",
    )  # fmt: skip
    parser.add_argument(
        "--directions",
        metavar="N",
        type=integer(1),
        default=16,
        help="directions, counter-clockwise from forward",
    )
    parser.add_argument(
        "--grid", metavar="N", type=number(1, 1000), default=None, help="step of the force [N] "
        "(10 on the pendulum, 20 elsewhere)",
    )  # fmt: skip
    parser.add_argument("--duration", type=number(1e-3, 2), default=0.1, help="of the push [s]")
    parser.add_argument("--body", choices=("pelvis", "trunk"), default="pelvis", help="body that is pushed")
    _add_command_velocity(parser)
    _add_errors(parser)
    _add_running(parser)


def _add_reproduce(commands: Subparsers) -> None:
    parser = _command(
        commands, "reproduce",
        "Measure the paper's results again on the pendulum: scenarios, ablations, limits, pictures.",
    )  # fmt: skip
    parser.add_argument(
        "section", nargs="?", choices=REPRODUCED, default=REPRODUCED[0], metavar="SECTION",
        help=", ".join(REPRODUCED),
    )  # fmt: skip
    parser.add_argument(
        "--directions", metavar="N", type=integer(1), default=36,
        help="directions of scenario 2, counter-clockwise from forward",
    )  # fmt: skip
    parser.add_argument(
        "--page", metavar="FILE.md", type=markdown_file,
        help="write a page that holds the paper's claims against the run, pictures beside it",
    )  # fmt: skip
    _add_running(parser)


def _add_tune(commands: Subparsers) -> None:
    parser = _command(
        commands, "tune",
        "Search the settings of planner and robot on pushes of their own, by CMA-ES; more trials go on where "
        "fewer ended. The best becomes DIR/preset.json.",
    )  # fmt: skip
    _add_env(parser)
    parser.add_argument("--policy", metavar="NAME", default="two-stage", help="arm whose gains are tuned")
    parser.add_argument(
        "--space", choices=("planner", "robot", "both"), default="planner",
        help="the arm's gains; gait box, gait machine and whole-body control, which all arms share; or both",
    )  # fmt: skip
    parser.add_argument(
        "--only", metavar="FIELD", nargs="+",
        help="groups or fields of the space, such as limits or gait.apex (all of it)",
    )  # fmt: skip
    parser.add_argument("--trials", metavar="N", type=integer(1), default=100, help="budget")
    parser.add_argument(
        "--scenarios", metavar="N", type=integer(8), default=256, help="of a trial that is not stopped early"
    )
    parser.add_argument(
        "--errors", metavar="JSON", default="{}",
        help="model errors of every second robot, half of these with the mass error negated (docs/tuning.md)",
    )  # fmt: skip
    parser.add_argument("--seed", metavar="N", type=integer(0), default=0, help="of the search")
    _add_running(parser)


def _add_bench(commands: Subparsers) -> None:
    parser = _command(
        commands, "bench",
        "Time the physics, the planner and the closed loop on this machine, beside Humanoid-v5 and other "
        "solvers.",
    )  # fmt: skip
    parser.formatter_class, parser.epilog = _ListFormatter, BENCH_KEYS
    _add_env(parser)
    parser.add_argument(
        "--seconds", type=number(0.1, 600), default=20.0,
        help="simulated time of one robot's closed loop [s]; less than 5 measures only what is quick: no "
        "Humanoid-v5, no other solvers, no more than 64 robots, no start of a process",
    )  # fmt: skip
    _add_json(parser)


def _add_list(commands: Subparsers) -> None:
    _add_json(_command(commands, "list", "List environments, policies and suites."))


def _add_warmup(commands: Subparsers) -> None:
    text = "Compile all kernels now, for every later process of this user: minutes once, then seconds."
    _add_json(_command(commands, "warmup", text))


def _add_play(commands: Subparsers) -> None:
    parser = _command(commands, "play", "Show one push: in a window, or written to a video or picture.")
    _add_env(parser)
    parser.add_argument(
        "--policy", metavar="NAME|FILE", default="two-stage", help="name, policy file, or MODULE:ATTRIBUTE"
    )
    parser.add_argument("--force", type=number(0, 10_000), default=200.0, help="of the push [N]")
    parser.add_argument(
        "--psi", type=number(-360, 360), default=0.0, help="direction, counter-clockwise from forward [deg]"
    )
    parser.add_argument("--duration", type=number(1e-3, 2), default=0.1, help="of the push [s]")
    parser.add_argument("--body", choices=("pelvis", "trunk"), default="pelvis", help="body that is pushed")
    _add_command_velocity(parser)
    _add_errors(parser)
    parser.add_argument("--suite", metavar="NAME|FILE", help="take the push from a suite instead")
    parser.add_argument("--scenario", metavar="ID", help="scenario of the suite (the first one)")
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help="mp4 or gif film, or png contact sheet; a window without it"
    )


def add_train_parser(commands: Subparsers) -> None:
    """Options of `train`; the training package is imported only when it runs."""
    parser = commands.add_parser(
        "train",
        help="Train a policy with PPO.",
        description="Train with PPO of Stable-Baselines3: a residual on the planner, or from scratch.",
        formatter_class=HelpFormatter,
    )
    parser.set_defaults(handler=_handler("...training.command", "run"))
    parser.add_argument("kind", choices=("residual", "scratch"), help="what is learned")
    for option, metavar, parse, text in (
        ("--env", "ID", str, "plain environment id: a residual is learned on top of it, not on a residual id "
         "(default: PushRecovery/Biped-v0)"),
        ("--timesteps", "N", integer(0), "learned actions in all, over all environments, each held for 20 ms "
         "(default: 1000000)"),
        ("--seed", "N", integer(0), "of weights, exploration and pushes (default: 0)"),
        ("--n-envs", "N", integer(1), "environments side by side (default: 16)"),
        ("--out", "DIR", directory, "policy, checkpoints and logs (default: under runs/)"),
        ("--resume", "DIR", Path, "go on from the last checkpoint of the run in DIR, with its settings; "
         "checkpoints are safetensors and JSON"),
        ("--scale", "X", number(0, 10), "residual relative to its default size (residual only; default: 1)"),
    ):  # fmt: skip
        parser.add_argument(option, metavar=metavar, type=parse, help=text)
