"""Arrays on the stack of a compiled function."""

import numpy as np
from numba import njit
from numba.np.numpy_support import carray
from push_recovery.controllers.math3 import stack_floats


@njit
def triangle(n: int) -> float:
    """The sum 1 + ... + n, each frame's summands in an array of its own that its callees must not touch."""
    own = carray(stack_floats(4), (2, 2))
    own[0, 0], own[0, 1], own[1, 0], own[1, 1] = n, 0.0, 0.0, 0.0
    if n > 1:
        own[1, 1] = triangle(n - 1)
    return own.sum()


@njit
def outer(a, b, out):
    """Write a b' + b a' into out by way of two arrays at the same time."""
    first, second = carray(stack_floats(9), (3, 3)), carray(stack_floats(9), (3, 3))
    for i in range(3):
        for j in range(3):
            first[i, j], second[i, j] = a[i] * b[j], b[i] * a[j]
    out[:] = first + second


@njit
def many(a, b, n, out):
    """The same in a long loop, which would run out of stack if every turn took some."""
    for _ in range(n):
        outer(a, b, out)


def test_every_call_has_arrays_of_its_own():
    assert triangle(50) == 1275.0


def test_two_arrays_do_not_overlap_and_a_loop_takes_no_more_stack():
    a, b, out = np.array([1.0, 2.0, 3.0]), np.array([-1.0, 0.5, 4.0]), np.empty((3, 3))
    many(a, b, 1_000_000, out)
    np.testing.assert_array_equal(out, np.outer(a, b) + np.outer(b, a))
