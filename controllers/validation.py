"""Checks of user input: each returns the clean value or raises an error naming the value and the bound."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from .errors import InvalidValueError, UnknownNameError, shown

K = TypeVar("K")


def require_choice(kind: str, value: object, valid: Sequence[str]) -> None:
    """Raise UnknownNameError unless the value is one of the valid names."""
    if not isinstance(value, str) or value not in valid:
        raise UnknownNameError(kind, value, valid)


def require_number(
    name: str, value: object, low: float = -math.inf, high: float = math.inf, open_low: bool = False
) -> float:
    """A finite float in [low, high] (or (low, high]); raises InvalidValueError naming the bound."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InvalidValueError(f"{name} must be a number, got {shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        raise InvalidValueError(f"{name} must be finite, got {shown(value)}: no float is so large") from None
    if not math.isfinite(number):
        raise InvalidValueError(f"{name} must be finite, got {number}")
    if number < low or number > high or (open_low and number == low):
        bracket = "(" if open_low else "["
        raise InvalidValueError(f"{name} must be in {bracket}{low:g}, {high:g}], got {number:g}")
    return number


def require_integer(name: str, value: object, low: int = 0, high: int | None = None) -> int:
    """An integer in [low, high], of any size without `high`; raises InvalidValueError naming the bound."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        number = int(value)
        if low <= number and (high is None or number <= high):
            return number
    bound = f">= {low}" if high is None else f"in [{low}, {high}]"
    raise InvalidValueError(f"{name} must be an integer {bound}, got {shown(value)}")


def require_kind(name: str, value: object, kind: type[K]) -> K:
    """The value, an object of a class; raises InvalidValueError naming both classes."""
    if not isinstance(value, kind):
        raise InvalidValueError(f"{name} must be a {kind.__name__}, got {shown(value)}")
    return value


def require_vector(name: str, value: object, largest: float = math.inf) -> tuple[float, float, float]:
    """Three finite floats, each within +-`largest`, as a tuple."""
    if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray) or len(value) != 3:
        raise InvalidValueError(f"{name} must have 3 entries (x, y, z), got {shown(value)}")
    x, y, z = (require_number(f"{name}[{i}]", entry, -largest, largest) for i, entry in enumerate(value))
    return (x, y, z)


def require_keys(kind: str, data: object, required: set[str], optional: set[str]) -> Mapping[str, Any]:
    """A mapping with all required keys and no unknown one."""
    if not isinstance(data, Mapping):
        raise InvalidValueError(f"{kind} must be an object, got {type(data).__name__}")
    if missing := sorted(required - set(data)):
        raise InvalidValueError(f"{kind} lacks {', '.join(missing)}")
    if unknown := sorted(str(key) for key in set(data) - required - optional):
        raise UnknownNameError(f"{kind} key", unknown[0], sorted(required | optional))
    return data
