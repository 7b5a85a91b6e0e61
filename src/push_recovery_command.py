"""The command `push-recovery`, which a Ctrl-C ends with one line from its first moment on.

It lies beside the package because to import anything of that loads Gymnasium first, and because only a
command may change what Ctrl-C does: an import never does.
"""
# pyright: reportMissingImports=false

import os
import signal

INTERRUPTED = 130  # exit code
LINE = b"push-recovery: error: interrupted; what was done is kept\n"


def end_now(*_: object) -> None:
    """Say so and end this process, in which nothing has been begun."""
    os.write(2, LINE)
    os._exit(INTERRUPTED)


def main() -> int:
    """Run the command of this process; returns its exit code."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end_now)
    from push_recovery.eval.cli.main import main as run

    return run()
