"""Arrays of fixed shape on the stack of a compiled function.

An array of numpy's costs a malloc, a free and atomic reference counts; a control cycle has thirty of them. An
array on the stack must not leave the function that made it, and it begins with whatever lay there.
"""

# The arguments of an intrinsic are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic(prefer_literal=True)
def stack_floats(typingctx, count):
    """Pointer to `count` (a literal) float64 on the caller's stack; see `numba.carray`."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    size = count.literal_value

    def codegen(context, builder, signature, args):
        memory = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), size))
        return builder.bitcast(memory, ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(count), codegen
