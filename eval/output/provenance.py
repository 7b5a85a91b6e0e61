"""What wrote a result: versions, commit, kind of machine."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("mujoco", "numpy", "numba", "scipy", "gymnasium", "osqp", "daqp")  # that outcomes may hang on


def versions(packages: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Versions of this package, of Python and of others, as far as they are installed."""
    found = {
        "push-recovery": sys.modules[__name__.partition(".")[0]].__version__,
        "python": platform.python_version(),
    }
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def machine_kind() -> str:
    """Operating system, processor family and number of cores; no name of the machine."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"


def source_commit(file: Path = Path(__file__)) -> str | None:
    """Commit of the repository that tracks a file, "-dirty" where files differ from it; None without one."""
    if _git(file.parent, "ls-files", "--error-unmatch", file.name) is None:
        return None  # in no repository, or in one that is not ours
    return _git(file.parent, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")


def _git(folder: Path, *words: str) -> str | None:
    """What git says in a folder; None where it fails or is not installed."""
    try:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=True)  # noqa: S603, S607
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
