"""Hand many arrays to a compiled loop as one table of addresses.

Numba checks and unpacks every array of a call, about 0.15 us each; a control cycle that takes sixty of them
spends as much time there as on control. A table row is (address, shape, strides) of an array that Python
keeps alive; the compiled side rebuilds views of it.

Parts, NamedTuples of arrays, lie in a table one after the other. Where each begins, and of what type and
dimension its arrays are, follows from the annotations of their fields (`Floats2`: two-dimensional float64):
`part_of` gives a part to compiled code by its name. Rows are written by value: `parts_table` refuses a part
in which annotation and value disagree, since it would be read wrongly, and every later one from another's
memory. Constants, NamedTuples of floats, go as one array, which `tuple_reader` gives by name.

A kernel that many others call lies behind an address, too (`address_of`, `caller_of`): numba compiles what
a kernel calls once more with it.

An annotation may also say that an array, or a whole part, is not the state of single robots, as
`Annotated[Floats1, COMMON]`. Without that it is: an array that is added cannot be forgotten in a snapshot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache, partial
from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
from numba import types
from numba.core.cgutils import get_item_pointer, if_unlikely, unpack_tuple
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import carray, from_dtype
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from .jit import njit

# The arguments of an intrinsic are those of its signature, less the typing context.
# pyright: reportCallIssue=false

DIMENSIONS = 3


class Kind(NamedTuple):
    """Type of the entries and dimension of an array, by which compiled code reads it."""

    dtype: np.dtype
    ndim: int


_FLOAT, _INT = np.dtype(np.float64), np.dtype(np.int64)
Floats1 = Annotated[NDArray[np.float64], Kind(_FLOAT, 1)]
Floats2 = Annotated[NDArray[np.float64], Kind(_FLOAT, 2)]
Floats3 = Annotated[NDArray[np.float64], Kind(_FLOAT, 3)]
Ints1 = Annotated[NDArray[np.int64], Kind(_INT, 1)]
Ints2 = Annotated[NDArray[np.int64], Kind(_INT, 2)]
Ints3 = Annotated[NDArray[np.int64], Kind(_INT, 3)]

# What an array may be other than one row a robot of its state
COMMON = "common to all robots"
NO_STATE = "addresses, a workspace, or another's"
SENSED = "a row for each robot that acts on its own sensors"


def parts_table(parts: Iterable[Any]) -> NDArray[np.int64]:
    """(address, shape (3), strides (3)) of all arrays of parts, in their order, (count, 7).

    The arrays must stay alive as long as the table is in use. Fields that are no arrays are left out; one
    that holds another array than its annotation says raises TypeError.
    """
    rows = []
    for part in parts:
        annotated, values = array_fields(type(part)), part._asdict()
        held = {name: Kind(a.dtype, a.ndim) for name, a in values.items() if isinstance(a, np.ndarray)}
        wrong = [name for name in values if held.get(name) != annotated.get(name, (None,))[0]]
        if wrong:
            which = f"{type(part).__name__}: {', '.join(wrong)}"
            raise TypeError(f"a field's annotation and value are not the same kind of array, {which}")
        for name in annotated:
            array, pad = values[name], [0] * (DIMENSIONS - annotated[name][0].ndim)
            rows.append([array.ctypes.data, *array.shape, *pad, *array.strides, *pad])
    return np.array(rows, dtype=np.int64).reshape(-1, 1 + 2 * DIMENSIONS)


@cache
def array_fields(part: type) -> dict[str, tuple[Any, ...]]:
    """Kind of each field of a NamedTuple that is annotated as an array, and what else that says."""
    hints = get_type_hints(part, include_extras=True)
    notes = {name: getattr(hint, "__metadata__", (None,)) for name, hint in hints.items()}
    return {name: note for name, note in notes.items() if isinstance(note[0], Kind)}


def first_rows(parts: type) -> dict[str, int]:
    """Row of its `parts_table` at which each part of a NamedTuple of parts begins."""
    rows, row = {}, 0
    for name, part in get_type_hints(parts).items():
        rows[name] = row
        row += len(array_fields(part))
    return rows


def tuple_reader(kind: type) -> Callable[[Any], Any]:
    """A compiled function that gives an array (n,) as a NamedTuple `kind` of n numbers."""
    count = len(kind._fields)

    @njit(cache=True)
    def read(packed: Any) -> Any:
        return kind(*to_fixed_tuple(packed, count))

    return read


def _pointer_to(kind):
    """An intrinsic that takes an address for a pointer to numbers of a numba type."""

    @intrinsic
    def pointer(typingctx, address):
        def codegen(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.int64), codegen

    return pointer


_float_pointer, _int_pointer = _pointer_to(types.float64), _pointer_to(types.int64)


@njit(cache=True)
def floats_at(address, count):
    """View (count,) float64 of what lies at an address."""
    return carray(_float_pointer(address), (count,))


@njit(cache=True)
def ints_at(address, count):
    """View (count,) int64 of what lies at an address."""
    return carray(_int_pointer(address), (count,))


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


@intrinsic
def only_part_of(typingctx, table, part):
    """The part of a class, of a table that begins with it, in compiled code."""
    whole, codegen = _reader(table, part.instance_class, 0, "A")
    return whole(table, part), codegen


def address_of(kernel: Any, signature: Any) -> int:
    """Address of a kernel's code for the types of a signature, compiled if need be.

    It holds in this process, as long as the kernel lives. Another return type raises TypeError.
    """
    kernel.compile(signature.args)
    found = kernel.overloads[signature.args]
    if found.signature.return_type != signature.return_type:
        raise TypeError(
            f"{kernel.__name__} returns {found.signature.return_type}, not {signature.return_type}"
        )
    return found.library.get_pointer_to_function(found.fndesc.llvm_func_name)


def caller_of(signature: Any) -> Callable[..., Any]:
    """A call in compiled code, as (address, *arguments), of a kernel that has an `address_of` a signature."""

    @intrinsic
    def call(typingctx, address, *arguments):
        def codegen(context, builder, _, args):
            result, kinds, convention = signature.return_type, signature.args, context.call_conv
            values = zip(unpack_tuple(builder, args[1]), arguments, kinds, strict=True)
            given = [context.cast(builder, value, own, kind) for value, own, kind in values]
            pointer = convention.get_function_type(result, kinds).as_pointer()
            function = builder.inttoptr(args[0], pointer)
            status, found = convention.call_function(builder, function, result, kinds, given)
            with if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return found

        return signature.return_type(types.int64, types.StarArgTuple.from_types(arguments)), codegen

    return call


def _part_of(table: Any, parts: Any, name: Any, layout: str) -> Any:
    if not isinstance(name, types.StringLiteral):
        return None
    part, row = (of(parts.instance_class)[name.literal_value] for of in (get_type_hints, first_rows))
    whole, codegen = _reader(table, part, row, layout)
    return whole(table, parts, name), codegen


def _reader(table: Any, part: Any, row: int, layout: str) -> Any:
    """Type of a part whose arrays begin at a row, and code that rebuilds them."""
    kinds = [note[0] for note in array_fields(part).values()]
    views = [types.Array(from_dtype(kind.dtype), kind.ndim, layout) for kind in kinds]
    whole = types.NamedTuple(views, part) if len(views) == len(part._fields) else types.Tuple(views)

    def codegen(context, builder, signature, args):
        arrays = [
            _view(context, builder, signature.args[0], args[0], row + i, view) for i, view in enumerate(views)
        ]
        return context.make_tuple(builder, signature.return_type, arrays)

    return whole, codegen


def _view(context: Any, builder: Any, kind: Any, table: Any, row: int, view: Any) -> Any:
    """The array of a type `view` that a row of a table of a type `kind` describes."""
    rows, place = context.make_array(kind)(context, builder, table), partial(context.get_constant, types.intp)

    def entry(column: int) -> Any:
        return builder.load(get_item_pointer(context, builder, kind, rows, [place(row), place(column)]))

    array = context.make_array(view)(context, builder)
    data = builder.inttoptr(entry(0), context.get_data_type(view.dtype).as_pointer())
    shape = [entry(1 + axis) for axis in range(view.ndim)]
    strides = [entry(1 + DIMENSIONS + axis) for axis in range(view.ndim)]
    populate_array(array, data, shape, strides, itemsize=place(8), meminfo=None)
    return array._getvalue()
