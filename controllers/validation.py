"""Checks of user input: numbers, choices, JSON, and robots that a preset or a policy was made for.

Checks of user input: each returns the clean value or raises an error naming the value and the bound.

JSON that users hand in, refused with one kind of error whatever it holds, and what goes into JSON.

What differs between the robot that something was made for and another one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
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


def parse_json(what: str, text: str | bytes) -> Any:
    """What a JSON text holds.

    Args:
        what: What the text is, for the error: "scenario", "suite file 'x.json'".
        text: JSON; bytes are UTF-8.

    Raises:
        InvalidValueError: No JSON, no UTF-8, an integer of more digits than Python reads, or lists
            and objects nested deeper than Python's stack.
    """
    try:
        return json.loads(text.decode("utf-8") if isinstance(text, bytes) else text)
    except RecursionError:
        raise InvalidValueError(f"{what} is not valid JSON: lists or objects are nested too deep") from None
    except (TypeError, ValueError) as error:
        raise InvalidValueError(f"{what} is not valid JSON: {error}") from error


def changed_fields(value: Any) -> dict[str, Any]:
    """Fields of a dataclass object that differ from their default: name -> value, in order.

    One without a default always counts as changed.
    """
    pairs = ((field, getattr(value, field.name)) for field in fields(value))
    return {field.name: own for field, own in pairs if own != field.default}


CLOSE = 1e-9  # relative difference of numbers that count as one


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """The entries of two records that differ, as "mass 60 there and 33.3 here"; empty where none does.

    Entries that only one of them has are left out.
    """
    found = [
        f"{name} {_short(value)} there and {_short(here[name])} here"
        for name, value in there.items()
        if name in here and not _same(value, here[name])
    ]
    return ", ".join(found)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, bool) or not isinstance(one, int | float) or not isinstance(other, int | float):
        return bool(one == other)
    return abs(one - other) <= CLOSE * max(abs(one), abs(other))


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
