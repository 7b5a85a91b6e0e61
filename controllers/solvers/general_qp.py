"""One small interface over the quadratic-program solvers DAQP and OSQP.

    min 0.5 x'Hx + f'x + 0.5 sum_i w_i s_i^2   s.t.  lower_i <= (A x)_i + s_i <= upper_i

with s_i = 0 on hard rows (w_i = 0) and free on soft rows (w_i > 0). Every solve starts cold, so that the
answer depends on the problem alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import daqp
import numpy as np
import osqp
from numpy.typing import NDArray
from scipy import linalg, sparse

from ..errors import UnknownNameError

SOLVERS = ("daqp", "osqp")
SolverName = Literal["daqp", "osqp"]


@dataclass(frozen=True)
class QuadraticProgram:
    """A strictly convex quadratic program with two-sided, partly soft rows."""

    H: NDArray[np.float64]  # (n, n), symmetric positive definite
    f: NDArray[np.float64]  # (n,)
    A: NDArray[np.float64]  # (m, n)
    lower: NDArray[np.float64]  # (m,)
    upper: NDArray[np.float64]  # (m,)
    soft_weight: NDArray[np.float64]  # (m,), w_i; zero marks a hard row


@dataclass(frozen=True)
class QpSolution:
    """A primal-dual pair: H x + f + A'dual = 0, dual_i > 0 at the upper bound, < 0 at the lower."""

    x: NDArray[np.float64]  # (n,)
    dual: NDArray[np.float64]  # (m,)
    status: Literal["solved", "infeasible", "failed"]
    iterations: int


@dataclass(frozen=True)
class KktResidual:
    """Largest violation of each optimality condition, in the units of the problem."""

    stationarity: float
    feasibility: float  # of the hard rows, and of the soft rows after their slack -dual/w
    complementarity: float


def solve_qp(problem: QuadraticProgram, solver: SolverName = "daqp") -> QpSolution:
    """Solve one problem from a cold start.

    Args:
        problem: the problem; its arrays are not changed.
        solver: "daqp" (dual active set, exact) or "osqp" (first order, tight tolerances).

    Returns:
        The solution; `x` is NaN unless the status is "solved".

    Raises:
        UnknownNameError: the solver's name is not one of `SOLVERS`.
    """
    if solver == "daqp":
        return _solve_daqp(problem)
    if solver == "osqp":
        return _solve_osqp(problem)
    raise UnknownNameError("QP solver", solver, SOLVERS)


def kkt_residual(problem: QuadraticProgram, solution: QpSolution) -> KktResidual:
    """Optimality residuals of a solution (all zero at the optimum)."""
    x, dual, weight = solution.x, solution.dual, problem.soft_weight
    slack = np.where(weight > 0, -dual / np.where(weight > 0, weight, 1.0), 0.0)
    rows = problem.A @ x + slack
    above, below = problem.upper - rows, rows - problem.lower
    gap = np.where(dual > 0, np.abs(dual) * np.abs(above), np.abs(dual) * np.abs(below))
    return KktResidual(
        stationarity=float(np.max(np.abs(problem.H @ x + problem.f + problem.A.T @ dual))),
        feasibility=float(np.max(np.maximum(np.maximum(-above, -below), 0.0), initial=0.0)),
        complementarity=float(np.max(np.where(dual == 0, 0.0, gap), initial=0.0)),
    )


def _with_slacks(
    problem: QuadraticProgram,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """H, f and A of the same problem with the slacks as further variables."""
    soft = np.flatnonzero(problem.soft_weight > 0)
    n, m, k = problem.f.size, problem.lower.size, soft.size
    H = np.zeros((n + k, n + k))
    H[:n, :n] = problem.H
    H[range(n, n + k), range(n, n + k)] = problem.soft_weight[soft]
    A = np.zeros((m, n + k))
    A[:, :n] = problem.A
    A[soft, range(n, n + k)] = 1.0
    return H, np.concatenate([problem.f, np.zeros(k)]), A


def _solve_daqp(problem: QuadraticProgram) -> QpSolution:
    H, f, A = _with_slacks(problem)
    upper, lower = np.ascontiguousarray(problem.upper), np.ascontiguousarray(problem.lower)
    sense = np.zeros(upper.size, dtype=np.int32)
    x, _, flag, info = daqp.solve(H, f, A, upper, lower, sense, primal_tol=1e-10)
    if flag > 0:
        n = problem.f.size
        return QpSolution(np.array(x[:n]), np.array(info["lam"]), "solved", int(info["iterations"]))
    return _no_solution(problem, "infeasible" if flag == -1 else "failed", int(info["iterations"]))


def _solve_osqp(problem: QuadraticProgram) -> QpSolution:
    """OSQP on y = L'x with H = LL' and rows of unit length: conditioning decides how fast it converges."""
    H, f, A = _with_slacks(problem)
    L = np.linalg.cholesky(H)
    whitened = linalg.solve_triangular(L, np.column_stack([f, A.T]), lower=True)
    rows = whitened[:, 1:].T
    norm = np.linalg.norm(rows, axis=1)
    norm[norm == 0] = 1.0
    solver = osqp.OSQP()
    solver.setup(
        P=sparse.identity(f.size, format="csc"), q=whitened[:, 0], A=sparse.csc_matrix(rows / norm[:, None]),
        l=problem.lower / norm, u=problem.upper / norm, verbose=False, eps_abs=1e-9, eps_rel=1e-9,
        max_iter=20_000, scaling=0, alpha=1.8, adaptive_rho_interval=25, check_termination=25,
        polishing=False,
    )  # fmt: skip
    result = solver.solve(raise_error=False)
    if result.info.status == "solved":
        x = linalg.solve_triangular(L, result.x, lower=True, trans=1)[: problem.f.size]
        return QpSolution(x, np.array(result.y) / norm, "solved", int(result.info.iter))
    status = "infeasible" if "infeasible" in result.info.status else "failed"
    return _no_solution(problem, status, int(result.info.iter))


def _no_solution(
    problem: QuadraticProgram, status: Literal["infeasible", "failed"], iterations: int
) -> QpSolution:
    return QpSolution(
        np.full(problem.f.size, np.nan), np.full(problem.lower.size, np.nan), status, iterations
    )
