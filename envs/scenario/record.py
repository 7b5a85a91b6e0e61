"""Records: frozen dataclasses that are read from JSON and written, and kinds of them that anyone may add."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from typing import Any, ClassVar, Generic, Self, TypeVar

from ...controllers.errors import InvalidValueError
from ...controllers.validation import parse_json, require_choice, require_keys


class JsonRecord:
    """Base of a frozen dataclass whose fields are the keys of a JSON object, in their order."""

    json_name: ClassVar[str]  # what errors call such an object
    left_out: ClassVar[tuple[str, ...] | None] = ()  # keys not written at their default; None: all of them

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types: a tuple is a list, another record an object."""
        values = {}
        for name, default in _defaults(type(self)):
            value = getattr(self, name)
            if default is MISSING or value != default:
                values[name] = _plain(value)
        return values

    @classmethod
    def from_dict(cls, data: object) -> Self:
        """Inverse of `to_dict`; fields with a default may be left out.

        Raises:
            InvalidValueError: no object, a missing key, or an impossible value.
            UnknownNameError: an unknown key.
        """
        entries = fields(cls)  # type: ignore[arg-type]
        required = {entry.name for entry in entries if entry.default is MISSING}
        values = require_keys(cls.json_name, data, required, {entry.name for entry in entries} - required)
        return cls(**{name: cls._parsed(name, value) for name, value in values.items()})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The record of a JSON text; raises InvalidValueError on text that is no JSON."""
        return cls.from_dict(parse_json(f"text of {cls.json_name}", text))

    @classmethod
    def _parsed(cls, name: str, value: Any) -> Any:
        """The value of a field, from its JSON; a list is a tuple, so that the record can be hashed."""
        return tuple(value) if isinstance(value, list) else value

    def _set(self, **values: Any) -> None:
        """Replace fields of the frozen record, from within its `__post_init__`."""
        for name, value in values.items():
            object.__setattr__(self, name, value)


def object_of(kind: type[JsonRecord], value: Any) -> Any:
    """The record of a JSON object; any other value as it is, for the constructor to judge."""
    return kind.from_dict(value) if isinstance(value, Mapping) else value


@cache
def _defaults(kind: type[JsonRecord]) -> tuple[tuple[str, Any], ...]:
    """Fields of a kind of record, each with the default at which it is left out; MISSING: never."""
    return tuple(
        (field.name, field.default if kind.left_out is None or field.name in kind.left_out else MISSING)
        for field in fields(kind)  # type: ignore[arg-type]
    )


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    return value.to_dict() if isinstance(value, JsonRecord) else value


K = TypeVar("K", bound=JsonRecord)
_Class = TypeVar("_Class", bound=type[JsonRecord])


@dataclass(frozen=True)
class Kinds(Generic[K]):
    """Kinds of something, each a class of records, known by its `json_name` once it is registered."""

    what: str  # they are kinds of, for errors
    by_name: dict[str, type[K]] = field(default_factory=dict)

    def register(self, kind: _Class) -> _Class:
        """Let scenarios have a kind; a decorator of its class.

        Raises:
            InvalidValueError: another kind has that name.
        """
        if self.by_name.setdefault(kind.json_name, kind) is not kind:  # type: ignore[arg-type]
            raise InvalidValueError(f"a {self.what} of kind {kind.json_name!r} is registered already")
        return kind

    def read(self, data: object) -> K:
        """The record of a JSON object whose key "kind" names what it is.

        Raises:
            UnknownNameError: no such kind, or another key than it has.
            InvalidValueError: no object, or an impossible value.
        """
        keys = set(data) - {"kind"} if isinstance(data, dict) else set()
        values = dict(require_keys(self.what, data, {"kind"}, keys))
        require_choice(f"kind of {self.what}", kind := values.pop("kind"), list(self.by_name))
        return self.by_name[kind].from_dict(values)
