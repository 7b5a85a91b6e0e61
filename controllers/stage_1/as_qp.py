"""Stage 1 as a general quadratic program, solved by OSQP or DAQP: slow, a second opinion on `step_planner`.

With x = (u_x, u_y, tau, b_x, b_y) and the rows of A in this order: u_x + b_x - a_x tau = 0,
u_y + b_y - a_y tau = 0, bounds of u_x, u_y, tau. Weights are divided by the largest one.
"""

from __future__ import annotations

import numpy as np

from ..errors import PushRecoveryError
from ..solvers.general_qp import QuadraticProgram, SolverName, solve_qp
from .step_problem import StepPlan, StepProblem


def step_program(problem: StepProblem) -> QuadraticProgram:
    """The program of eq. 3 in x = (u_x, u_y, tau, b_x, b_y); the cost is divided by the largest weight."""
    weights = np.array([problem.alpha_step] * 2 + [problem.alpha_duration] + [problem.alpha_offset] * 2)
    nominal = np.array([*problem.step_nominal, problem.tau_nominal, *problem.offset_nominal])
    largest = weights.max()
    equality = np.array(
        [
            [1.0, 0.0, -problem.gain[0], 1.0, 0.0],
            [0.0, 1.0, -problem.gain[1], 0.0, 1.0],
        ]
    )  # columns: u_x, u_y, tau, b_x, b_y
    rows = np.vstack([equality, np.eye(3, 5)])
    return QuadraticProgram(
        H=np.diag(2.0 * weights / largest),
        f=-2.0 * weights / largest * nominal,
        A=rows,
        lower=np.array([0.0, 0.0, *problem.step_low, problem.tau_low]),
        upper=np.array([0.0, 0.0, *problem.step_high, problem.tau_high]),
        soft_weight=np.zeros(5),
    )


def solve_step_qp(problem: StepProblem, solver: SolverName = "osqp") -> StepPlan:
    """The same problem as `solve_step`, by a general solver.

    Raises:
        PushRecoveryError: if the solver gives up.
    """
    solution = solve_qp(step_program(problem), solver)
    if solution.status != "solved":
        raise PushRecoveryError(f"{solver} ended with {solution.status!r} on {problem}")
    x = [float(value) for value in solution.x]
    return StepPlan((x[0], x[1]), x[2], (x[3], x[4]))
