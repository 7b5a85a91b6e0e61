"""Files that are written whole or not at all, and files that others have made."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from pathlib import Path

LARGEST = 2**30  # of a file that is read as a whole [bytes]


def write_atomically(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all: to a temporary neighbour first, then renamed.

    Content and name are on disk when this returns. A link in the place of that neighbour is removed, never
    followed.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    temporary.unlink(missing_ok=True)
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    sync_names(path.parent)


def sync_names(directory: Path) -> None:
    """Bring the names of new and renamed files of a directory to disk, where its file system can."""
    with contextlib.suppress(OSError):
        number = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file whole or not at all."""
    write_atomically(path, text.encode())


def read_file(path: str | Path) -> bytes:
    """The content of a file that a user has handed in.

    Raises:
        OSError: It cannot be read, is no regular file (a pipe would never answer, /dev/zero never end) nor a
            link to one, or has more than LARGEST bytes.
    """
    about = os.stat(path)
    if not stat.S_ISREG(about.st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file", str(path))
    if about.st_size > LARGEST:
        raise OSError(errno.EFBIG, f"it has {about.st_size} bytes, more than {LARGEST}", str(path))
    return Path(path).read_bytes()


def is_file(path: str | Path) -> bool:
    """Whether a name is that of a file; one that no file can have (too long, not text) is not."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False
