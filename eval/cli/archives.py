"""Archives of Stable-Baselines3 among the policies of a command, where the user trusts what is in them."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

ARCHIVE = ".zip"
LOADER = "...training.networks.archive"  # a package after this one, which is loaded only where it is needed


def trusted(policies: Sequence[str], trust: bool) -> list[Any]:
    """The policies with every FILE.zip as a policy of that label; without trust they stay, to be refused.

    Raises:
        InvalidValueError: a file can't be read.
    """
    if not trust or not any(name.endswith(ARCHIVE) for name in policies):
        return list(policies)
    archive = import_module(LOADER, __package__).ArchivePolicy
    return [{name: archive.of(name)} if name.endswith(ARCHIVE) else name for name in policies]
