"""The one root of every error that a user of this package can cause."""

from __future__ import annotations

import difflib
import math
import numbers
from collections.abc import Iterable


def is_finite_number(value: object) -> bool:
    """Whether a value is a finite real number; True and False are none."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(value)


class PushRecoveryError(Exception):
    """Root of all errors raised on purpose by this package."""


class InvalidValueError(PushRecoveryError, ValueError):
    """A value is outside its bounds, not finite, or has the wrong shape."""


class UnknownNameError(PushRecoveryError, ValueError):
    """A name is not among the valid ones; the message lists them."""

    def __init__(self, kind: str, name: object, valid: Iterable[str]):
        valid = list(valid)
        close = difflib.get_close_matches(str(name), valid, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        super().__init__(f"unknown {kind} {name!r}{hint} (valid: {', '.join(valid)})")


class MissingExtraError(PushRecoveryError, ImportError):
    """An optional dependency is missing; the message names the command that installs it."""

    def __init__(self, package: str, extra: str):
        super().__init__(f"{package} is not installed; install it with: pip install 'push-recovery[{extra}]'")
