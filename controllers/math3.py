"""Vectors, unit quaternions (w, x, y, z) as tuples, and small arrays on the stack, in compiled code.

Compiled code keeps tuples in registers instead of in memory. Quaternions have MuJoCo's order.
"""

from __future__ import annotations

import math

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from .jit import njit

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
ZERO = (0.0, 0.0, 0.0)


@njit(cache=True, forceinline=True)
def vector_at(field: Array, k: int, i: int) -> Vector:
    """Vector i of robot k in a field (n, m, 3)."""
    return field[k, i, 0], field[k, i, 1], field[k, i, 2]


@njit(cache=True, forceinline=True)
def vector_in(field: Array, k: int, first: int) -> Vector:
    """Three entries in a row of robot k in a field (n, m)."""
    return field[k, first], field[k, first + 1], field[k, first + 2]


@njit(cache=True, forceinline=True)
def vector_of(a: Array, first: int) -> Vector:
    """Three entries of an array (n,) in a row."""
    return a[first], a[first + 1], a[first + 2]


@njit(cache=True, forceinline=True)
def add(a: Vector, b: Vector) -> Vector:
    """A + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True, forceinline=True)
def subtract(a: Vector, b: Vector) -> Vector:
    """A - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True, forceinline=True)
def scaled(a: Vector, s: float) -> Vector:
    """A s."""
    return a[0] * s, a[1] * s, a[2] * s


@njit(cache=True, forceinline=True)
def dot(a: Vector, b: Vector) -> float:
    """A . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, forceinline=True)
def cross(a: Vector, b: Vector) -> Vector:
    """A x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, forceinline=True)
def to_world(xmat: Array, k: int, body: int, a: Vector) -> Vector:
    """R a, R (9 entries by rows) the axes of a body of robot k."""
    return (
        xmat[k, body, 0] * a[0] + xmat[k, body, 1] * a[1] + xmat[k, body, 2] * a[2],
        xmat[k, body, 3] * a[0] + xmat[k, body, 4] * a[1] + xmat[k, body, 5] * a[2],
        xmat[k, body, 6] * a[0] + xmat[k, body, 7] * a[1] + xmat[k, body, 8] * a[2],
    )


@njit(cache=True, forceinline=True)
def to_body(xmat: Array, k: int, body: int, a: Vector) -> Vector:
    """R' a, R (9 entries by rows) the axes of a body of robot k."""
    return (
        xmat[k, body, 0] * a[0] + xmat[k, body, 3] * a[1] + xmat[k, body, 6] * a[2],
        xmat[k, body, 1] * a[0] + xmat[k, body, 4] * a[1] + xmat[k, body, 7] * a[2],
        xmat[k, body, 2] * a[0] + xmat[k, body, 5] * a[1] + xmat[k, body, 8] * a[2],
    )


@njit(cache=True, forceinline=True)
def dual_basis(a: Vector, b: Vector, c: Vector) -> tuple[Vector, Vector, Vector]:
    """Rows of [a b c]^-1: x = a (A . x) + b (B . x) + c (C . x) for every x."""
    A, B, C = cross(b, c), cross(c, a), cross(a, b)
    scale = 1.0 / dot(a, A)
    return scaled(A, scale), scaled(B, scale), scaled(C, scale)


@njit(cache=True, forceinline=True)
def rows_times(rows: tuple[Vector, Vector, Vector], a: Vector) -> Vector:
    """Product of a matrix, by rows, with a."""
    return dot(rows[0], a), dot(rows[1], a), dot(rows[2], a)


Quaternion = tuple[float, float, float, float]
SMALL = 1e-8  # rotation below which sin(a / 2) / a is taken for 1 / 2 [rad]


@njit(cache=True, forceinline=True)
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Rotation b, then a, both in fixed axes."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@njit(cache=True, forceinline=True)
def of_rotation(r: Vector) -> Quaternion:
    """Quaternion of a rotation vector [rad]."""
    angle = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    share = 0.5 if angle < SMALL else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), share * r[0], share * r[1], share * r[2]


@njit(cache=True, forceinline=True)
def rotation_of(q: Quaternion) -> Vector:
    """Rotation vector of a unit quaternion with w >= 0 [rad]."""
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    share = 2.0 if sine < SMALL else 2.0 * math.atan2(sine, q[0]) / sine
    return share * q[1], share * q[2], share * q[3]


@njit(cache=True, forceinline=True)
def normalised(q: Quaternion) -> Quaternion:
    """The unit quaternion along q, which must not be zero."""
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


@njit(cache=True, forceinline=True)
def rotated(q: Quaternion, a: Vector) -> Vector:
    """R(q) a = a + 2 w (u x a) + 2 u x (u x a), u the vector part."""
    x = q[2] * a[2] - q[3] * a[1]
    y = q[3] * a[0] - q[1] * a[2]
    z = q[1] * a[1] - q[2] * a[0]
    return (
        a[0] + 2.0 * (q[0] * x + q[2] * z - q[3] * y),
        a[1] + 2.0 * (q[0] * y + q[3] * x - q[1] * z),
        a[2] + 2.0 * (q[0] * z + q[1] * y - q[2] * x),
    )


@njit(cache=True, forceinline=True)
def conjugate(q: Quaternion) -> Quaternion:
    """The rotation back."""
    return q[0], -q[1], -q[2], -q[3]


# The arguments of an intrinsic are those of its signature, less the typing context.
# pyright: reportCallIssue=false


@intrinsic(prefer_literal=True)
def stack_floats(typingctx, count):
    """Pointer to `count` (a literal) float64 on the caller's stack; see `numba.carray`.

    An array of numpy's costs a malloc, a free and atomic reference counts; a control cycle has thirty of
    them. An array on the stack must not leave the function that made it, and it begins with whatever lay
    there.
    """
    if not isinstance(count, types.IntegerLiteral):
        return None
    size = count.literal_value

    def codegen(context, builder, signature, args):
        memory = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), size))
        return builder.bitcast(memory, ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(count), codegen
