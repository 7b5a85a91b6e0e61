"""Stage 2 while both feet stand: one convex program over both axes, which the hull of the soles couples.

Costs, trunk and tail are those of `planner`; new are the CoP's bounds in double support, the hull of both
soles (`double_support`), its reference, the transfer from foot to foot, and the grid:

    control period | rest of double support | what is left over | whole sampling intervals | braking tail

The CoP of an interval in double support is referred to the mean of the transfer in it that moves the DCM
alike. The first interval is what the CoP will be held for, and a node stands at the end of double support:
with a uniform grid, solved anew every cycle, the gait would walk backwards.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..model.double_support import INSTANT
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from ..solvers.general_qp import solve_qp
from ..solvers.least_distance import LeastDistance
from .double_support_dense import JointProblem, joint_problem
from .double_support_kernel import (
    DCM,
    DCM_TARGET,
    INPUTS,
    LEAN,
    LEAN_RATE,
    OTHER_FOOT,
    SINCE,
    UNTIL,
    Constants,
    Memory,
    missing_solver,
    plan_joint_rows,
)
from .interface import (
    RESULT_COP,
    RESULT_DCM_END,
    RESULT_SIZE,
    RESULT_STATUS,
    RESULT_TRUNK,
    STATUS,
    CopPlan,
    cop_bounds,
    plan_of,
    require_positive,
)
from .kernel import acceleration_interval
from .planner import LONGEST_MARGIN


class DoubleSupportPlanner:
    """Plans CoP and trunk acceleration in double support for one robot and configuration.

    A planner owns scratch memory: use one per thread. Pickling builds it anew.
    """

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        """Allocate the scratch memory; a solver is set up when a horizon length first occurs.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
        """
        self.robot, self.limits, self.config = robot, limits, config
        self.cop_max = np.array(cop_bounds(limits, config))
        require_positive(config, "beta_cop", "beta_trunk", "beta_trunk_limit")
        self.longest = limits.duration_max + LONGEST_MARGIN
        self.constants = Constants(
            robot.omega, robot.cmp_per_trunk_acceleration, float(self.cop_max[0]), float(self.cop_max[1]),
            *limits.trunk_accelerations, robot.trunk_torque_max / robot.trunk_inertia,
            config.trunk_gravity / robot.trunk_inertia, robot.trunk_angle_max, config.double_support,
            config.first_interval_min, config.sampling_time, config.tail_intervals,
            config.tail_sampling_time, config.trunk_debt, config.beta_cop, config.beta_trunk,
            config.beta_trunk_rate, config.beta_trunk_angle, config.beta_dcm, config.use_cop,
            config.use_trunk,
        )  # fmt: skip
        self._problems: dict[tuple[int, int], LeastDistance] = {}
        self.memory = self._allocate(math.ceil(self.longest / config.sampling_time) + 1)

    def __reduce__(self) -> tuple[Any, ...]:
        return DoubleSupportPlanner, (self.robot, self.limits, self.config)

    def _allocate(self, single: int) -> Memory:
        """Scratch for at most `single` intervals in single support."""
        n, rows, strips = self._sizes(2, single)
        total = 2 + single + self.config.tail_intervals
        return Memory(
            np.zeros((2, single + 1, 6), dtype=np.int64), np.zeros((2 * rows + strips) * 2 * n),
            np.zeros(2 * rows + strips), np.zeros(2 * rows + strips), np.zeros(2 * n),
            np.zeros(2 * rows + strips), np.zeros(rows * n), np.zeros((n, n)), np.zeros(total),
            np.zeros(total), np.zeros(n), np.zeros(n), np.zeros(total),
        )  # fmt: skip

    def _sizes(self, double: int, single: int) -> tuple[int, int, int]:
        """Inputs and rows of an axis, and strips."""
        total = double + single + self.config.tail_intervals
        trunk = total if self.config.use_trunk else 0
        inputs = (double + single if self.config.use_cop else 0) + trunk
        return inputs, inputs + trunk, double if self.config.use_cop else 0

    def _set_up(self, double: int, single: int) -> None:
        """A solver for a horizon, on the shared scratch."""
        inputs, rows, strips = self._sizes(double, single)
        m, n, w = 2 * rows + strips, 2 * inputs, self.memory
        weight = np.zeros(m)
        for at in (0, rows):
            weight[at + inputs : at + rows] = self.config.beta_trunk_limit
        w.matrix[:] = 0.0
        M = w.matrix[: m * n].reshape(m, n)
        M[np.arange(m), np.arange(m) % n] = 1.0
        problem = LeastDistance(M, weight, w.lower[:m], w.upper[:m], w.solution[:n])
        self._problems[double, single] = problem
        w.handles[double - 1, single] = problem.handle

    def plan(
        self,
        remaining: float,
        elapsed: float,
        other_foot: ArrayLike,
        dcm: ArrayLike,
        trunk_angle: ArrayLike,
        trunk_rate: ArrayLike,
        dcm_target: ArrayLike,
    ) -> CopPlan:
        """Plan from the present state to touchdown; arguments are the columns of `plan_batch`."""
        row = np.empty(INPUTS)
        try:
            row[UNTIL], row[SINCE] = remaining, elapsed
            for column, pair in (
                (OTHER_FOOT, other_foot), (DCM, dcm), (LEAN, trunk_angle), (LEAN_RATE, trunk_rate),
                (DCM_TARGET, dcm_target),
            ):  # fmt: skip
                row[column : column + 2] = pair
        except (ValueError, TypeError) as error:
            raise InvalidValueError(f"stage 2 takes two times and vectors of 2 numbers: {error}") from None
        result, statuses = self.plan_all(row[None])
        return plan_of(result[0], statuses[0])

    def plan_all(self, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[str]]:
        """Plans (n, 7) of rows (n, 12) by the configured solver, and a status for each."""
        result = self.plan_batch(rows)
        if self.config.solver == "osqp":
            return result, [self._solve_again(row, out) for row, out in zip(rows, result, strict=True)]
        return result, [STATUS[int(index)] for index in result[:, RESULT_STATUS]]

    def plan_batch(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Plan n robots one after the other in one compiled loop.

        Args:
            rows: (n, 12): time to touchdown and since the step began [s], where the other foot stands (2),
                measured dcm (2), trunk angle (2), trunk rate (2), dcm target (2); see `CopPlanner.plan`.

        Returns:
            (n, 7): cop (2), trunk acceleration (2), predicted dcm at touchdown (2), index into `STATUS`.

        Raises:
            InvalidValueError: another shape, not finite, too long, or not in double support.
        """
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != INPUTS:
            raise InvalidValueError(f"rows must have shape (n, {INPUTS}), got {rows.shape}")
        self._prepare(rows)
        out = np.zeros((len(rows), RESULT_SIZE))
        if self.config.use_cop or self.config.use_trunk:
            plan_joint_rows(rows, out, self.constants, self.memory)
        return out

    def _prepare(self, rows: NDArray[np.float64]) -> None:
        """Check the rows, and set up the solvers they need."""
        remaining, elapsed = rows[:, UNTIL], rows[:, SINCE]
        fine = np.isfinite(rows).all(axis=1) & (remaining <= self.longest) & (elapsed >= 0.0)
        fine &= self.config.double_support - elapsed > INSTANT
        if not fine.all():
            raise InvalidValueError(
                f"stage 2 in double support needs finite states, at most {self.longest} s to touchdown and "
                f"less than {self.config.double_support} s since the last, got {rows[~fine][0].tolist()}"
            )
        while (missing := missing_solver(rows, self.constants, self.memory))[0]:
            self._set_up(*missing)

    def program(self, row: NDArray[np.float64]) -> JointProblem:
        """The program of a row (12,) of `plan_batch`, written out."""
        c = self.constants
        bounds = np.array(
            [
                acceleration_interval(angle, c.gravity, c.torque, bound)
                for angle, bound in zip(row[LEAN:LEAN_RATE], (c.pitch, c.roll), strict=True)
            ]
        ).T
        state = row[DCM:INPUTS].reshape(4, 2)
        other = row[OTHER_FOOT : OTHER_FOOT + 2]
        return joint_problem(
            self.robot, self.config, row[UNTIL], row[SINCE], state, other, self.cop_max, bounds
        )

    def _solve_again(self, row: NDArray[np.float64], out: NDArray[np.float64]) -> str:
        """The same plan by OSQP, a second opinion; DAQP's stays where OSQP gives up."""
        problem = self.program(row)
        solution = solve_qp(problem.qp, "osqp")
        if solution.status != "solved":
            return "daqp"
        for i, (axis, x) in enumerate(zip(problem.axes, problem.split(solution.x), strict=True)):
            out[RESULT_COP + i], out[RESULT_TRUNK + i] = axis.first(x)
            out[RESULT_DCM_END + i] = axis.dcm_end(x)
        return "solved"
