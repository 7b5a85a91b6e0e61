"""Vectors of three components as tuples, which compiled code keeps in registers instead of in memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kernels import njit

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
