"""The command line: commands by name, their words, and every error as one line and an exit code."""

import argparse
import difflib
import io
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from dataclasses import MISSING, fields, is_dataclass
from importlib import import_module
from itertools import takewhile
from textwrap import fill
from types import NoneType
from typing import Any, Literal, NoReturn, get_args, get_origin, get_type_hints

from ...controllers.errors import InvalidValueError, MissingExtraError, PushRecoveryError, UnknownNameError
from ..output.interrupt import INTERRUPTED, STOPPED, CtrlC, end_now

OK, FAILED, BAD_INPUT = 0, 1, 2
PROGRAM = "push-recovery"
COMMANDS = {  # module, class and what it does; a module is loaded when its command is asked for
    "evaluate": (".score", "Evaluate",
                 "Score policies on a suite: recovery rates on the same pushes."),
    "compare": (".score", "Compare",
                "Compare two policies on the same pushes: exact McNemar test and score interval."),
    "frontier": (".score", "Frontier",
                 "Find the largest push in each direction from which 0.8 of the replicas recover "
                 "(docs/evaluation.md#frontier)."),
    "basin": (".score", "Basin",
              "Map the N-step capture basin: how many steps a robot needs from each DCM, measured and by "
              "theory."),
    "sensitivity": (".score", "Sensitivity",
                    "Run a sample of a suite under other solvers, time steps, contacts, losses and "
                    "delays: what its outcomes depend on."),
    "ceiling": (".score", "CeilingCommand",
                "Search every push that all policies lose for actions that recover from it: a lower bound on "
                "what is possible."),
    "corrections": (".score", "Corrections",
                    "Show what a residual adds to the planner, by the direction of the push and by step."),
    "reproduce": (".score", "Reproduce",
                  "Measure the paper's results again on the pendulum: scenarios, ablations, limits, "
                  "pictures."),
    "tune": (".tools", "Tune",
             "Search the settings of planner and robot by CMA-ES, on pushes of their own. The best becomes "
             "DIR/preset.json; a stopped search can be resumed, with more trials too."),
    "bench": (".tools", "Bench",
              "Time the physics, the planner and the closed loop on this machine, beside Humanoid-v5 and "
              "other solvers."),
    "list": (".tools", "Names", "List environments, policies and suites."),
    "protocol": (".sharing", "ProtocolCommand",
                 "Run the push protocols of other groups (kick, tour) beside what they published."),
    "submit": (".sharing", "Submit",
               "Check results by running a sample of their rows again, and put them on a leaderboard."),
    "robot": (".sharing", "RobotCommand",
              "Make a robot of your own from a model: robot new FILE.xml guesses its parts, for "
              "your review."),
    "policy": (".sharing", "PolicyCommand",
               "Read what a policy of others expects of its robot (inspect), and see whether it stands "
               "and walks unpushed (check)."),
    "suite": (".sharing", "SuiteCommand",
              "Write a suite of your own: suite new --seed N --out FILE draws pushes that nobody has met."),
    "warmup": (".tools", "WarmUp",
               "Compile all kernels now, for every later process of this user. It takes minutes once, "
               "and seconds later."),
    "play": (".play", "Play",
             "Push a walking robot in the browser; or write one push to a video, picture, log or plot."),
    "curves": (".tools", "Curves",
               "Draw how policies learned: recovered against samples, beside planner and ceiling."),
    "export": (".tools", "Export",
               "Write a learned policy as ONNX, for runtimes that know nothing of this package."),
    "dataset": (".tools", "DatasetCommand",
                "Write what policies do on a suite as Minari data sets, for learners from data."),
    "train": ("...training.cli", "Train",
              "Train by PPO: a correction of the planner, or a policy that acts alone."),
    "policies": ("...training.cli", "Policies",
                 "Train the policies that come with the package again, each by its recipe."),
}  # fmt: skip


def parse(name: str, words: Sequence[str]) -> Any:
    """The options of a command; those not given have its defaults.

    Raises:
        UnknownNameError: There is no such command.
        InvalidValueError: An option is unknown, lacks its value, or has an impossible one.
        SystemExit: Help was asked for, and has been printed.
    """
    if name not in COMMANDS:
        raise UnknownNameError("command", name, COMMANDS)
    module, kind, _ = COMMANDS[name]
    command: type[Any] = getattr(import_module(module, __package__), kind)
    options = _parse(name, command, words)
    default = options.defaults()
    return options if default is None else _parse(name, command, words, default=default)


def _parse(name: str, command: type[Any], words: Sequence[str], **default: Any) -> Any:
    import tyro

    said = takewhile(lambda word: not word.startswith("-"), words)  # which tyro's usage leaves out
    program = " ".join((PROGRAM, name, *said))
    try:
        with redirect_stderr(io.StringIO()):
            return tyro.cli(
                command, prog=program, description=COMMANDS[name][2], args=list(words),
                config=(tyro.conf.FlagCreatePairsOff,), **default,
            )  # fmt: skip
    except SystemExit as leave:
        if not leave.code:
            print(command.epilog(), end="")
            raise
        error: BaseException | None = leave
        while error is not None and not isinstance(error, PushRecoveryError):
            error = error.__context__  # what the options themselves refused
        if error is None:
            _Reader(add_help=False, allow_abbrev=False).refuse(name, command, words)
        raise error from None


class _Reader(argparse.ArgumentParser):
    """Reads the same options by the plain rules of argparse, to say what is wrong with words."""

    def refuse(self, name: str, command: type[Any], words: Sequence[str]) -> NoReturn:
        """Raise InvalidValueError with the first thing that is wrong with the words of a command."""
        known = self._add_fields(command)
        words = [word.replace("_", "-") if word.startswith("--") else word for word in words]
        for word in words:
            option = word.partition("=")[0]
            if option.startswith("--") and option not in known:
                close = difflib.get_close_matches(option, known, 1)
                self.error(f"unrecognized option {option}" + (f"; did you mean {close[0]}?" if close else ""))
        self.parse_args(words)
        self.error(f"{name} can't take these words: {' '.join(words)} (see {PROGRAM} {name} --help)")

    def error(self, message: str) -> NoReturn:
        """Raise InvalidValueError."""
        raise InvalidValueError(message.removeprefix("argument ").replace(": must be", " must be", 1))

    def _add_fields(self, kind: Any, prefix: str = "") -> list[str]:
        """Take an option for each field of a dataclass, and of dataclasses in it; returns their names."""
        from tyro.conf import Positional, Suppress

        names, plain, marked = [], get_type_hints(kind), get_type_hints(kind, include_extras=True)
        for entry in fields(kind):
            hint, marks = plain[entry.name], getattr(marked[entry.name], "__metadata__", ())
            marked_as: dict[str, Any] = {
                key: value for mark in marks for key in ("name", "metavar", "aliases")
                if (value := getattr(mark, key, None)) is not None
            }  # fmt: skip
            name = prefix + marked_as.get("name", entry.name).replace("_", "-")
            required = entry.default is MISSING and entry.default_factory is MISSING
            if Suppress in marks:
                continue
            if is_dataclass(hint):
                names += self._add_fields(hint, f"{name}." if name else "")
            elif Positional in marks:
                how = _arity(hint) if required else {"nargs": "?", **_arity(hint)}
                self.add_argument(name, metavar=marked_as.get("metavar"), **how)
            else:
                off = "no-" if hint is bool and entry.default is True else ""
                options = [f"--{off}{name}", *marked_as.get("aliases", ())]
                names += options
                self.add_argument(*options, **{"required": required, **_arity(hint)})
        return names


def _arity(hint: Any) -> dict[str, Any]:
    """How many words of which kind an option takes, as `add_argument` takes it."""
    if hint is bool:
        return {"action": "store_true"}
    kinds = [one for one in get_args(hint) if one is not NoneType] if NoneType in get_args(hint) else [hint]
    if len(kinds) != 1:
        return {"nargs": "*"}
    kind = kinds[0]
    if get_origin(kind) is tuple:
        return {**_arity(get_args(kind)[0]), "nargs": "*"}
    if get_origin(kind) is Literal:
        return {"type": _choice(get_args(kind))}
    return {"type": _number(kind)} if kind in (int, float) else {}


def _choice(valid: tuple[str, ...]) -> Callable[[str], None]:
    """A check that a word is one of several."""

    def check(word: str) -> None:
        if word not in valid:
            raise argparse.ArgumentTypeError(f"got {word!r}, must be one of {valid}")

    return check


def _number(kind: type) -> Callable[[str], None]:
    """A check that a word is a number."""

    def check(word: str) -> None:
        try:
            kind(word)
        except ValueError:
            if word != "None":
                what = "an integer" if kind is int else "a number"
                raise argparse.ArgumentTypeError(f"must be {what}, got {word!r}") from None

    return check


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code.

    An error becomes one line, with a traceback only where PUSH_RECOVERY_DEBUG is set. Without `argv` it is
    the command of this process, whose end follows.
    """
    ctrl_c = CtrlC(last=argv is None)
    try:
        with ctrl_c:
            code = _exit_code(sys.argv[1:] if argv is None else argv)
    except KeyboardInterrupt:
        code = INTERRUPTED
    if code != INTERRUPTED:
        return code  # also of a command that Ctrl-C is the way to end
    if ctrl_c.came and argv is None:
        end_now()  # all is closed, and to take the interpreter down may last as long as the command did
    print(STOPPED, file=sys.stderr)
    return INTERRUPTED


def _exit_code(argv: Sequence[str]) -> int:
    """Run one command, and print its error if it has one."""
    try:
        if not argv or argv[0] in {"-h", "--help"}:
            _print_overview()
        elif argv[0] == "--version":
            print(PROGRAM, sys.modules[__name__.partition(".")[0]].__version__)
        else:
            parse(argv[0], argv[1:]).run()
    except SystemExit as leave:  # after the help of a command
        return int(leave.code or OK)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except Exception as error:
        if os.environ.get("PUSH_RECOVERY_DEBUG"):
            traceback.print_exc()
        ours = isinstance(error, PushRecoveryError)
        words = " ".join(str(error if ours else f"{type(error).__name__}: {error}").split())
        # files may hold what moves a terminal's cursor or renames it
        line = "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in words)
        print(f"{PROGRAM}: error: {line}", file=sys.stderr)
        bad = ours and isinstance(error, ValueError) and not isinstance(error, MissingExtraError)
        return BAD_INPUT if bad else FAILED
    return OK


def _print_overview() -> None:
    """Print the commands, without loading one."""
    print(f"usage: {PROGRAM} [-h] [--version] COMMAND ...\n")
    print("Push recovery of bipeds: score policies on equal pushes, find limits, train residuals.\n")
    for name, (_, _, text) in COMMANDS.items():
        print(fill(text, 80, initial_indent=f"  {name:<13}", subsequent_indent=" " * 15))
    print(f"\nOptions of one: {PROGRAM} COMMAND --help")
    print("Exit codes: 0 done, 1 failure, 2 bad input, 130 interrupted (what was done is kept).")
