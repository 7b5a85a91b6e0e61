"""How a policy came about: what stands under `training` in its JSON."""

from __future__ import annotations

import platform
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..eval.rollout.environments import code_digest
from .curve import CurvePoint
from .recipes import command_of
from .settings import TrainingSettings

PACKAGES = ("torch", "stable-baselines3", "mujoco", "gymnasium", "numpy", "numba")


def manifest(
    settings: TrainingSettings, timesteps: int, seconds: float, curve: Sequence[CurvePoint], file: str
) -> dict[str, Any]:
    """All that is needed to train a policy again, and what its training showed, as JSON.

    Args:
        settings: of the run.
        timesteps: learned actions that were taken.
        seconds: wall time of all parts of the run.
        curve: points of the learning curve.
        file: name of the policy's JSON.
    """
    return {
        "command": command_of(settings, file),
        "settings": settings.to_json(),
        "timesteps": timesteps,
        "seconds": round(seconds, 3),
        "curve": [asdict(point) for point in curve],
        "code": code_digest(),  # that of `config.json` beside rows: controllers and envs
        "commit": source_commit(Path(__file__)),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Versions of this package, of Python, and of the packages that decide what is learned."""
    ours = sys.modules[__name__.partition(".")[0]].__version__
    named = {name: version(name) for name in PACKAGES}
    return {"push-recovery": ours, "python": platform.python_version(), **named}


def source_commit(file: Path) -> str | None:
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
