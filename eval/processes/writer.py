"""One writer a directory: a lock that ends with the process that holds it, however that ends."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path
from types import TracebackType
from typing import IO

from ...controllers.errors import InvalidValueError

LOCK = ".lock"


class Writer:
    """The only one that writes to a directory, until it is released; a context manager.

    The system's lock on the file LOCK says so (flock); where a killed process has left the file behind, it
    means nothing. On release the file goes, and with it the folders that were made for it and are empty.

    Args:
        directory: made if absent.

    Raises:
        InvalidValueError: another process, or another run in this one, writes there; or nobody can.
    """

    def __init__(self, directory: Path):
        self._path = directory / LOCK
        try:
            self._made = [folder for folder in (directory, *directory.parents) if not folder.exists()]
            directory.mkdir(parents=True, exist_ok=True)
            self._file = _take(self._path)
        except BlockingIOError:
            raise InvalidValueError(
                f"another run{_holder(self._path)} is writing to {str(directory)!r}: wait for its end, or "
                "choose another directory"
            ) from None
        except OSError as error:
            raise InvalidValueError(f"can't write to the directory {str(directory)!r}: {error}") from error

    def release(self) -> None:
        """Let others write; may be called twice."""
        if self._file.closed:
            return
        with contextlib.suppress(OSError):
            self._path.unlink()  # before the lock goes: what is locked next is a new file
        self._file.close()
        with contextlib.suppress(OSError):
            for folder in self._made:
                folder.rmdir()

    def __enter__(self) -> Writer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def _take(path: Path) -> IO[bytes]:
    """The locked file.

    Raises:
        BlockingIOError: another holds the lock.
        OSError: the file can't be made, is a link, or is on a file system without locks.
    """
    while True:
        file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666), "r+b", buffering=0)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_still(file, path):
                with contextlib.suppress(OSError):  # only for the message of others: no space is no reason
                    file.truncate(0)
                    file.write(b"%d" % os.getpid())
                return file
        except BaseException:
            file.close()
            raise
        file.close()


def _is_still(file: IO[bytes], path: Path) -> bool:
    """Whether a path leads to an open file; the one who held its lock before may have removed it."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _holder(path: Path) -> str:
    """The process that holds the lock, where it says so."""
    try:
        number = path.read_bytes()
    except OSError:
        return ""
    return f" (process {int(number)})" if number.isdigit() else ""
