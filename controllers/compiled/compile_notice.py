"""A word on standard error while numba compiles, which happens once on a machine and takes long."""

from __future__ import annotations

import sys

from numba.core import event as events

MESSAGE = (
    "push-recovery: compiling kernels that numba has not cached yet, once on this machine; "
    "all of them take about a minute ..."
)


class _Announcement(events.Listener):
    """Prints `MESSAGE` at the first compilation of a function of this package; loading from disk is none."""

    def __init__(self) -> None:
        self.made = False

    def on_start(self, event: events.Event) -> None:
        dispatcher = (event.data or {}).get("dispatcher")
        module = str(getattr(getattr(dispatcher, "py_func", None), "__module__", ""))
        if not self.made and module.startswith("push_recovery."):
            self.made = True
            print(MESSAGE, file=sys.stderr, flush=True)

    def on_end(self, event: events.Event) -> None:
        pass


_announcement: _Announcement | None = None


def announce_compilation() -> None:
    """Have the first compilation of this process announced; to be called by what will need compiled code."""
    global _announcement
    if _announcement is None:
        _announcement = _Announcement()
        events.register("numba:compile", _announcement)
