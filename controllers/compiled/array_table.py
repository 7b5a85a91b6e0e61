"""Hand many arrays to a compiled loop as one table of addresses.

Numba checks and unpacks every array of a call, about 0.15 us each; a control cycle that takes sixty of them
spends as much time there as on control. A table row is (address, shape, strides) of an array that Python
keeps alive; the compiled side rebuilds views of it.

Parts, NamedTuples of arrays, lie in a table one after the other. Where each begins follows from how many
arrays the parts before it have (`first_rows`); a number written by hand would be wrong, and another array
read, as soon as a part gets one more.
"""

# The arguments of an intrinsic are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterable
from typing import Any, get_origin, get_type_hints

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numba.np.numpy_support import carray
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

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


def parts_table(parts: Iterable[Iterable[Any]]) -> NDArray[np.int64]:
    """Address table of all arrays of parts, in their order; settings and the like are left out."""
    return address_table(value for part in parts for value in part if isinstance(value, np.ndarray))


def first_rows(parts: type) -> Any:
    """Row of its `parts_table` at which each part of a NamedTuple of parts begins, under the part's name.

    Counted are the fields of a part that are annotated as arrays. The result is a constant to compiled code.
    """
    hints, rows, row = get_type_hints(parts), [], 0
    for part in hints.values():
        rows.append(row)
        row += sum(get_origin(kind) is np.ndarray for kind in get_type_hints(part).values())
    return namedtuple("FirstRows", hints)(*rows)


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
