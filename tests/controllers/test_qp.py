import numpy as np
import pytest
from push_recovery.controllers.errors import UnknownNameError
from push_recovery.controllers.qp import LeastDistance, QuadraticProgram, solve_least_distance, solve_qp


def random_program(seed: int, n: int = 12, rows: int = 20, soft: int = 6) -> QuadraticProgram:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    A = rng.normal(size=(rows, n))
    inside = A @ rng.normal(size=n)  # the hard rows have a common point; the soft ones need none
    lower, upper = inside - rng.uniform(0, 1, rows), inside + rng.uniform(0, 1, rows)
    weight = np.zeros(rows)
    weight[rows - soft :] = rng.uniform(1, 100, soft)
    lower[rows - soft :] += 5.0
    upper[rows - soft :] += 5.0
    return QuadraticProgram(root @ root.T + np.eye(n), 10 * rng.normal(size=n), A, lower, upper, weight)


@pytest.mark.parametrize("seed", range(10))
def test_solution_is_optimal_and_solvers_agree(seed, kkt_residual):
    problem = random_program(seed)
    exact, first_order = solve_qp(problem, "daqp"), solve_qp(problem, "osqp")
    assert exact.status == first_order.status == "solved"
    assert np.all(np.array(kkt_residual(problem, exact)) < [1e-7, 1e-8, 1e-7])
    np.testing.assert_allclose(first_order.x, exact.x, atol=1e-5)


def test_residual_sees_a_wrong_solution(kkt_residual):
    problem = random_program(0)
    exact = solve_qp(problem)
    moved = type(exact)(exact.x + 1e-3, exact.dual, exact.status, exact.iterations)
    assert kkt_residual(problem, moved)[0] > 1e-4


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_without_active_rows_the_optimum_is_the_linear_solve(solver):
    problem = random_program(3)
    wide = QuadraticProgram(
        problem.H, problem.f, problem.A, np.full(20, -1e3), np.full(20, 1e3), problem.soft_weight
    )
    np.testing.assert_allclose(solve_qp(wide, solver).x, -np.linalg.solve(problem.H, problem.f), atol=1e-7)


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_contradicting_hard_rows_are_infeasible(solver):
    row = np.array([[1.0, 0.0], [1.0, 0.0]])
    problem = QuadraticProgram(
        np.eye(2), np.zeros(2), row, np.array([1.0, -2.0]), np.array([2.0, -1.0]), np.zeros(2)
    )
    solution = solve_qp(problem, solver)
    assert solution.status == "infeasible"
    assert np.all(np.isnan(solution.x))


def test_unknown_solver_names_the_valid_ones():
    with pytest.raises(UnknownNameError, match="daqp, osqp"):
        solve_qp(random_program(0), "quadprog")  # type: ignore[arg-type]


def test_least_distance_agrees_with_the_public_interface_and_reads_its_arrays_anew():
    rng = np.random.default_rng(5)
    weight = np.concatenate([np.zeros(12), rng.uniform(1, 100, 8)])
    problem = LeastDistance(np.zeros((20, 12)), weight)
    for _ in range(10):
        problem.M[:] = rng.normal(size=(20, 12)) * rng.uniform(0.01, 10, (20, 1))
        centre = problem.M @ rng.normal(size=12)
        problem.lower[:], problem.upper[:] = centre - 0.3, centre + 0.3
        assert solve_least_distance(problem.handle) > 0
        dense = QuadraticProgram(np.eye(12), np.zeros(12), problem.M, problem.lower, problem.upper, weight)
        np.testing.assert_allclose(problem.x, solve_qp(dense).x, atol=1e-7)


def test_least_distance_reports_infeasible_rows():
    problem = LeastDistance(np.array([[1.0, 0.0], [2.0, 0.0]]), np.zeros(2))
    problem.lower[:], problem.upper[:] = [1.0, -9.0], [2.0, 1.0]
    assert solve_least_distance(problem.handle) < 0
    problem.upper[1] = 3.0  # and recovers
    assert solve_least_distance(problem.handle) > 0
    np.testing.assert_allclose(problem.x, [1.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_multipliers_are_of_the_rows_as_given(solver, side):
    """min x^2/2 - 3 x, |2 x| <= 1: x = 1/2 and x - 3 + 2 dual = 0."""
    one, row = np.ones(1), np.array([[2.0]])
    found = solve_qp(QuadraticProgram(np.eye(1), -3.0 * side * one, row, -one, one, 0.0 * one), solver)
    assert (found.x[0], found.dual[0]) == pytest.approx((0.5 * side, 1.25 * side), abs=1e-6)
