"""A word on standard error while numba compiles, which happens once on a machine and takes long.

Of a command and its worker processes one says it.
"""

from __future__ import annotations

import os
import sys
import time

from numba.core import event as events

from .cache_place import cache_root

MESSAGE = (
    "push-recovery: compiling kernels, once on this machine and after a change of their sources; "
    "all of them take about two minutes ..."
)
LATELY = 600.0  # for which one word of a group of processes is enough [s]


class _Announcement(events.Listener):
    """Prints `MESSAGE` at the first compilation of a function of this package; loading from disk is none."""

    def __init__(self) -> None:
        self.made = False

    def on_start(self, event: events.Event) -> None:
        dispatcher = (event.data or {}).get("dispatcher")
        module = str(getattr(getattr(dispatcher, "py_func", None), "__module__", ""))
        if not self.made and module.startswith("push_recovery."):
            self.made = True
            if _first_to_say():
                print(MESSAGE, file=sys.stderr, flush=True)

    def on_end(self, event: events.Event) -> None:
        pass


def _first_to_say() -> bool:
    """Whether no process of this group, a command with its workers, has said it lately."""
    path = cache_root() / f"announced-{os.getpgrp() if hasattr(os, 'getpgrp') else os.getppid()}"
    try:
        if path.exists() and time.time() - path.stat().st_mtime > LATELY:
            path.unlink()
        path.touch(exist_ok=False)
    except FileExistsError:
        return False
    except OSError:
        return True
    return True


_announcement: _Announcement | None = None


def announce_compilation() -> None:
    """Have the first compilation of this process announced; to be called by what will need compiled code."""
    global _announcement
    if _announcement is None:
        _announcement = _Announcement()
        events.register("numba:compile", _announcement)
