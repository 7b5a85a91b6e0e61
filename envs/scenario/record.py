"""Records: frozen dataclasses that are read from JSON and written, and kinds of them that anyone may add.

Their numbers may be `Quantities`, whose units, bounds and similarity are said once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from typing import Any, ClassVar, Generic, NamedTuple, Self, TypeVar

from ...controllers.errors import InvalidValueError, shown
from ...controllers.model.robot import Similarity
from ...controllers.validation import parse_json, require_choice, require_keys, require_number


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


class Quantity(NamedTuple):
    """Unit and bounds of a number, and which ratio of `Similarity` it goes with; none: it is any robot's."""

    unit: str
    low: float
    high: float
    ratio: str = ""


Quantities = Mapping[str, Quantity]


def checked(owner: str, record: Any, quantities: Quantities) -> dict[str, float | None]:
    """The numbers of a record by field, each within its bounds; None stays where it is a field's default.

    Raises:
        InvalidValueError: no number, or one out of its bounds.
    """
    found: dict[str, float | None] = {}
    for name, (unit, low, high, _) in quantities.items():
        value = getattr(record, name)
        if value is not None or getattr(type(record), name, 0.0) is not None:
            label = f"{owner}.{name}{f' [{unit}]' if unit else ''}"
            value = require_number(label, value, low, high) + 0.0  # no -0.0
        found[name] = value
    return found


def resized(record: Any, quantities: Quantities, scale: Similarity) -> dict[str, float]:
    """The numbers of a record by field for a robot of another size, of those that hang on it."""
    sized = {name: quantity.ratio for name, quantity in quantities.items() if quantity.ratio}
    values = ((name, getattr(record, name), ratio) for name, ratio in sized.items())
    return {name: value * getattr(scale, ratio) for name, value, ratio in values if value is not None}


K = TypeVar("K", bound=JsonRecord)
_Class = TypeVar("_Class", bound=type[JsonRecord])


@dataclass(frozen=True)
class Kinds(Generic[K]):
    """Kinds of something, each a class of records, known by its `json_name` once it is registered."""

    what: str  # they are kinds of, for errors
    base: type  # that they derive from
    by_name: dict[str, type[K]] = field(default_factory=dict)

    def register(self, kind: _Class) -> _Class:
        """Let scenarios have a kind; a decorator of its class.

        Raises:
            InvalidValueError: another kind has that name, or the class is none that scenarios can have.
        """
        name, frozen = getattr(kind, "json_name", None), getattr(kind, "__dataclass_params__", None)
        missing = ", ".join(sorted(getattr(kind, "__abstractmethods__", ())))
        has_name = isinstance(name, str) and name.isprintable() and bool(name.strip())
        demands = {
            f"be a subclass of {self.base.__name__}": isinstance(kind, type) and issubclass(kind, self.base),
            "be a frozen dataclass, made one before it is registered": frozen is not None and frozen.frozen,
            f"define {missing}": not missing,
            "have a json_name of printable characters": has_name,
            "have no field 'kind'": "kind" not in getattr(kind, "__dataclass_fields__", ()),
        }
        if wrong := [words for words, met in demands.items() if not met]:
            raise InvalidValueError(f"a class of a {self.what} must {wrong[0]}, got {shown(kind)}")
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
