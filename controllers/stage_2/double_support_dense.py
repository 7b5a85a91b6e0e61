"""Stage 2 in double support written out densely, both axes in one program: OSQP's, and the tests' oracle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..model.double_support import box_around, strip, transfer_mean
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from ..solvers.general_qp import QuadraticProgram
from .dense import SHORTEST, ExplicitProblem, grid, write_out


@dataclass(frozen=True)
class JointProblem:
    """Inputs (x axis; y axis), each as in `ExplicitProblem`; the strips of the hull are the last rows."""

    qp: QuadraticProgram
    axes: tuple[ExplicitProblem, ExplicitProblem]  # without the strips
    double: int  # intervals in double support

    def split(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The inputs of each axis."""
        n = self.axes[0].qp.f.size
        return x[:n], x[n:]


def joint_grid(config: PlannerConfig, remaining: float, elapsed: float) -> tuple[NDArray[np.float64], int]:
    """Durations of the intervals until touchdown [s], and how many of them are in double support.

    One control period, the rest of double support, then the grid of single support.
    """
    left = config.double_support - elapsed
    rest = left - config.first_interval_min
    double = [config.first_interval_min, rest] if rest > SHORTEST else [left]
    single = grid(config, max(remaining - left, SHORTEST))
    return np.concatenate([double, single]), len(double)


def joint_problem(
    robot: RobotModel, config: PlannerConfig, remaining: float, elapsed: float, state: NDArray[np.float64],
    other: NDArray[np.float64], cop_max: NDArray[np.float64], accelerations: NDArray[np.float64],
) -> JointProblem:  # fmt: skip
    """Build the program.

    Args:
        robot: physical constants.
        config: weights.
        remaining: until touchdown [s].
        elapsed: since the step began [s].
        state: (4, 2) DCM [m], lean [rad], its rate [rad/s], DCM wanted at touchdown [m].
        other: (2,) where the other foot stands, p [m].
        cop_max: (2,) half size of a sole less the margin [m].
        accelerations: (2, 2) lower and upper bounds of the trunk acceleration by axis [rad/s^2].
    """
    until, double = joint_grid(config, remaining, elapsed)
    starts = elapsed + np.concatenate([[0.0], np.cumsum(until)[:-1]])
    shares = np.array(
        [
            transfer_mean(s, h, config.double_support, robot.omega) if k < double else 0.0
            for k, (s, h) in enumerate(zip(starts, until, strict=True))
        ]
    )
    axes = []
    for i in range(2):
        low, high = np.full(until.size, -cop_max[i]), np.full(until.size, cop_max[i])
        low[:double], high[:double] = box_around(-cop_max[i], cop_max[i], other[i])
        values = (float(state[0, i]), float(state[1, i]), float(state[2, i]), float(state[3, i]))
        axes.append(
            write_out(robot, config, until, double + 1, values, shares * other[i], low, high,
                      accelerations[0, i], accelerations[1, i])
        )  # fmt: skip
    return JointProblem(
        _joined(axes[0], axes[1], double, strip(*other, *cop_max)), (axes[0], axes[1]), double
    )


def _joined(
    x: ExplicitProblem, y: ExplicitProblem, double: int, band: tuple[float, float, float]
) -> QuadraticProgram:
    """Both programs side by side, with |n . z_k| <= half width for the CoPs in double support."""
    n, m = x.qp.f.size, x.qp.lower.size
    strips = min(double, x.cops)
    H, A = np.zeros((2 * n, 2 * n)), np.zeros((2 * m + strips, 2 * n))
    H[:n, :n], H[n:, n:], A[:m, :n], A[m : 2 * m, n:] = x.qp.H, y.qp.H, x.qp.A, y.qp.A
    for k in range(strips):
        A[2 * m + k, k], A[2 * m + k, n + k] = band[0], band[1]
    edge = np.full(strips, band[2])
    return QuadraticProgram(
        H,
        np.concatenate([x.qp.f, y.qp.f]),
        A,
        np.concatenate([x.qp.lower, y.qp.lower, -edge]),
        np.concatenate([x.qp.upper, y.qp.upper, edge]),
        np.concatenate([x.qp.soft_weight, y.qp.soft_weight, np.zeros(strips)]),
    )
