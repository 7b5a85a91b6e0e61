import numpy as np
from push_recovery.controllers.math3 import (
    add,
    cross,
    dot,
    dual_basis,
    rows_times,
    scaled,
    subtract,
    to_body,
    to_world,
    vector_at,
    vector_in,
    vector_of,
)

A, B, C = (tuple(row) for row in np.random.default_rng(0).normal(size=(3, 3)))


def test_sums_and_products_are_those_of_numpy():
    a, b = np.array(A), np.array(B)
    np.testing.assert_array_equal(add(A, B), a + b)
    np.testing.assert_array_equal(subtract(A, B), a - b)
    np.testing.assert_array_equal(scaled(A, 3.0), 3.0 * a)
    np.testing.assert_allclose(dot(A, B), a @ b, atol=1e-15)
    np.testing.assert_allclose(cross(A, B), np.cross(a, b), atol=1e-15)


def test_vectors_are_read_in_their_order():
    field = np.arange(24.0)
    assert vector_of(field, 4) == (4.0, 5.0, 6.0)
    assert vector_in(field.reshape(4, 6), 2, 1) == (13.0, 14.0, 15.0)
    assert vector_at(field.reshape(2, 4, 3), 1, 2) == (18.0, 19.0, 20.0)


def test_axes_turn_a_vector_and_back():
    R = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    field = np.zeros((2, 3, 9))
    field[1, 2] = R.ravel()
    np.testing.assert_allclose(to_world(field, 1, 2, A), R @ A, atol=1e-15)
    np.testing.assert_allclose(to_body(field, 1, 2, A), R.T @ A, atol=1e-15)


def test_the_dual_basis_is_the_inverse():
    rows = dual_basis(A, B, C)
    np.testing.assert_allclose(rows, np.linalg.inv(np.column_stack([A, B, C])), rtol=1e-12)
    np.testing.assert_allclose(rows_times(rows, B), [0.0, 1.0, 0.0], atol=1e-15)
