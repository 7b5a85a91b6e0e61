"""Stage 2, default form: CoP and trunk acceleration until touchdown, by a small convex program per axis.

Inputs are constant over each interval, which the DCM follows exactly (eqs. 6b, 9):

    xi(t + d) = e^{w d} xi - (e^{w d} - 1) (z + j/(m g) a)

    min   beta_cop sum p_k (z_k - z_ref)^2 + beta_trunk sum p_k a_k^2 + beta_trunk_rate sum rate_k^2
        + beta_trunk_angle sum angle_k^2 + beta_dcm (xi_T - xi_des)^2 + beta_trunk_limit sum s_k^2
    s.t.  |z_k| <= sole - margin,  |j a_k - gravity torque| <= tau_max,  |angle_k + s_k| <= angle_max

The grid is anchored at touchdown, with a braking tail for the trunk after it. The first interval takes what
is left over, between the control period and the control period + sampling time, and its inputs are weighted
by its share p_0 = h_0/dt of an interval (p_k = 1 for the others): the costs approximate integrals, so that
the plan does not change its mind from one cycle to the next. Inputs have hard bounds and the trunk angle a
soft one, hence the problem is always feasible. Each solve starts cold: a plan is a function of its arguments.

No matrix is factorised in the loop (`cop_planner_tables`); DAQP is called only if the unconstrained optimum,
known in closed form, violates a bound.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..compiled.array_table import parts_table
from ..errors import InvalidValueError
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from ..solvers.general_qp import solve_qp
from ..solvers.least_distance import LeastDistance
from ..stage_1.columns import STATUS as STATUS_COLUMN
from .dense import explicit_problem
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
from .kernel import (
    COP_REFERENCE,
    DCM,
    DCM_TARGET,
    INPUTS,
    INVALID,
    LEAN,
    LEAN_RATE,
    UNTIL,
    acceleration_bounds,
    plan_rows,
    write_inputs,
)
from .packing import Constants, Memory, Parts, Shared, new_memory
from .tables import build

LONGEST_MARGIN = 0.3  # horizons reach this far beyond the longest step [s]


class CopPlanner:
    """Plans the CoP and the trunk acceleration for one robot and configuration.

    A planner owns scratch memory, `packed`, for each of its workers: of the caller's threads only one may
    use it, or one part of `packed`, at a time. Pickling builds it anew.
    """

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig, workers: int = 1):
        """Build the tables of every horizon length.

        Args:
            robot: physical constants.
            limits: half sizes of the sole and bound of the trunk acceleration.
            config: weights and margins.
            workers: parts of `packed`; `plan` and `plan_batch` use the first.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
        """
        self.robot, self.limits, self.config = robot, limits, config
        bounds = cop_bounds(limits, config)
        require_positive(config, "beta_trunk_limit")
        self.longest = limits.duration_max + LONGEST_MARGIN
        self.constants = Constants(
            robot.omega, robot.cmp_per_trunk_acceleration, *bounds, limits.trunk_acceleration_max,
            robot.trunk_torque_max / robot.trunk_inertia, config.trunk_gravity / robot.trunk_inertia,
            robot.trunk_angle_max, config.sampling_time, config.first_interval_min, config.beta_cop,
            config.beta_trunk, config.use_cop, config.use_trunk,
        )  # fmt: skip
        self.tables, matrices = build(robot, config, self.longest)
        self._problems: list[LeastDistance] = []
        shared = Shared(np.array(self.constants, dtype=np.float64), limits.box)
        # the tables hold addresses: their arrays live as long as they do
        self._parts = [Parts(shared, self.tables, self._allocate(matrices)) for _ in range(workers)]
        self.packed = [parts_table(parts) for parts in self._parts]  # one for each worker's compiled loop
        self._row, self._out = np.zeros((1, INPUTS)), np.zeros((1, RESULT_SIZE))

    def __reduce__(self) -> tuple[Any, ...]:
        return CopPlanner, (self.robot, self.limits, self.config, len(self.packed))

    def _allocate(self, matrices: NDArray[np.float64]) -> Memory:
        """Scratch memory of one worker, with solvers of its own."""
        first = int(self.config.use_cop) + int(self.config.use_trunk)
        sizes = [(int(r) + first, int(k)) for r, k in zip(self.tables.rest, self.tables.nodes, strict=True)]
        memory = new_memory(matrices, max(n + k for n, k in sizes), max(n for n, _ in sizes))
        for e, (n, k) in enumerate(sizes if first else []):
            matrix = memory.matrices[e, : (n + k) * n].reshape(n + k, n)
            soft = np.concatenate([np.zeros(n), np.full(k, self.config.beta_trunk_limit)])
            bounds = memory.lower[: n + k], memory.upper[: n + k]
            self._problems.append(LeastDistance(matrix, soft, *bounds, memory.solution[:n]))
            memory.handles[e] = self._problems[-1].handle
        return memory

    def plan(
        self,
        remaining: float,
        dcm: ArrayLike,
        trunk_angle: ArrayLike,
        trunk_rate: ArrayLike,
        dcm_target: ArrayLike,
        cop_reference: ArrayLike = (0.0, 0.0),
    ) -> CopPlan:
        """Plan from the present state to touchdown.

        Args:
            remaining: time to touchdown [s]; at most `longest`, and planned as `SHORTEST` where it is less.
            dcm: (2,) measured DCM [m].
            trunk_angle: (2,) lean towards +x, +y [rad].
            trunk_rate: (2,) [rad/s].
            dcm_target: (2,) DCM wanted at touchdown, u_T + b_nom (eq. 7) [m].
            cop_reference: (2,) [m].

        Raises:
            InvalidValueError: an argument is not finite or has the wrong shape, or `remaining` is too long.
        """
        row, out = self._row, self._out
        try:
            row[0, UNTIL] = remaining
            for column, pair in (
                (DCM, dcm), (LEAN, trunk_angle), (LEAN_RATE, trunk_rate), (DCM_TARGET, dcm_target),
                (COP_REFERENCE, cop_reference),
            ):  # fmt: skip
                row[0, column : column + 2] = pair
        except (ValueError, TypeError) as error:
            raise InvalidValueError(f"stage 2 takes a time and vectors of 2 numbers: {error}") from None
        if self.config.solver == "osqp":
            return self._plan_explicit(row[0])
        plan_rows(row, out, self.packed[0])
        result = out[0].copy()
        status = int(result[RESULT_STATUS])
        if status == INVALID:
            self._reject(row)
        return plan_of(result, STATUS[status])

    def plan_batch(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Plan n robots by DAQP in one compiled loop.

        Args:
            rows: (n, 11): remaining, dcm (2), trunk angle (2), trunk rate (2), dcm target (2),
                cop reference (2), as for `plan`.

        Returns:
            (n, 7): cop (2), trunk acceleration (2), predicted dcm at touchdown (2), index into `STATUS`.
        """
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != INPUTS:
            raise InvalidValueError(f"rows must have shape (n, {INPUTS}), got {rows.shape}")
        out = np.zeros((rows.shape[0], RESULT_SIZE))
        if plan_rows(rows, out, self.packed[0]):
            self._reject(rows[out[:, RESULT_STATUS] == INVALID])
        return out

    def refuse(self, observations: NDArray[np.float64], rows: NDArray[np.float64]) -> None:
        """Raise InvalidValueError for the first stage 1 row whose result is invalid."""
        inputs = np.empty((len(rows), INPUTS))
        write_inputs(observations, rows, inputs)
        self._reject(inputs[rows[:, STATUS_COLUMN] == INVALID])

    def bounds(self, axis: int, trunk_angle: float) -> tuple[float, float, float]:
        """CoP bound [m], and lower and upper bound of the trunk acceleration [rad/s^2] at a lean angle."""
        low, high = acceleration_bounds(trunk_angle, self.constants)
        return (self.constants.cop_x, self.constants.cop_y)[axis], low, high

    def _plan_explicit(self, row: NDArray[np.float64]) -> CopPlan:
        """The same plan by OSQP, from the dense problem: slow, a second opinion."""
        exact = self.plan_batch(row[None])[0]
        if not (self.config.use_cop or self.config.use_trunk):
            return plan_of(exact, "solved")
        result = np.zeros(RESULT_SIZE)
        for axis in range(2):
            bounds = self.bounds(axis, row[LEAN + axis])
            dcm, angle, rate, target, reference = row[DCM + axis :: 2]
            problem = explicit_problem(
                self.robot, self.config, row[UNTIL], dcm, angle, rate, target, reference, *bounds
            )
            solution = solve_qp(problem.qp, "osqp")
            if solution.status != "solved":
                return plan_of(exact, "daqp")
            result[RESULT_COP + axis], result[RESULT_TRUNK + axis] = problem.first(solution.x)
            result[RESULT_DCM_END + axis] = problem.dcm_end(solution.x)
        return plan_of(result, "solved")

    def _reject(self, rows: NDArray[np.float64]) -> None:
        raise InvalidValueError(
            f"stage 2 needs finite states and at most {self.longest} s to touchdown, got {rows[0].tolist()}"
            " (remaining, dcm, trunk angle, trunk rate, dcm target, cop reference)"
        )
