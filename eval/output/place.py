"""Whether a file can be written, asked before the work that it is for."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path

from ...controllers.errors import InvalidValueError


def require_place(path: Path) -> None:
    """Make the folder of a file to come, and try to write there.

    Raises:
        InvalidValueError: nothing can be written there, or the name is that of a folder.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        reason = "its folder is a file" if isinstance(error, FileExistsError) else error.strerror
        raise InvalidValueError(f"can't write to {str(path)!r}: {reason}") from error
