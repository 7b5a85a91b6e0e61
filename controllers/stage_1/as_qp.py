"""Stage 1 as a general quadratic program: what `solvers.general_qp` solves as a second opinion, slowly.

With x = (u_x, u_y, tau, b_x, b_y) and the rows of A in this order: u_x + b_x - a_x tau = 0,
u_y + b_y - a_y tau = 0, bounds of u_x, u_y, tau. Weights are divided by the largest one.
"""

from __future__ import annotations

import numpy as np

from ..solvers.general_qp import QuadraticProgram
from .step_problem import StepProblem


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
