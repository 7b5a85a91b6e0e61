"""The command line: parses, dispatches, and turns every error into one line and an exit code."""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import NoReturn

from ...controllers.errors import MissingExtraError, PushRecoveryError

PROGRAM = "push-recovery"
STOPPED = "interrupted; what was done is kept"
OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


class Parser(argparse.ArgumentParser):
    """argparse with errors of one line and no usage dump."""

    def error(self, message: str) -> NoReturn:
        """Print one line on standard error and exit with 2."""
        raise SystemExit(_complain(message, BAD_INPUT, self.prog))


def _complain(message: object, code: int, program: str = PROGRAM) -> int:
    line = " ".join(str(message).split())
    print(f"{program}: error: {line}", file=sys.stderr)
    return code


def make_parser() -> argparse.ArgumentParser:
    """The parser with every subcommand; each sets `handler` to a function of the namespace."""
    parser = Parser(
        prog=PROGRAM,
        description="Push recovery of bipeds: score policies on equal pushes, find limits, train residuals.",
        epilog="Exit codes: 0 done, 1 failure, 2 bad input, 130 interrupted (what was done is kept).",
    )
    version = sys.modules[__name__.partition(".")[0]].__version__
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {version}")
    from .options import add_commands  # slow to load: inside of what turns Ctrl-C into an exit code

    add_commands(parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser))
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    try:
        parser = make_parser()
        args = parser.parse_args(argv)
    except SystemExit as leave:
        return int(leave.code or 0)
    except KeyboardInterrupt:
        return _complain(STOPPED, INTERRUPTED)
    if args.command is None:
        parser.print_help()
        return OK
    return _guarded(args.handler, args)


def _guarded(handler: Callable[[argparse.Namespace], int], args: argparse.Namespace) -> int:
    """Run a handler; errors become one line, with a traceback only where PUSH_RECOVERY_DEBUG is set."""
    try:
        return handler(args)
    except KeyboardInterrupt:
        return _complain(STOPPED, INTERRUPTED)
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
