"""The command line: dispatches, and turns every error into one line and an exit code."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from textwrap import fill

from ...controllers.errors import MissingExtraError, PushRecoveryError
from ..processes.interrupts import INTERRUPTED, STOPPED, CtrlC, end_now

PROGRAM = "push-recovery"
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
    from .parse import parse  # here, so that Ctrl-C while it loads is an exit code too

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
    from .parse import COMMANDS

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
