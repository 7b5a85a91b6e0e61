"""Stage 2 in the paper's form: DCM acceleration and trunk jerk (eqs. 8-20), one program per axis.

State (xi, xi', theta, theta', theta''), inputs (xi'', theta''') constant over each interval, A and B of eqs.
11-14, output z = xi - xi'/omega - j/(m g) theta'' (eq. 10). With N nodes until touchdown,

    min   beta_cop |Z - z_ref|^2 + beta_dcm_acceleration |xi'' - ref|^2 + beta_trunk |theta'''|^2
        + beta_trunk_rate |theta'|^2 + beta_dcm (xi_T - xi_des)^2
    s.t.  |j theta'' - gravity torque| <= tau_max,  |theta| <= theta_max,  |Z| <= sole - margin

`literal` is eq. 20 as written: ref = 0 and a hard theta. It does not walk: with xi'' penalised itself, the
CoP leaves its reference even where the motion is nominal, and theta may have no feasible plan; the limit is
then relaxed and the plan's status says "relaxed". `repaired` penalises the deviation from the DCM's free
motion, ref = mean of omega^2 (xi - z_ref) e^{omega t} over the interval, adds beta_trunk_angle |theta|^2 and
makes theta soft (weight beta_trunk_limit), so that every state has a plan.

The paper's grid is uniform; here its first interval takes what is left over of the time until touchdown, and
its inputs are weighted by their share of an interval.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError, UnknownNameError
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from ..solvers.general_qp import QuadraticProgram, solve_qp
from ..solvers.least_distance import LeastDistance, solve_least_distance
from .dense import SHORTEST, grid
from .interface import CopPlan, cop_bounds, require_positive
from .kernel import acceleration_interval
from .paper_form_kernel import Constants, Workspace, build, outputs, write_bounds
from .planner import LONGEST_MARGIN

COSTS = ("literal", "repaired")


class JerkCopPlanner:
    """Plans the CoP and the trunk acceleration with the paper's variables."""

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        """Prepare the planner; workspaces are set up when a horizon length first occurs.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
            UnknownNameError: `config.jerk_cost` is not one of `COSTS`.
        """
        if config.jerk_cost not in COSTS:
            raise UnknownNameError("jerk cost", config.jerk_cost, COSTS)
        require_positive(config, "beta_dcm_acceleration", "beta_trunk", "beta_trunk_limit")
        self.robot, self.limits, self.config = robot, limits, config
        self.cop_max = cop_bounds(limits, config)
        self.longest = limits.duration_max + LONGEST_MARGIN
        repaired = config.jerk_cost == "repaired"
        self.constants = Constants(
            robot.omega, robot.cmp_per_trunk_acceleration, robot.trunk_angle_max, config.sampling_time,
            config.beta_cop, config.beta_dcm_acceleration, config.beta_trunk, config.beta_trunk_rate,
            config.beta_trunk_angle if repaired else 0.0, repaired, config.use_trunk,
        )  # fmt: skip
        self._workspaces: dict[int, tuple[Workspace, LeastDistance, LeastDistance]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return JerkCopPlanner, (self.robot, self.limits, self.config)

    def plan(
        self,
        remaining: float,
        dcm: ArrayLike,
        trunk_angle: ArrayLike,
        trunk_rate: ArrayLike,
        dcm_target: ArrayLike,
        cop_reference: ArrayLike = (0.0, 0.0),
        previous_cop: ArrayLike = (0.0, 0.0),
        previous_trunk_acceleration: ArrayLike = (0.0, 0.0),
    ) -> CopPlan:
        """Plan from the present state to touchdown; see `CopPlanner.plan`.

        The result is the CoP and the trunk acceleration at the end of the coming control period (which is
        `first_interval_min`): the `previous_cop` and `previous_trunk_acceleration` of the next call.

        Args:
            remaining: time to touchdown [s].
            dcm: (2,) [m].
            trunk_angle: (2,) [rad].
            trunk_rate: (2,) [rad/s].
            dcm_target: (2,) [m].
            cop_reference: (2,) [m].
            previous_cop: (2,) CoP now, of this stance foot; with it xi' = omega (xi - CMP) (eq. 6b) [m].
            previous_trunk_acceleration: (2,) theta'' now [rad/s^2].
        """
        state = self._state(
            remaining, dcm, trunk_angle, trunk_rate, dcm_target, cop_reference, previous_cop,
            previous_trunk_acceleration,
        )  # fmt: skip
        durations = grid(self.config, max(remaining, SHORTEST))
        result, statuses = np.zeros((3, 2)), []
        for axis in range(2):
            status = self._plan_axis(durations, remaining, axis, state[:, axis], result[:, axis])
            statuses.append(status)
        result.flags.writeable = False
        status = next((s for s in statuses if s != "solved"), "solved")
        return CopPlan(result[0], result[1], result[2], status)

    def _state(self, remaining: float, *vectors: ArrayLike) -> NDArray[np.float64]:
        """The vectors that `plan` takes, (7, 2).

        Raises:
            InvalidValueError: one has the wrong shape or is not finite, or `remaining` is too long.
        """
        try:
            state = np.array(vectors, dtype=np.float64).reshape(len(vectors), 2)
        except (ValueError, TypeError) as error:
            raise InvalidValueError(f"stage 2 takes vectors of 2 numbers: {error}") from None
        if not (np.all(np.isfinite(state)) and remaining <= self.longest):
            raise InvalidValueError(
                f"stage 2 needs finite states and at most {self.longest} s to touchdown, got {remaining} s,"
                f" {state.tolist()}"
            )
        if not self.config.use_trunk:
            state[-1] = 0.0
        return state

    def program(
        self, remaining: float, axis: int, state: NDArray[np.float64], soft: bool | None = None
    ) -> QuadraticProgram:
        """The program of one axis; state: (7,) as the arguments of `plan` from `dcm` on."""
        durations = grid(self.config, max(remaining, SHORTEST))
        workspace = self._assemble(durations, axis, state)[0]
        soft = self.constants.repaired if soft is None else soft
        weight = np.where(workspace.soft, self.config.beta_trunk_limit if soft else 0.0, 0.0)
        low, high = workspace.low.copy(), workspace.high.copy()
        return QuadraticProgram(workspace.H.copy(), workspace.f.copy(), workspace.A.copy(), low, high, weight)

    def _assemble(
        self, durations: NDArray[np.float64], axis: int, state: NDArray[np.float64]
    ) -> tuple[Workspace, LeastDistance, LeastDistance]:
        found = self._workspaces.get(durations.size)
        if found is None:
            found = self._workspaces[durations.size] = self._allocate(durations.size)
        workspace = found[0]
        build(durations, state, self.config.beta_dcm, self.constants, workspace)
        cop_low, cop_high = -self.cop_max[axis], self.cop_max[axis]
        if not self.config.use_cop:
            cop_low = cop_high = min(max(state[4], cop_low), cop_high)
        torque = self.robot.trunk_torque_max / self.robot.trunk_inertia
        gravity = self.config.trunk_gravity / self.robot.trunk_inertia
        low, high = acceleration_interval(state[1], gravity, torque, self.limits.trunk_acceleration_max)
        write_bounds(cop_low, cop_high, low, high, self.constants.angle, workspace)
        return found

    def _allocate(self, nodes: int) -> tuple[Workspace, LeastDistance, LeastDistance]:
        workspace = Workspace.of(nodes, self.config.use_trunk)
        weight = np.where(workspace.soft, self.config.beta_trunk_limit, 0.0)
        bounds = (workspace.lower, workspace.upper, workspace.v)
        hard = LeastDistance(workspace.M, np.zeros_like(weight), *bounds)
        return workspace, hard, LeastDistance(workspace.M, weight, *bounds)

    def _plan_axis(
        self,
        durations: NDArray[np.float64],
        remaining: float,
        axis: int,
        state: NDArray[np.float64],
        result: NDArray[np.float64],
    ) -> str:
        """Fill (cop, trunk acceleration, dcm at touchdown) and return the status."""
        workspace, hard, soft = self._assemble(durations, axis, state)
        period, status = min(self.config.first_interval_min, durations[0]), "solved"
        if self.config.solver == "osqp":
            solution = solve_qp(self.program(remaining, axis, state), "osqp")
            if solution.status != "solved":
                solution = solve_qp(self.program(remaining, axis, state, soft=True), "osqp")
                status = "relaxed" if solution.status == "solved" else "clipped"
            if solution.status == "solved":
                workspace.x[:] = solution.x
            outputs(period, state, False, self.constants, workspace, result)
        else:
            flag = solve_least_distance((soft if self.constants.repaired else hard).handle)
            if flag <= 0:
                flag = solve_least_distance(soft.handle)
                status = "relaxed" if flag > 0 else "clipped"
            outputs(period, state, flag > 0, self.constants, workspace, result)
        result[0] = min(max(result[0], -self.cop_max[axis]), self.cop_max[axis])
        limit = self.limits.trunk_acceleration_max
        result[1] = min(max(result[1], -limit), limit)
        return status
