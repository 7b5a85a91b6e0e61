"""What a module's compiled code can depend on, as one digest: its source and that of all it imports.

Numba's own cache looks at the file of a kernel alone and does not notice a changed callee, or a changed
constant, in another. The digest of a module is taken over its own text, the digests of the modules of this
project that it imports at its top level, the package's data files where it names any, and the versions of the
outside packages that it imports. The flow of the rooms has no circle, so neither has this recursion.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
from functools import cache

# Statements at the top level only: what a function imports when it runs is no global of a kernel.
IMPORT = re.compile(rb"\n(?:from (\.+)([\w.]*) import (\([^)]*\)|[^\n]*)|(?:import|from) (\w+))")
NAME = re.compile(r"[A-Za-z_]\w*")
LENGTH = 16  # hexadecimal digits: two versions of one module do not meet


@cache
def source_digest(module: str) -> str:
    """Digest of a module's source and of everything that it is made of; see the module's docstring.

    Args:
        module: full name of a module of this project that is imported, or far enough to define a kernel.

    Raises:
        OSError: if a source cannot be read.
    """
    text = source_of(module)
    digest, inside, outside = hashlib.sha256(text), set(), set()
    for dots, base, names, other in IMPORT.findall(b"\n" + text):
        if other:
            outside.add(other.decode())
        else:
            inside |= imported_modules(module, len(dots), base.decode(), names.decode())
    for name in sorted(inside - {module}):
        digest.update(source_digest(name).encode())
    for name in sorted(outside):
        digest.update(f"{name} {getattr(sys.modules.get(name), '__version__', '')}".encode())
    if b".json" in text or b".xml" in text:
        digest.update(data_digest(".".join(module.split(".")[:2])).encode())
    return digest.hexdigest()[:LENGTH]


def source_of(module: str) -> bytes:
    """Text of an imported module.

    Raises:
        FileNotFoundError: if it has no file.
    """
    path = getattr(sys.modules[module], "__file__", None)
    if path is None:
        raise FileNotFoundError(f"module {module} has no source file")
    with open(path, "rb") as file:
        return file.read()


def imported_modules(module: str, dots: int, base: str, names: str) -> set[str]:
    """Modules that `from <dots><base> import <names>` means in a module; a name may be a module or not."""
    parts = module.split(".")
    above = ".".join([*parts[: len(parts) - dots], *([base] if base else [])])
    return {
        name for name in (above, *(f"{above}.{name}" for name in NAME.findall(names))) if name in sys.modules
    }


@cache
def data_digest(package: str) -> str:
    """Digest of all data files of an imported package."""
    files = []
    for folder, _, names in os.walk(sys.modules[package].__path__[0]):
        files += [os.path.join(folder, name) for name in names if name.endswith((".json", ".xml"))]
    digest = hashlib.sha256()
    for path in sorted(files):
        with open(path, "rb") as file:
            digest.update(os.path.basename(path).encode() + file.read())
    return digest.hexdigest()
