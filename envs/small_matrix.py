"""Solvers for matrices of a few rows, compiled and without calls to LAPACK, whose overhead would dominate."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def cholesky_solve(A: Array, B: Array) -> None:
    """Overwrite B (n, m) with A^-1 B for a positive definite A (n, n), which is overwritten by its factor."""
    n, m = B.shape
    for j in range(n):
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
        A[j, j] = math.sqrt(A[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] /= A[j, j]
    for i in range(n):
        for k in range(i):
            for c in range(m):
                B[i, c] -= A[i, k] * B[k, c]
        for c in range(m):
            B[i, c] /= A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            for c in range(m):
                B[i, c] -= A[k, i] * B[k, c]
        for c in range(m):
            B[i, c] /= A[i, i]


@njit(cache=True)
def gauss_solve(A: Array, B: Array) -> None:
    """Overwrite B (n, m) with A^-1 B by elimination with partial pivoting; A (n, n) is overwritten."""
    n, m = B.shape
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(A[i, j]) > abs(A[pivot, j]):
                pivot = i
        if pivot != j:
            for k in range(j, n):
                A[j, k], A[pivot, k] = A[pivot, k], A[j, k]
            for c in range(m):
                B[j, c], B[pivot, c] = B[pivot, c], B[j, c]
        for i in range(j + 1, n):
            factor = A[i, j] / A[j, j]
            if factor != 0.0:
                for k in range(j, n):
                    A[i, k] -= factor * A[j, k]
                for c in range(m):
                    B[i, c] -= factor * B[j, c]
    for i in range(n - 1, -1, -1):
        for c in range(m):
            for k in range(i + 1, n):
                B[i, c] -= A[i, k] * B[k, c]
            B[i, c] /= A[i, i]
