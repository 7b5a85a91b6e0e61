"""JSON that users hand in: whatever it holds, what is refused is refused with one kind of error."""

from __future__ import annotations

import json
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
