"""Names of the learned policies that come with the package, and the files that they stand for.

The files lie in the folder `policies/` beside this module, NAME.safetensors and NAME.json, and are no code: a
new one leaves the digest of the code, and with it the rows of all others, as they are. How each came about
stands in its JSON; its settings are those of `training.recipes`.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.files import read_file
from ...controllers.json_text import parse_json
from ...controllers.learned.policy_file import policy_paths

FOLDER = Path(__file__).parent / "policies"
# `residual` is seed 0, named before it was trained; the other seeds show how much hangs on the seed.
NAMES = (
    "residual", "residual-seed1", "residual-seed2", "residual-seed3", "residual-seed4",
    "residual-hardware", "scratch", "joint", "joint-residual", "joint-residual-hardware", "residual-g1",
)  # fmt: skip


def shipped_names() -> tuple[str, ...]:
    """Those of NAMES whose files are there."""
    return tuple(name for name in NAMES if all(path.is_file() for path in policy_paths(FOLDER / name)))


def shipped_digest() -> str:
    """SHA-256 of the policies that are there: their names and files."""
    digest = hashlib.sha256()
    for name in shipped_names():
        digest.update(name.encode() + b"\0")
        for path in policy_paths(FOLDER / name):
            digest.update(hashlib.sha256(read_file(path)).digest())
    return digest.hexdigest()


def training_note(path: Path) -> Any:
    """What stands under `training` in a policy's JSON: how it came about; None where nothing does.

    Raises:
        InvalidValueError: the file can't be read, or is no JSON.
    """
    try:
        about = parse_json(f"the policy description {path}", read_file(path))
    except OSError as error:
        raise InvalidValueError(f"can't read the policy description {path}: {error.strerror}") from error
    return about.get("training") if isinstance(about, dict) else None


def named_file(name: str) -> str:
    """The weights' file that a name stands for; what is no name of a shipped policy comes back as it is.

    Raises:
        InvalidValueError: a name of a policy whose files are not there.
    """
    if name not in NAMES:
        return name
    if name not in shipped_names():
        there = ", ".join(shipped_names()) or "none"
        raise InvalidValueError(
            f"policy {name!r} does not come with this version, whose trained policies are: {there}; "
            f"train it with: push-recovery policies {name}"
        )
    return str(policy_paths(FOLDER / name)[0])
