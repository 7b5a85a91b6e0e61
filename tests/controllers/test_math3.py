"""Quaternions against MuJoCo's.

Arrays on the stack of a compiled function.
"""

import mujoco
import numpy as np
import pytest
from numba import njit
from numba.np.numpy_support import carray
from push_recovery.controllers import math3

A, B, C = (tuple(row) for row in np.random.default_rng(0).normal(size=(3, 3)))


def test_sums_and_products_are_those_of_numpy():
    a, b = np.array(A), np.array(B)
    np.testing.assert_array_equal(math3.add(A, B), a + b)
    np.testing.assert_array_equal(math3.subtract(A, B), a - b)
    np.testing.assert_array_equal(math3.scaled(A, 3.0), 3.0 * a)
    np.testing.assert_allclose(math3.dot(A, B), a @ b, atol=1e-15)
    np.testing.assert_allclose(math3.cross(A, B), np.cross(a, b), atol=1e-15)


def test_vectors_are_read_in_their_order():
    field = np.arange(24.0)
    assert math3.vector_of(field, 4) == (4.0, 5.0, 6.0)
    assert math3.vector_in(field.reshape(4, 6), 2, 1) == (13.0, 14.0, 15.0)
    assert math3.vector_at(field.reshape(2, 4, 3), 1, 2) == (18.0, 19.0, 20.0)


def test_axes_turn_a_vector_and_back():
    R = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    field = np.zeros((2, 3, 9))
    field[1, 2] = R.ravel()
    np.testing.assert_allclose(math3.to_world(field, 1, 2, A), R @ A, atol=1e-15)
    np.testing.assert_allclose(math3.to_body(field, 1, 2, A), R.T @ A, atol=1e-15)


def test_the_dual_basis_is_the_inverse():
    rows = math3.dual_basis(A, B, C)
    np.testing.assert_allclose(rows, np.linalg.inv(np.column_stack([A, B, C])), rtol=1e-12)
    np.testing.assert_allclose(math3.rows_times(rows, B), [0.0, 1.0, 0.0], atol=1e-15)


RNG = np.random.default_rng(1)
A_QUATERNION, B_QUATERNION = (tuple(q / np.linalg.norm(q)) for q in RNG.normal(size=(2, 4)))
VECTOR = (0.3, -1.2, 0.7)


def test_a_product_is_the_second_rotation_and_then_the_first():
    want = np.zeros(4)
    mujoco.mju_mulQuat(want, np.array(A_QUATERNION), np.array(B_QUATERNION))
    np.testing.assert_allclose(math3.product(A_QUATERNION, B_QUATERNION), want, atol=1e-15)
    np.testing.assert_allclose(
        math3.rotated(math3.product(A_QUATERNION, B_QUATERNION), VECTOR),
        math3.rotated(A_QUATERNION, math3.rotated(B_QUATERNION, VECTOR)),
        atol=1e-15,
    )


def test_a_vector_is_turned_as_by_mujoco_and_back():
    want = np.zeros(3)
    mujoco.mju_rotVecQuat(want, np.array(VECTOR), np.array(A_QUATERNION))
    np.testing.assert_allclose(math3.rotated(A_QUATERNION, VECTOR), want, atol=1e-15)
    np.testing.assert_allclose(
        math3.rotated(math3.conjugate(A_QUATERNION), math3.rotated(A_QUATERNION, VECTOR)), VECTOR, atol=1e-15
    )


def test_a_quarter_turn_about_z_brings_x_to_y():
    q = math3.of_rotation((0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(q, [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-15)
    np.testing.assert_allclose(math3.rotated(q, (1.0, 0.0, 0.0)), [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-3, 2.0])
def test_rotations_of_any_size_are_unit_quaternions(angle):
    axis = np.array([0.6, 0.0, -0.8])
    q, want = math3.of_rotation(tuple(angle * axis)), np.zeros(4)
    mujoco.mju_axisAngle2Quat(want, axis, angle)
    np.testing.assert_allclose(q, want, rtol=1e-14, atol=1e-17)
    np.testing.assert_allclose(math3.rotation_of(q), angle * axis, rtol=1e-14, atol=1e-17)


def test_normalised_keeps_the_direction():
    np.testing.assert_allclose(
        math3.normalised(tuple(3.0 * np.array(A_QUATERNION))), A_QUATERNION, atol=1e-15
    )


@njit
def triangle(n: int) -> float:
    """The sum 1 + ... + n, each frame's summands in an array of its own that its callees must not touch."""
    own = carray(math3.stack_floats(4), (2, 2))
    own[0, 0], own[0, 1], own[1, 0], own[1, 1] = n, 0.0, 0.0, 0.0
    if n > 1:
        own[1, 1] = triangle(n - 1)
    return own.sum()


@njit
def outer(a, b, out):
    """Write a b' + b a' into out by way of two arrays at the same time."""
    first, second = carray(math3.stack_floats(9), (3, 3)), carray(math3.stack_floats(9), (3, 3))
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
