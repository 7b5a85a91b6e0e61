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

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..compiled.threads import RangeThreads
from ..errors import InvalidValueError
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from ..solvers.general_qp import solve_qp
from ..solvers.least_distance import LeastDistance
from .dense import explicit_problem
from .kernel import (
    INPUTS,
    OUTPUTS,
    Constants,
    acceleration_bounds,
    new_memory,
    packed_counts,
    packed_numbers,
    plan_rows,
)
from .tables import build

ROWS_A_THREAD = 256  # with fewer plans, waking a thread costs what it saves
LONGEST_MARGIN = 0.3  # horizons reach this far beyond the longest step [s]
STATUS = ("solved", "clipped", "invalid")


@dataclass(frozen=True)
class CopPlan:
    """What to do now, in the canonical frame, relative to the stance sole's centre."""

    cop: NDArray[np.float64]  # (2,) [m]
    trunk_acceleration: NDArray[np.float64]  # (2,) towards +x, +y [rad/s^2]
    dcm_end: NDArray[np.float64]  # (2,) predicted DCM at touchdown [m]
    # "solved"; "clipped": the solver failed, the unconstrained optimum was clipped; "daqp": OSQP did not
    # converge, DAQP's plan stands in; "relaxed": the paper's form gave up its hard trunk limit
    status: str


class CopPlanner:
    """Plans the CoP and the trunk acceleration for one robot and configuration.

    A planner owns scratch memory, one for each of its own threads: of the caller's threads only one may use
    it at a time. Pickling builds it anew.
    """

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig, threads: int = 1):
        """Build the tables of every horizon length.

        Args:
            robot: physical constants.
            limits: half sizes of the sole and bound of the trunk acceleration.
            config: weights and margins.
            threads: that `plan_batch` may use; the plans do not depend on them.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
        """
        self.robot, self.limits, self.config = robot, limits, config
        bounds = (limits.cop_x_max - config.cop_margin_x, limits.cop_y_max - config.cop_margin_y)
        if min(bounds) <= 0:
            raise InvalidValueError(f"the CoP margins leave no sole: half sizes {bounds} m must be positive")
        if not config.beta_trunk_limit > 0:
            raise InvalidValueError(f"beta_trunk_limit must be positive, got {config.beta_trunk_limit}")
        self.longest = limits.duration_max + LONGEST_MARGIN
        self.constants = Constants(
            robot.omega, robot.cmp_per_trunk_acceleration, *bounds, limits.trunk_acceleration_max,
            robot.trunk_torque_max / robot.trunk_inertia, config.trunk_gravity / robot.trunk_inertia,
            robot.trunk_angle_max, config.sampling_time, config.first_interval_min, config.beta_cop,
            config.beta_trunk, config.use_cop, config.use_trunk,
        )  # fmt: skip
        self.tables, matrices = build(robot, config, self.longest)
        self.threads = RangeThreads(threads)
        self._problems: list[LeastDistance] = []
        numbers = packed_numbers(self.constants, self.tables)
        # what the compiled loop takes, for each thread: numbers, counts, scratch
        self.packed = [(numbers, *self._allocate(matrices)) for _ in range(threads)]
        self._row, self._out = np.zeros((1, INPUTS)), np.zeros((1, OUTPUTS))

    def __reduce__(self) -> tuple[Any, ...]:
        return CopPlanner, (self.robot, self.limits, self.config, self.threads.threads)

    def _allocate(self, matrices: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Counts and scratch memory of one thread, with solvers of its own."""
        first = int(self.config.use_cop) + int(self.config.use_trunk)
        sizes = [(int(r) + first, int(k)) for r, k in zip(self.tables.rest, self.tables.nodes, strict=True)]
        memory, scratch = new_memory(matrices, max(n + k for n, k in sizes), max(n for n, _ in sizes))
        for e, (n, k) in enumerate(sizes if first else []):
            matrix = memory.matrices[e, : (n + k) * n].reshape(n + k, n)
            soft = np.concatenate([np.zeros(n), np.full(k, self.config.beta_trunk_limit)])
            bounds = memory.lower[: n + k], memory.upper[: n + k]
            self._problems.append(LeastDistance(matrix, soft, *bounds, memory.solution[:n]))
            memory.handles[e] = self._problems[-1].handle
        return packed_counts(self.tables, memory), scratch

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
            row[0, 0] = remaining
            row[0, 1:3], row[0, 3:5], row[0, 5:7] = dcm, trunk_angle, trunk_rate
            row[0, 7:9], row[0, 9:11] = dcm_target, cop_reference
        except (ValueError, TypeError) as error:
            raise InvalidValueError(f"stage 2 takes a time and vectors of 2 numbers: {error}") from None
        if self.config.solver == "osqp":
            return self._plan_explicit(row[0])
        plan_rows(row, out, *self.packed[0])
        result = out[0].copy()
        status = int(result[6])
        if status == 2:
            self._reject(row)
        return _frozen(result, STATUS[status])

    def plan_batch(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Plan n robots by DAQP in one compiled loop on each thread.

        Args:
            rows: (n, 11): remaining, dcm (2), trunk angle (2), trunk rate (2), dcm target (2),
                cop reference (2), as for `plan`.

        Returns:
            (n, 7): cop (2), trunk acceleration (2), predicted dcm at touchdown (2), index into `STATUS`.
        """
        rows = np.ascontiguousarray(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != INPUTS:
            raise InvalidValueError(f"rows must have shape (n, {INPUTS}), got {rows.shape}")
        out = np.zeros((rows.shape[0], OUTPUTS))
        if self._plan_all(rows, out):
            self._reject(rows[out[:, 6] == 2])
        return out

    def _plan_all(self, rows: NDArray[np.float64], out: NDArray[np.float64]) -> int:
        """Plan into `out`; returns how many rows were invalid."""
        if self.threads.threads == 1 or len(rows) < 2 * ROWS_A_THREAD:
            return plan_rows(rows, out, *self.packed[0])
        invalid = [0] * self.threads.threads

        def job(worker: int, first: int, end: int) -> None:
            invalid[worker] = plan_rows(rows[first:end], out[first:end], *self.packed[worker])

        self.threads.run(job, len(rows), ROWS_A_THREAD)
        return sum(invalid)

    def bounds(self, axis: int, trunk_angle: float) -> tuple[float, float, float]:
        """CoP bound [m], and lower and upper bound of the trunk acceleration [rad/s^2] at a lean angle."""
        low, high = acceleration_bounds(trunk_angle, self.constants)
        return (self.constants.cop_x, self.constants.cop_y)[axis], low, high

    def _plan_explicit(self, row: NDArray[np.float64]) -> CopPlan:
        """The same plan by OSQP, from the dense problem: slow, a second opinion."""
        exact = self.plan_batch(row[None])[0]
        if not (self.config.use_cop or self.config.use_trunk):
            return _frozen(exact, "solved")
        result = np.zeros((3, 2))
        for axis in range(2):
            bounds = self.bounds(axis, row[3 + axis])
            dcm, angle, rate, target, reference = row[1 + axis :: 2]
            problem = explicit_problem(
                self.robot, self.config, row[0], dcm, angle, rate, target, reference, *bounds
            )
            solution = solve_qp(problem.qp, "osqp")
            if solution.status != "solved":
                return _frozen(exact, "daqp")
            result[0, axis], result[1, axis] = problem.first(solution.x)
            result[2, axis] = problem.dcm_end(solution.x)
        return _frozen(result.ravel(), "solved")

    def _reject(self, rows: NDArray[np.float64]) -> None:
        raise InvalidValueError(
            f"stage 2 needs finite states and at most {self.longest} s to touchdown, got {rows[0].tolist()}"
            " (remaining, dcm, trunk angle, trunk rate, dcm target, cop reference)"
        )


def _frozen(result: NDArray[np.float64], status: str) -> CopPlan:
    """The plan of an output row, read-only."""
    result.flags.writeable = False
    return CopPlan(result[0:2], result[2:4], result[4:6], status)
