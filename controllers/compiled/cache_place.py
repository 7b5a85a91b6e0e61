"""Where compiled kernels lie: one directory of a user, in it one for each version of each module with any."""

from __future__ import annotations

import os
import re
import shutil
import stat
import sys
import tempfile
import warnings
from contextlib import suppress
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

KEPT = 8  # versions of a module; the least lately used are deleted when another is compiled
FALLBACK = (
    "push-recovery: compiled kernels cannot be kept in {path} ({why}); they go to {other}. "
    "NUMBA_CACHE_DIR names another directory."
)


@cache
def cache_root() -> Path:
    """The directory of all kernels, made if need be.

    It is `push-recovery` in NUMBA_CACHE_DIR, or in the user's cache directory. Where that cannot be written,
    a directory for temporary files takes its place, with a warning.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    path = Path(given) / "push-recovery" if given else user_cache_path("push-recovery", appauthor=False)
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        other = own_temporary_directory()
        why = error.strerror or type(error).__name__
        warnings.warn(FALLBACK.format(path=path, why=why, other=other), RuntimeWarning, stacklevel=2)
        return other
    return path


def own_temporary_directory() -> Path:
    """A directory for temporary files that no other user can write to.

    Numba's files are pickles: whoever writes one has the reader run code. A name that others could have taken
    first is used only where it is a directory, belongs to this user, and is closed to all others.
    """
    if hasattr(os, "getuid"):
        path = Path(tempfile.gettempdir()) / f"push-recovery-kernels-{os.getuid()}"
        with suppress(OSError):
            path.mkdir(mode=0o700, exist_ok=True)
            found = path.lstat()
            closed = not stat.S_IMODE(found.st_mode) & 0o077
            if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and closed:
                return path
    return Path(tempfile.mkdtemp(prefix="push-recovery-kernels-"))


def module_directory(module: str, digest: str) -> Path:
    """Directory of one version of a module's kernels, not made yet; it counts as used now.

    Args:
        module: its name, as `push_recovery.controllers.model.gait_box`.
        digest: of everything that its kernels depend on.
    """
    path = cache_root() / f"{module.removeprefix('push_recovery.')}-{digest}"
    with suppress(OSError):  # not there yet, or another's
        os.utime(path)
    return path


def make_room(path: Path) -> None:
    """Delete the least lately used versions of a new directory's module, all but `KEPT` with the new one."""
    of_module = re.compile(re.escape(path.name.rpartition("-")[0]) + "-[0-9a-f]+")
    others = []
    for other in path.parent.iterdir():
        if other != path and of_module.fullmatch(other.name):
            try:
                others.append((other.stat().st_mtime, other))
            except FileNotFoundError:
                continue  # another process deletes, too
    for _, old in sorted(others, reverse=True)[KEPT - 1 :]:
        shutil.rmtree(old, ignore_errors=True)


def platform_versions() -> str:
    """What besides sources decides compiled code, or how it is kept."""
    import llvmlite
    import numba
    import numpy as np

    python = f"{sys.implementation.cache_tag}{getattr(sys, 'abiflags', '')}"
    return f"{python} numba {numba.__version__} llvmlite {llvmlite.__version__} numpy {np.__version__}"
