"""The optional dependencies of training."""

from __future__ import annotations

from importlib.util import find_spec

from ...controllers.errors import MissingExtraError


def require_training() -> None:
    """Raise MissingExtraError, naming the command that installs it, unless torch and SB3 are there."""
    for module, package in (
        ("torch", "torch"),
        ("stable_baselines3", "stable-baselines3"),
        ("tensorboard", "tensorboard"),
    ):
        if find_spec(module) is None:
            raise MissingExtraError(package, "train")
