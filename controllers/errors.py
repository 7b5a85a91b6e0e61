"""The one root of every error that a user of this package can cause."""

from __future__ import annotations

import difflib
import math
import numbers
from collections.abc import Iterable
from typing import TypeGuard

LONGEST_SHOWN = 200  # characters of a refused value in a message


def is_integer(value: object) -> TypeGuard[int]:
    """Whether a value is an integer, numpy's included; True and False are none."""
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def is_finite_number(value: object) -> TypeGuard[float]:
    """Whether a value is a finite real number that a float can hold, numpy's included; no True or False."""
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the largest float
        return False


def shown(value: object) -> str:
    """A refused value as an error message shows it: its repr, cut where it is long."""
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python writes
        return f"a {type(value).__name__} of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}... ({len(text)} characters)"


class PushRecoveryError(Exception):
    """Root of all errors raised on purpose by this package."""


class InvalidValueError(PushRecoveryError, ValueError):
    """A value is outside its bounds, not finite, or has the wrong shape."""


class UnknownNameError(PushRecoveryError, ValueError):
    """A name is not among the valid ones; the message lists them."""

    def __init__(self, kind: str, name: object, valid: Iterable[str]):
        valid = list(valid)
        close = difflib.get_close_matches(name, valid, n=1) if isinstance(name, str) else []
        hint = f"; did you mean {close[0]!r}?" if close else ""
        super().__init__(f"unknown {kind} {shown(name)}{hint} (valid: {', '.join(valid)})")


class MissingExtraError(PushRecoveryError, ImportError):
    """An optional dependency is missing; the message names the command that installs it."""

    def __init__(self, package: str, extra: str):
        super().__init__(f"{package} is not installed; install it with: pip install 'push-recovery[{extra}]'")
