import numpy as np
import pytest
from push_recovery.envs.small_matrix import cholesky_solve, gauss_solve


@pytest.mark.parametrize("n", [1, 2, 6, 14])
@pytest.mark.parametrize("m", [1, 7])
def test_cholesky_solves_positive_definite_systems(n, m):
    rng = np.random.default_rng(n * 10 + m)
    for _ in range(20):
        G = rng.normal(size=(n, n))
        A, X = G @ G.T + 0.1 * np.eye(n), rng.normal(size=(n, m))
        factor, out = A.copy(), A @ X
        cholesky_solve(factor, out)
        np.testing.assert_allclose(out, X, rtol=1e-8, atol=1e-9)
        L = np.tril(factor)
        np.testing.assert_allclose(L @ L.T, A, atol=1e-11 * np.abs(A).max())


def test_cholesky_reads_the_lower_triangle_alone():
    rng = np.random.default_rng(0)
    G = rng.normal(size=(6, 6))
    A, B = G @ G.T + np.eye(6), rng.normal(size=(6, 2))
    full, lower, out = A.copy(), np.tril(A), B.copy()
    cholesky_solve(full, B)
    cholesky_solve(lower, out)
    np.testing.assert_array_equal(out, B)


@pytest.mark.parametrize("n", [1, 2, 6, 14])
@pytest.mark.parametrize("m", [1, 14])
def test_gauss_solves_any_regular_system(n, m):
    rng = np.random.default_rng(n * 100 + m)
    for _ in range(20):
        A, X = rng.normal(size=(n, n)), rng.normal(size=(n, m))
        out = A @ X
        gauss_solve(A.copy(), out)
        np.testing.assert_allclose(out, X, atol=1e-11 * np.linalg.cond(A) * np.abs(X).max())


def test_gauss_pivots_where_the_diagonal_is_zero_or_tiny():
    B = np.array([[2.0], [3.0], [5.0]])
    A = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    gauss_solve(A, B)
    np.testing.assert_array_equal(B[:, 0], [3.0, 5.0, 2.0])
    # without pivoting the solution of this one loses every digit
    small, right = np.array([[1e-20, 1.0], [1.0, 1.0]]), np.array([[1.0], [2.0]])
    gauss_solve(small, right)
    np.testing.assert_allclose(right[:, 0], [1.0, 1.0], rtol=1e-15)
