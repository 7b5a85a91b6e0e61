"""Objects of the user: modules that the user named, and what in them acts."""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from typing import Any

from ...controllers.errors import InvalidValueError, UnknownNameError
from ..shipped.names import named_file


def import_from_here(name: str) -> Any:
    """A module that the user named, also from the working directory as `python -m` has it.

    Raises:
        InvalidValueError: no such module, or it can't be imported.
    """
    if not all(part.isidentifier() for part in name.split(".")):
        raise InvalidValueError(f"{name!r:.200} is no name of a module")
    here = os.getcwd()
    if here not in sys.path and "" not in sys.path:
        sys.path.insert(0, here)
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidValueError(f"cannot import {name!r}: {error}") from error


def import_attribute(name: str) -> tuple[Any, Any]:
    """Module and attribute of MODULE:ATTRIBUTE.

    Raises:
        UnknownNameError: the module has no such attribute; lists those that it has.
        InvalidValueError: no such module, or it can't be imported.
    """
    module_name, _, path = name.partition(":")
    found = module = import_from_here(module_name)
    for part in path.split("."):
        if not part or not hasattr(found, part):
            valid = [entry for entry in vars(found) if not entry.startswith("_")]
            raise UnknownNameError(f"attribute of {module_name}", part, sorted(valid))
        found = getattr(found, part)
    return module, found


def acting(policy: Any, name: str = "") -> Any:
    """A name as text, or an object that acts; a class or a function without `predict` is called for it.

    The name of a shipped policy becomes that of its file.

    Raises:
        InvalidValueError: there is no way to an object with `predict`, or no file of a shipped policy.
    """
    if isinstance(policy, str | os.PathLike):
        return named_file(os.fspath(policy))
    name = name or repr(policy)[:200]
    if isinstance(policy, type) or (callable(policy) and not hasattr(policy, "predict")):
        try:
            policy = policy()
        except TypeError as error:
            raise InvalidValueError(f"policy {name} cannot be made without arguments: {error}") from error
    if not callable(getattr(policy, "predict", None)):
        raise InvalidValueError(f"policy {name} has no method predict(observation)")
    return policy


def source_of(what: Any) -> bytes:
    """Source text of a module or class; nothing where there is none to read."""
    try:
        return inspect.getsource(what).encode()
    except (OSError, TypeError):
        return b""
