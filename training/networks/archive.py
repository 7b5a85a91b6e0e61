"""A model that Stable-Baselines3 has saved, as a policy: whoever loads one runs the code in it."""

from __future__ import annotations

import hashlib
import importlib
import io
import json
import pickle
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError, MissingExtraError
from ...controllers.files import read_file

# What only the algorithm of that name has among its settings, the first that fits
ALGORITHMS = {"PPO": "clip_range", "TD3": "target_policy_noise", "SAC": "target_entropy", "A2C": "vf_coef"}
STATISTICS = "vecnormalize.pkl"  # beside the archive, where it was trained on normalised observations


@dataclass(frozen=True)
class ArchivePolicy:
    """Acts as the model of an archive, without exploration; workers load it for themselves.

    Args:
        path: of the archive, FILE.zip.
        sha256: of what was read when the policy was named; other content is refused later.
    """

    path: str
    sha256: str

    @classmethod
    def of(cls, path: str) -> ArchivePolicy:
        """The policy of an archive, whose content is not looked at yet.

        Raises:
            InvalidValueError: it can't be read.
        """
        return cls(path, hashlib.sha256(b"".join(_contents(path))).hexdigest())

    def predict(self, observation: Any, deterministic: bool = True) -> tuple[Any, None]:
        """The model's action, in the way of Stable-Baselines3."""
        model, statistics = self._loaded
        seen = observation if statistics is None else statistics.normalize_obs(observation)
        return model.predict(seen, deterministic=deterministic)[0], None

    @cached_property
    def _loaded(self) -> tuple[Any, Any]:
        """The model, and the statistics of its observations or None."""
        archive, *statistics = _contents(self.path)
        if hashlib.sha256(b"".join((archive, *statistics))).hexdigest() != self.sha256:
            raise InvalidValueError(f"{self.path!r} has changed since it was named")
        try:
            library = importlib.import_module("stable_baselines3")
        except ImportError as error:
            raise MissingExtraError("stable_baselines3", "train") from error
        name = algorithm_of(self.path, archive)
        try:
            model = getattr(library, name).load(io.BytesIO(archive), device="cpu")
            found = [pickle.loads(content) for content in statistics]  # noqa: S301  # trusted by the user
        except Exception as error:  # of any library that the archive names
            raise InvalidValueError(f"{self.path!r} can't be loaded as {name}: {error}") from error
        for one in found:
            one.training = False
        return model, found[0] if found else None

    def __getstate__(self) -> dict[str, str]:
        """What workers are handed: not the model."""
        return {"path": self.path, "sha256": self.sha256}


def algorithm_of(path: str, archive: bytes) -> str:
    """Name of the algorithm that has saved an archive, from its settings; runs nothing of it.

    Raises:
        InvalidValueError: no archive of Stable-Baselines3, or of another algorithm.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as content:
            settings = json.loads(content.read("data"))
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        raise InvalidValueError(f"{path!r} is no archive of Stable-Baselines3: {error}") from error
    name = next((name for name, key in ALGORITHMS.items() if key in settings), None)
    if name is None:
        raise InvalidValueError(f"{path!r} is of none of the algorithms {', '.join(ALGORITHMS)}")
    return name


def _contents(path: str) -> list[bytes]:
    """The archive, and the statistics beside it where there are any."""
    beside = Path(path).with_name(STATISTICS)
    try:
        return [read_file(place) for place in (Path(path), *([beside] if beside.is_file() else []))]
    except OSError as error:
        raise InvalidValueError(f"can't read the policy {path!r}: {error.strerror or error}") from error
