"""The source that outcomes of sampling MPC hang on, besides that of `controllers` and `envs`."""

from __future__ import annotations

from pathlib import Path

from ...controllers.files import read_file


def sampling_mpc_source() -> bytes:
    """Text of all modules of this room, with their names."""
    found = sorted(Path(__file__).parent.glob("*.py"))
    return b"\0".join(path.name.encode() + b"\0" + read_file(path) for path in found)
