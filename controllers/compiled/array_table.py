"""Hand many arrays to a compiled loop as one table of addresses.

Numba checks and unpacks every array of a call, about 0.15 us each; a control cycle that takes sixty of them
spends as much time there as on control. A table row is (address, shape, strides) of an array that Python
keeps alive; the compiled side rebuilds views of it.

Parts, NamedTuples of arrays, lie in a table one after the other. Where each begins follows from how many
arrays the parts before it have (`first_rows`); a number written by hand would be wrong, and another array
read, as soon as a part gets one more. Rows are counted by annotation and written by value: `parts_table`
refuses a part in which the two disagree, since every later part would be read from another's memory.
"""

# The arguments of an intrinsic are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterable
from functools import cache
from typing import Any, get_origin, get_type_hints

import numpy as np
from numba import types
from numba.extending import intrinsic
from numba.np.numpy_support import carray
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from .kernels import njit

DIMENSIONS = 3


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
        parts: NamedTuples whose arrays are annotated as such.

    Raises:
        TypeError: if a field holds an array and is not annotated as one, or the other way round.
    """
    arrays = []
    for part in parts:
        annotated, held = array_fields(type(part)), tuple(isinstance(value, np.ndarray) for value in part)
        if annotated != held:
            wrong = [name for name, a, b in zip(part._fields, annotated, held, strict=True) if a != b]
            which = f"{type(part).__name__}: {', '.join(wrong)}"
            raise TypeError(f"annotation and value disagree on whether a field is an array, {which}")
        arrays += [value for value, is_array in zip(part, held, strict=True) if is_array]
    return address_table(arrays)


def first_rows(parts: type) -> Any:
    """Row of its `parts_table` at which each part of a NamedTuple of parts begins, under the part's name.

    Counted are the fields of a part that are annotated as arrays. The result is a constant to compiled code.
    """
    hints, rows, row = get_type_hints(parts), [], 0
    for part in hints.values():
        rows.append(row)
        row += sum(array_fields(part))
    return namedtuple("FirstRows", hints)(*rows)


@cache
def array_fields(part: type) -> tuple[bool, ...]:
    """Whether each field of a NamedTuple is annotated as an array."""
    return tuple(is_array_type(kind) for kind in get_type_hints(part).values())


def is_array_type(kind: Any) -> bool:
    """Whether an annotation means an array: np.ndarray, subscripted or not, or any alias of it.

    NDArray is a subscripted np.ndarray up to numpy 2.4 and a TypeAliasType from 2.5.
    """
    origin = get_origin(kind) or kind
    return is_array_type(origin.__value__) if hasattr(origin, "__value__") else origin is np.ndarray


@intrinsic
def _float_pointer(typingctx, address):
    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(types.int64), codegen


@intrinsic
def _int_pointer(typingctx, address):
    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.int64)(types.int64), codegen


@njit(cache=True)
def floats_at(address, count):
    """View (count,) float64 of what lies at an address."""
    return carray(_float_pointer(address), (count,))


@njit(cache=True)
def floats_1(row):
    """View (n,) float64 of a table row."""
    return as_strided(carray(_float_pointer(row[0]), (1,)), (row[1],), (row[4],))


@njit(cache=True)
def floats_2(row):
    """View (n, m) float64 of a table row."""
    return as_strided(carray(_float_pointer(row[0]), (1,)), (row[1], row[2]), (row[4], row[5]))


@njit(cache=True)
def floats_3(row):
    """View (n, m, l) float64 of a table row."""
    return as_strided(
        carray(_float_pointer(row[0]), (1,)), (row[1], row[2], row[3]), (row[4], row[5], row[6])
    )


@njit(cache=True)
def ints_1(row):
    """View (n,) int64 of a table row."""
    return as_strided(carray(_int_pointer(row[0]), (1,)), (row[1],), (row[4],))


@njit(cache=True)
def ints_2(row):
    """View (n, m) int64 of a table row."""
    return as_strided(carray(_int_pointer(row[0]), (1,)), (row[1], row[2]), (row[4], row[5]))


@njit(cache=True)
def dense_floats_1(row):
    """View (n,) float64 of a table row whose array is C-contiguous: half the cost of a strided view."""
    return carray(_float_pointer(row[0]), (row[1],))


@njit(cache=True)
def dense_floats_2(row):
    """View (n, m) float64 of a table row whose array is C-contiguous."""
    return carray(_float_pointer(row[0]), (row[1], row[2]))


@njit(cache=True)
def dense_floats_3(row):
    """View (n, m, l) float64 of a table row whose array is C-contiguous."""
    return carray(_float_pointer(row[0]), (row[1], row[2], row[3]))


@njit(cache=True)
def dense_ints_1(row):
    """View (n,) int64 of a table row whose array is C-contiguous."""
    return carray(_int_pointer(row[0]), (row[1],))


@njit(cache=True)
def dense_ints_2(row):
    """View (n, m) int64 of a table row whose array is C-contiguous."""
    return carray(_int_pointer(row[0]), (row[1], row[2]))
