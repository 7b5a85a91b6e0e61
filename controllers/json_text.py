"""JSON that users hand in, refused with one kind of error whatever it holds, and what goes into JSON."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

from .errors import InvalidValueError


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
