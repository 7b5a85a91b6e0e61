"""How a policy came about: what stands under `training` in its JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..eval.output.provenance import source_commit, versions
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
        "versions": versions(PACKAGES),
    }
