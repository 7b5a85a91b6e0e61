"""Checks of user input: each returns the clean value or raises an error naming the value and the bound.

Numbers may be Python's or numpy's scalars and become Python's; True and False are no numbers, and neither are
arrays without a dimension.
"""

from __future__ import annotations

import json
import math
import numbers
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from .errors import InvalidValueError, UnknownNameError, is_finite_number, is_integer, shown

K = TypeVar("K")
TEXT = str, bytes, bytearray  # sequences that are no lists


def require_choice(kind: str, value: object, valid: Sequence[str]) -> None:
    """Raise UnknownNameError unless the value is one of the valid names."""
    if not isinstance(value, str) or value not in valid:
        raise UnknownNameError(kind, value, valid)


def require_number(
    name: str, value: object, low: float = -math.inf, high: float = math.inf, open_low: bool = False
) -> float:
    """A finite float in [low, high] (or (low, high]); raises InvalidValueError naming the bound."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
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
    if is_integer(value):
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


def require_all(name: str, values: object, kind: type[K]) -> tuple[K, ...]:
    """The values as a tuple, objects of a class; raises InvalidValueError naming what is none."""
    if isinstance(values, TEXT) or not isinstance(values, Iterable):
        raise InvalidValueError(f"{name} must be a sequence of {kind.__name__}, got {shown(values)}")
    checked = tuple(values)
    if bad := [value for value in checked if not isinstance(value, kind)]:
        raise InvalidValueError(f"{name} must hold {kind.__name__} objects, got {shown(bad[0])}")
    return checked


def require_vector(name: str, value: object, largest: float = math.inf) -> tuple[float, float, float]:
    """Three finite floats, each within +-`largest`, as a tuple."""
    if isinstance(value, TEXT) or not isinstance(value, Sequence | np.ndarray) or len(value) != 3:
        raise InvalidValueError(f"{name} must have 3 entries (x, y, z), got {shown(value)}")
    x, y, z = (require_number(f"{name}[{i}]", entry, -largest, largest) for i, entry in enumerate(value))
    return (x, y, z)


def require_pair(name: str, value: object, largest: float = math.inf) -> tuple[float, float]:
    """Two finite floats, each within +-`largest`, as a tuple; no -0.0."""
    if isinstance(value, TEXT) or not isinstance(value, Sequence | np.ndarray) or len(value) != 2:
        raise InvalidValueError(f"{name} must have 2 entries, got {shown(value)}")
    first, second = (require_number(f"{name}[{i}]", one, -largest, largest) for i, one in enumerate(value))
    return first + 0.0, second + 0.0


def require_keys(kind: str, data: object, required: set[str], optional: set[str]) -> Mapping[str, Any]:
    """A mapping with all required keys and no unknown one."""
    if not isinstance(data, Mapping):
        raise InvalidValueError(f"{kind} must be an object, got {type(data).__name__}")
    if missing := sorted(required - set(data)):
        raise InvalidValueError(f"{kind} lacks {', '.join(missing)}")
    if unknown := sorted(str(key) for key in set(data) - required - optional):
        raise UnknownNameError(f"{kind} key", unknown[0], sorted(required | optional))
    return data


Check = Callable[[str, Any], object]  # of a name and its value; raises InvalidValueError


def require_text(name: str, value: object) -> str:
    """The value, text; raises InvalidValueError otherwise."""
    if not isinstance(value, str):
        raise InvalidValueError(f"{name} must be text, got {shown(value)}")
    return value


def require_truth(name: str, value: object) -> bool:
    """The value, True or False; raises InvalidValueError otherwise."""
    if not isinstance(value, bool):
        raise InvalidValueError(f"{name} must be true or false, got {shown(value)}")
    return value


def require_object(name: str, value: object) -> dict[str, Any]:
    """The value, a JSON object; raises InvalidValueError otherwise."""
    if not isinstance(value, dict):
        raise InvalidValueError(f"{name} must be an object, got {shown(value)}")
    return value


def or_none(check: Check) -> Check:
    """A check that lets None pass, too."""
    return lambda name, value: value is None or check(name, value)


def each(check: Check) -> Check:
    """A check of each entry of a JSON object."""
    return lambda name, value: [
        check(f"{name}.{key:.60}", one) for key, one in require_object(name, value).items()
    ]


def check_fields(
    data: object, checks: Mapping[str, Check], optional: Collection[str] = (), name: str = ""
) -> None:
    """Check a JSON object that others may have written, field by field.

    Args:
        data: the object; fields without a check may be anything.
        checks: by field.
        optional: fields that it need not have.
        name: what messages call the object; without one they name its fields alone.

    Raises:
        InvalidValueError: it is no object, lacks a field, or a field is refused by its check.
    """
    known = require_object(name or "it", data)
    if lacks := [key for key in checks if key not in known and key not in optional]:
        raise InvalidValueError(f"{name or 'it'} lacks {', '.join(lacks)}")
    for key, check in checks.items():
        if key in known:
            check(f"{name}.{key}" if name else key, known[key])


def parse_json(what: str, text: str | bytes) -> Any:
    """The content of a JSON text that a user has handed in; `what` names it in the error.

    Raises:
        InvalidValueError: no JSON, no UTF-8, a key that an object has twice, an integer of more digits than
            Python reads, or lists and objects nested deeper than Python's stack.
    """
    try:
        text = text.decode("utf-8") if isinstance(text, bytes) else text
        return json.loads(text, object_pairs_hook=_without_repeats)
    except RecursionError:
        raise InvalidValueError(f"{what} is not valid JSON: lists or objects are nested too deep") from None
    except (TypeError, ValueError) as error:
        raise InvalidValueError(f"{what} is not valid JSON: {error}") from error


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of these keys and values; raises ValueError for a key that comes twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {shown(twice)} stands in an object more than once")
    return found


def changed_fields(value: Any) -> dict[str, Any]:
    """Fields of a dataclass object that differ from their default, or have none: name -> value, in order."""
    pairs = ((field, getattr(value, field.name)) for field in fields(value))
    return {field.name: own for field, own in pairs if own != field.default}


def keep_python_numbers(record: Any) -> None:
    """Put Python's numbers in the place of numpy's in the fields of a frozen dataclass object.

    A float32 would make all arithmetic with it single precision, and JSON knows Python's numbers only.
    """
    for field in fields(record):
        if isinstance(value := getattr(record, field.name), np.generic):
            object.__setattr__(record, field.name, value.item())


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """The entries of two records that differ, as "mass 60 there and 33.3 here"; empty where none does.

    Entries that only one of them has are left out; numbers may differ by 1e-9 of the larger one.
    """

    def same(one: Any, other: Any) -> bool:
        if is_finite_number(one) and is_finite_number(other):
            return math.isclose(one, other, rel_tol=1e-9)
        return bool(one == other)

    def short(value: Any) -> str:
        return f"{value:.4g}" if isinstance(value, float) else str(value)

    both = [(name, value, here[name]) for name, value in there.items() if name in here]
    found = [(name, short(one), short(other)) for name, one, other in both if not same(one, other)]
    return ", ".join(f"{name} {one} there and {other} here" for name, one, other in found)
