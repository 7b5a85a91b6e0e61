"""Ctrl-C at any moment, any number of times: a command ends within seconds, with one line and code 130.

Only a command may install these handlers; to import this module, or any other of the package, leaves the
handlers of the process alone.
"""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, Self

GRACE = 2.0  # that a command has to come to its own end [s]
INTERRUPTED = 130  # exit code
STOPPED = "push-recovery: error: interrupted; what was done is kept"
SHOW_CURSOR = "\r\x1b[?25h"  # a progress bar hides it


def end_now(*_: object) -> None:
    """Say so and end this process; its workers end with it, and all that was finished is on disk."""
    with suppress(OSError):
        text = f"{SHOW_CURSOR if os.isatty(2) else ''}{STOPPED}\n"
        os.write(2, text.encode())
    os._exit(INTERRUPTED)


def end_at_ctrl_c() -> None:
    """End at the first Ctrl-C, as long as there is nothing to clear away; where it is ignored, ignore it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end_now)


class CtrlC:
    """Within the block the first Ctrl-C raises KeyboardInterrupt, and the others do nothing.

    The process ends where the block has not ended GRACE after the first one, as in compiled code that does
    not look up, and where the exception is raised in a place that can't pass it on, such as ``__del__``. Only
    the main thread may say so; in another one, and where Ctrl-C is ignored, nothing changes.

    Args:
        last: nothing but the end of the process follows: GRACE counts until then, and Ctrl-C stays without
            effect.
    """

    def __init__(self, last: bool = False):
        self.came = False
        self._last = last
        self._before: Any = signal.SIG_IGN
        self._over = threading.Event()

    def __enter__(self) -> Self:
        if threading.current_thread() is not threading.main_thread():
            return self
        self._before = signal.getsignal(signal.SIGINT)
        if self._before not in (signal.SIG_IGN, None):
            reader, self._pipe = os.pipe()
            os.set_blocking(self._pipe, False)
            # the number of a signal comes through it at once, the handler's turn when compiled code returns
            self._pipe_before = signal.set_wakeup_fd(self._pipe, warn_on_full_buffer=False)
            threading.Thread(target=self._watch, args=(reader,), daemon=True).start()
            self._hook_before, sys.unraisablehook = sys.unraisablehook, self._unraisable
            signal.signal(signal.SIGINT, self._raise)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before in (signal.SIG_IGN, None):
            return
        signal.signal(signal.SIGINT, signal.SIG_IGN if self._last else self._before)
        if not self._last:
            sys.unraisablehook = self._hook_before
            self._over.set()
            signal.set_wakeup_fd(self._pipe_before)
            os.close(self._pipe)

    def _raise(self, number: int, frame: FrameType | None) -> None:
        if not self.came:
            self.came = True
            raise KeyboardInterrupt

    def _watch(self, reader: int) -> None:
        """End the process GRACE after the first Ctrl-C, unless the block is over by then."""
        while number := os.read(reader, 1):
            if number[0] == signal.SIGINT and not self._over.wait(GRACE):
                end_now()
        os.close(reader)

    def _unraisable(self, lost: Any) -> None:
        if lost.exc_type is KeyboardInterrupt:
            end_now()
        self._hook_before(lost)


@contextmanager
def ctrl_c_held_back() -> Iterator[None]:
    """Keep Ctrl-C back until the end of the block; a process that is started in it is born deaf to it.

    In another thread than the main one only the latter holds.
    """
    came: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    before: Any = signal.signal(signal.SIGINT, lambda number, frame: came.append(number)) if main else None
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # children inherit it
    try:
        yield
    finally:
        if main:
            signal.signal(signal.SIGINT, before or signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if came:
            signal.raise_signal(signal.SIGINT)
