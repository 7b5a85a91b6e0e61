"""The page of a command: written where its extra is installed, and how to get it where not."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from ...controllers.errors import MissingExtraError


def write_or_say(write: Callable[[], Path]) -> Path | None:
    """Write a page; where its extra is missing, say so in one line on standard error and go on."""
    try:
        return write()
    except MissingExtraError as error:
        print(f"no report.html: {error}", file=sys.stderr)
        return None


def print_page(path: Path | None) -> None:
    """Where the page is, if there is one."""
    if path is not None:
        print(f"page: {path}")
