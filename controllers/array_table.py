"""Hand many arrays to a compiled loop as one table of addresses.

Numba checks and unpacks every array of a call, about 0.15 us each; a control cycle that takes sixty of them
spends as much time there as on control. A table row is (address, shape, strides) of an array that Python
keeps alive; the compiled side rebuilds views of it.

Parts, NamedTuples of arrays, lie in a table one after the other. Where each begins, and of what type and
dimension its arrays are, follows from the annotations of their fields (`Floats2`: two-dimensional float64):
`part_of` gives a part to compiled code by its name. Rows are written by value: `parts_table` refuses a part
in which annotation and value disagree, since it would be read wrongly, and every later one from another's
memory.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterable
from functools import cache, partial
from typing import Annotated, Any, get_type_hints

import numpy as np
from numba import types
from numba.core.cgutils import get_item_pointer
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import carray, from_dtype
from numpy.typing import NDArray

from .jit import njit

# The arguments of an intrinsic are those of its signature, less the typing context.
# pyright: reportCallIssue=false


DIMENSIONS = 3
ITEM = 8  # bytes of an entry

Floats1 = Annotated[NDArray[np.float64], 1]  # the dimension is for the compiled side
Floats2 = Annotated[NDArray[np.float64], 2]
Floats3 = Annotated[NDArray[np.float64], 3]
Ints1 = Annotated[NDArray[np.int64], 1]
Ints2 = Annotated[NDArray[np.int64], 2]
Kind = tuple[np.dtype, int]  # type of the entries, dimension
_FLOAT, _INT = np.dtype(np.float64), np.dtype(np.int64)
_KINDS: dict[Any, Kind] = {
    Floats1: (_FLOAT, 1), Floats2: (_FLOAT, 2), Floats3: (_FLOAT, 3), Ints1: (_INT, 1), Ints2: (_INT, 2)
}  # fmt: skip


def address_table(arrays: Iterable[NDArray]) -> NDArray[np.int64]:
    """(address, shape (3), strides (3)) of each array of at most three dimensions, (count, 7).

    The arrays must stay alive as long as the table is in use.
    """
    rows = []
    for array in arrays:
        pad = [0] * (DIMENSIONS - array.ndim)
        rows.append([array.ctypes.data, *array.shape, *pad, *array.strides, *pad])
    return np.array(rows, dtype=np.int64)


def parts_table(parts: Iterable[Any]) -> NDArray[np.int64]:
    """Address table of all arrays of parts, in their order; settings and the like are left out.

    Args:
        parts: NamedTuples whose arrays are annotated as `Floats1` and its like.

    Raises:
        TypeError: if a field holds another array than its annotation says, or only one of them is an array.
    """
    arrays = []
    for part in parts:
        annotated, held = field_kinds(type(part)), tuple(_kind(value) for value in part)
        if annotated != held:
            wrong = [name for name, a, b in zip(part._fields, annotated, held, strict=True) if a != b]
            which = f"{type(part).__name__}: {', '.join(wrong)}"
            raise TypeError(f"a field's annotation and value are not the same kind of array, {which}")
        arrays += [value for value, kind in zip(part, held, strict=True) if kind is not None]
    return address_table(arrays)


def _kind(value: Any) -> Kind | None:
    """Type and dimension of an array, None for anything else."""
    return (value.dtype, value.ndim) if isinstance(value, np.ndarray) else None


def first_rows(parts: type) -> Any:
    """Row of its `parts_table` at which each part of a NamedTuple of parts begins, under the part's name.

    Counted are the fields of a part that are annotated as arrays. The result is a constant to compiled code.
    """
    hints, rows, row = get_type_hints(parts), [], 0
    for part in hints.values():
        rows.append(row)
        row += len(array_kinds(part))
    return namedtuple("FirstRows", hints)(*rows)


@cache
def field_kinds(part: type) -> tuple[Kind | None, ...]:
    """Type and dimension of each field of a NamedTuple that is annotated as an array, None for another."""
    return tuple(_KINDS.get(kind) for kind in get_type_hints(part, include_extras=True).values())


def array_kinds(part: type) -> list[Kind]:
    """Type and dimension of the arrays of a NamedTuple."""
    return [kind for kind in field_kinds(part) if kind is not None]


@intrinsic
def _float_pointer(typingctx, address):
    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(types.int64), codegen


@njit(cache=True)
def floats_at(address, count):
    """View (count,) float64 of what lies at an address."""
    return carray(_float_pointer(address), (count,))


@intrinsic(prefer_literal=True)
def part_of(typingctx, table, parts, name):
    """One part of a `parts_table` in compiled code; the tuple of its arrays where it has other fields, too.

    `parts` is the class of the NamedTuple of parts that the table was made of, `name` a literal. What is not
    read of the part costs nothing.
    """
    return _part_of(table, parts, name, "A")


@intrinsic(prefer_literal=True)
def dense_part_of(typingctx, table, parts, name):
    """`part_of` where all arrays are C-contiguous: half the cost of strided views."""
    return _part_of(table, parts, name, "C")


def _part_of(table: Any, parts: Any, name: Any, layout: str) -> Any:
    """Signature and code of an intrinsic that rebuilds the arrays of a part."""
    if not isinstance(name, types.StringLiteral):
        return None
    part, row = get_type_hints(parts.instance_class)[name.literal_value], first_rows(parts.instance_class)
    row = getattr(row, name.literal_value)
    views = [types.Array(from_dtype(entry), ndim, layout) for entry, ndim in array_kinds(part)]
    whole = types.NamedTuple(views, part) if len(views) == len(part._fields) else types.Tuple(views)

    def codegen(context, builder, signature, args):
        arrays = [
            _view(context, builder, signature.args[0], args[0], row + i, view) for i, view in enumerate(views)
        ]
        return context.make_tuple(builder, signature.return_type, arrays)

    return whole(table, parts, name), codegen


def _view(context: Any, builder: Any, kind: Any, table: Any, row: int, view: Any) -> Any:
    """The array of a type `view` that a row of a table of a type `kind` tells of."""
    rows, place = context.make_array(kind)(context, builder, table), partial(context.get_constant, types.intp)

    def entry(column: int) -> Any:
        return builder.load(get_item_pointer(context, builder, kind, rows, [place(row), place(column)]))

    array = context.make_array(view)(context, builder)
    data = builder.inttoptr(entry(0), context.get_data_type(view.dtype).as_pointer())
    shape = [entry(1 + axis) for axis in range(view.ndim)]
    strides = [entry(1 + DIMENSIONS + axis) for axis in range(view.ndim)]
    populate_array(array, data, shape, strides, itemsize=place(ITEM), meminfo=None)
    return array._getvalue()
