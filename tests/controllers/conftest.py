"""The optimality conditions of a quadratic program, which solvers and planners are held to."""

import numpy as np
import pytest


def residual(problem, solution) -> tuple[float, float, float]:
    """Largest violations of stationarity, feasibility and complementarity of a solution; 0 at the optimum."""
    x, dual, weight = solution.x, solution.dual, problem.soft_weight
    slack = np.where(weight > 0, -dual / np.where(weight > 0, weight, 1.0), 0.0)
    rows = problem.A @ x + slack
    above, below = problem.upper - rows, rows - problem.lower
    gap = np.where(dual > 0, np.abs(dual) * np.abs(above), np.abs(dual) * np.abs(below))
    return (
        float(np.max(np.abs(problem.H @ x + problem.f + problem.A.T @ dual))),
        float(np.max(np.maximum(np.maximum(-above, -below), 0.0), initial=0.0)),
        float(np.max(np.where(dual == 0, 0.0, gap), initial=0.0)),
    )


@pytest.fixture(scope="session")
def kkt_residual():
    return residual
