"""The command line: commands by name, their words, and every error as one line and an exit code.

From words to the options of a command, by tyro; bad words become one error of one line.

The command line: dispatches, and turns every error into one line and an exit code.
"""

from __future__ import annotations

import io
import os
import re
import sys
import traceback
from collections.abc import Sequence
from contextlib import redirect_stderr
from functools import partial
from importlib import import_module
from textwrap import fill
from typing import TYPE_CHECKING

from ...controllers.errors import InvalidValueError, MissingExtraError, PushRecoveryError, UnknownNameError
from ..output.interrupt import INTERRUPTED, STOPPED, CtrlC, end_now

if TYPE_CHECKING:
    from .options import Options

PROGRAM = "push-recovery"
COMMANDS = {  # module, class and what it does; a module is loaded when its command is asked for
    "evaluate": (".score", "Evaluate",
                 "Score policies on a suite: recovery rates on the same pushes."),
    "compare": (".score", "Compare",
                "Compare two policies on the same pushes: exact McNemar test and score interval."),
    "frontier": (".studies", "Frontier",
                 "Find the largest recoverable push in each direction, at the start of a left stance after "
                 "four nominal steps."),
    "sensitivity": (".studies", "Sensitivity",
                    "Run a sample of a suite under other solvers, time steps, contacts, losses and "
                    "delays: what its outcomes depend on."),
    "ceiling": (".studies", "CeilingCommand",
                "Search every push that all policies lose for actions that recover from it: a lower bound on "
                "what is possible."),
    "corrections": (".studies", "Corrections",
                    "Show what a residual adds to the planner, by the direction of the push and by step."),
    "reproduce": (".studies", "Reproduce",
                  "Measure the paper's results again on the pendulum: scenarios, ablations, limits, "
                  "pictures."),
    "tune": (".tools", "Tune",
             "Search the settings of planner and robot by CMA-ES, on pushes of their own. The best becomes "
             "DIR/preset.json; a stopped search goes on, also with more trials."),
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
    "train": ("...training.cli", "Train",
              "Train with PPO of Stable-Baselines3: a residual on the planner, or from scratch."),
    "policies": ("...training.cli", "Policies",
                 "Train the policies that come with the package again, each by its recipe."),
}  # fmt: skip
WORDS = {  # what tyro says of Python's own number types and of a group of options, and what this program says
    r":? invalid literal for int\(\) with base 10:": " must be an integer, got",
    r":? could not convert string to float:": " must be a number, got",
    r"'settings\.(\w+)'": r"'\1'",
}
FRAME = "╭╮╰╯│"
MEANT = "Perhaps you meant:"


def parse(name: str, words: Sequence[str]) -> Options:
    """The options of a command; those not given have its defaults.

    Raises:
        UnknownNameError: There is no such command.
        InvalidValueError: An option is unknown, lacks its value, or has an impossible one.
        SystemExit: Help was asked for, and has been printed.
    """
    if name not in COMMANDS:
        raise UnknownNameError("command", name, COMMANDS)
    module, kind, _ = COMMANDS[name]
    command: type[Options] = getattr(import_module(module, __package__), kind)
    options = _parse(name, command, words)
    default = options.defaults()
    return options if default is None else _parse(name, command, words, default)


def _parse(
    name: str, command: type[Options], words: Sequence[str], default: Options | None = None
) -> Options:
    import tyro

    said = io.StringIO()
    told = partial(
        tyro.cli, command, prog=f"{PROGRAM} {name}", description=COMMANDS[name][2], args=list(words),
        config=(tyro.conf.FlagCreatePairsOff,),
    )  # fmt: skip
    try:
        with redirect_stderr(said):
            return told() if default is None else told(default=default)
    except SystemExit as leave:
        if not leave.code:
            print(getattr(command, "EPILOG", ""), end="")
            raise
        raise (_cause(leave) or InvalidValueError(one_line(said.getvalue()))) from None


def _cause(error: BaseException | None) -> PushRecoveryError | None:
    """The error of this project that led to another one, if any: what the options themselves refused."""
    while error is not None and not isinstance(error, PushRecoveryError):
        error = error.__context__
    return error


def one_line(box: str) -> str:
    """What a framed message of tyro says, without its title, its frame, and its hints at the help."""
    lines = [line.strip(FRAME + " ") for line in box.splitlines()][1:]
    rules = [i for i, line in enumerate(lines) if len(line) > 1 and set(line) <= {"─", "-"}]
    began = 1 if rules[:1] == [0] else 0  # a terminal without UTF-8 has a rule below the title
    end = next((i for i in rules if i >= began), len(lines))
    text = " ".join(" ".join(lines[began:end]).split()).removeprefix("Error parsing ")
    hints = lines[lines.index(MEANT) :] if MEANT in lines else []
    meant = re.search(r"--[\w-]+", " ".join(hints))
    for theirs, ours in WORDS.items():
        text = re.sub(theirs, ours, text)
    return f"{text}; did you mean {meant[0]}?" if meant else text


OK, FAILED, BAD_INPUT = 0, 1, 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code.

    An error becomes one line, with a traceback only where PUSH_RECOVERY_DEBUG is set. Without `argv` it is
    the command of this process, whose end follows.
    """
    ctrl_c = CtrlC(last=argv is None)
    try:
        with ctrl_c:
            code = _told(sys.argv[1:] if argv is None else argv)
    except KeyboardInterrupt:
        code = INTERRUPTED
    if ctrl_c.came and argv is None:
        end_now()  # all is closed, and to take the interpreter down may last as long as the command did
    if ctrl_c.came or code == INTERRUPTED:
        print(STOPPED, file=sys.stderr)
        return INTERRUPTED
    return code


def _told(argv: Sequence[str]) -> int:
    """The exit code of a command whose errors have been told."""
    try:
        return _run(argv)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except Exception as error:
        if os.environ.get("PUSH_RECOVERY_DEBUG"):
            traceback.print_exc()
        if isinstance(error, PushRecoveryError):
            failed = isinstance(error, MissingExtraError) or not isinstance(error, ValueError)
            return _complain(error, FAILED if failed else BAD_INPUT)
        return _complain(f"{type(error).__name__}: {error}", FAILED)


def _run(argv: Sequence[str]) -> int:
    # here, so that Ctrl-C while it loads is an exit code too

    if not argv or argv[0] in {"-h", "--help"}:
        _print_overview()
        return OK
    if argv[0] == "--version":
        print(PROGRAM, sys.modules[__name__.partition(".")[0]].__version__)
        return OK
    try:
        options = parse(argv[0], argv[1:])
    except SystemExit as leave:  # after the help of a command
        return int(leave.code or OK)
    options.run()
    return OK


def _print_overview() -> None:
    """The commands, without loading one."""
    print(f"usage: {PROGRAM} [-h] [--version] COMMAND ...\n")
    print("Push recovery of bipeds: score policies on equal pushes, find limits, train residuals.\n")
    for name, (_, _, text) in COMMANDS.items():
        print(fill(text, 80, initial_indent=f"  {name:<13}", subsequent_indent=" " * 15))
    print(f"\nOptions of one: {PROGRAM} COMMAND --help")
    print("Exit codes: 0 done, 1 failure, 2 bad input, 130 interrupted (what was done is kept).")


def _complain(message: object, code: int) -> int:
    words = " ".join(str(message).split())
    line = "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in words)  # files may hold
    print(f"{PROGRAM}: error: {line}", file=sys.stderr)  # what moves a terminal's cursor or renames it
    return code
