"""Checkpoints that are whole or absent: safetensors and JSON in a folder that is renamed into place.

They hold what PPO needs to go on (network, optimiser, normalisation, counters); reading one runs no code.
"""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from ..controllers.errors import InvalidValueError
from ..controllers.files import read_file, sync_names, write_atomically
from ..controllers.validation import parse_json
from .settings import TrainingSettings

KEEP = 2
FORMAT_VERSION = 1
FOLDER = "checkpoints"


@dataclass(frozen=True)
class Checkpoint:
    """A run at one moment."""

    settings: TrainingSettings
    timesteps: int
    updates: int  # gradient epochs so far, SB3's counter
    seconds: float  # of training so far, over all its parts
    tensors: dict[str, NDArray[Any]]


def save_checkpoint(
    out: Path, settings: TrainingSettings, model: PPO, venv: VecNormalize, seconds: float
) -> Path:
    """Write OUT/checkpoints/<timesteps> whole, then drop all but the newest two."""
    final = out / FOLDER / f"{model.num_timesteps:012d}"
    for left in (out / FOLDER).glob(".*.tmp"):  # by a kill, or on a full disk
        shutil.rmtree(left, ignore_errors=True)
    temporary = final.with_name(f".{final.name}.tmp")
    temporary.mkdir(parents=True)
    state = {
        "format_version": FORMAT_VERSION,
        "timesteps": model.num_timesteps,
        "updates": model._n_updates,
        "seconds": seconds,
        "settings": settings.to_json(),
    }
    write_atomically(temporary / "tensors.safetensors", save(_tensors(model, venv)))
    write_atomically(temporary / "state.json", json.dumps(state, indent=1).encode())
    shutil.rmtree(final, ignore_errors=True)
    os.replace(temporary, final)
    sync_names(final.parent)
    for old in find_checkpoints(out)[:-KEEP]:
        shutil.rmtree(old, ignore_errors=True)
    return final


def find_checkpoints(out: Path) -> list[Path]:
    """The whole checkpoints of a run, oldest first."""
    folder = out / FOLDER
    return sorted(path for path in folder.glob("[0-9]*") if path.is_dir()) if folder.is_dir() else []


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint, or the newest one of a run's folder.

    Raises:
        InvalidValueError: There is none, or it is damaged.
    """
    if not (path / "state.json").is_file():
        found = find_checkpoints(path)
        if not found:
            raise InvalidValueError(
                f"no checkpoint in {path}: name a run's folder (its --out) or one of its {FOLDER}"
            )
        path = found[-1]
    try:
        state = parse_json("state.json", read_file(path / "state.json"))
        tensors = load(read_file(path / "tensors.safetensors"))
        if state["format_version"] != FORMAT_VERSION:
            raise InvalidValueError(f"format {state['format_version']}, this version reads {FORMAT_VERSION}")
        settings = TrainingSettings.from_json(state["settings"])
        return Checkpoint(
            settings, int(state["timesteps"]), int(state["updates"]), float(state["seconds"]), tensors
        )
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(f"the checkpoint {path} is damaged: {error}") from error


def restore(checkpoint: Checkpoint, model: PPO, venv: VecNormalize) -> None:
    """Put a checkpoint's state into a freshly built PPO and its environments.

    Raises:
        InvalidValueError: The checkpoint is of other spaces or layers.
    """
    tensors = checkpoint.tensors
    try:
        model.policy.load_state_dict(_part(tensors, "policy."))
        optimiser = model.policy.optimizer
        moments: dict[int, dict[str, torch.Tensor]] = {}
        for name, tensor in _part(tensors, "optimizer.").items():
            index, key = name.split(".", 1)
            moments.setdefault(int(index), {})[key] = tensor
        optimiser.load_state_dict(optimiser.state_dict() | {"state": moments})
        _restore_statistics(venv.obs_rms, tensors, "observation", model.observation_space.shape)
        _restore_statistics(venv.ret_rms, tensors, "return", ())
    except (RuntimeError, KeyError, ValueError) as error:
        raise InvalidValueError(
            f"the checkpoint of {checkpoint.settings.env_id} does not fit its environment: {error}"
        ) from error
    model.num_timesteps = checkpoint.timesteps
    model._n_updates = checkpoint.updates


def _tensors(model: PPO, venv: VecNormalize) -> dict[str, NDArray[Any]]:
    tensors = {f"policy.{name}": value.numpy().copy() for name, value in model.policy.state_dict().items()}
    for index, moments in model.policy.optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{key}": value.numpy().copy() for key, value in moments.items()}
    running: dict[str, Any] = {"observation": venv.obs_rms, "return": venv.ret_rms}
    for name, statistics in running.items():
        tensors[f"{name}.mean"] = np.array(statistics.mean, dtype=np.float64)
        tensors[f"{name}.variance"] = np.array(statistics.var, dtype=np.float64)
        tensors[f"{name}.count"] = np.array(statistics.count, dtype=np.float64)
    return tensors


def _part(tensors: dict[str, NDArray[Any]], prefix: str) -> dict[str, torch.Tensor]:
    return {
        name[len(prefix) :]: torch.from_numpy(value.copy())
        for name, value in tensors.items()
        if name.startswith(prefix)
    }


def _restore_statistics(
    statistics: Any, tensors: dict[str, NDArray[Any]], name: str, shape: tuple[int, ...] | None
) -> None:
    mean, variance = tensors[f"{name}.mean"], tensors[f"{name}.variance"]
    if mean.shape != shape or variance.shape != shape:
        raise ValueError(f"statistics of the {name} have shape {mean.shape}, expected {shape}")
    statistics.mean, statistics.var = mean.copy(), variance.copy()
    statistics.count = float(tensors[f"{name}.count"])
