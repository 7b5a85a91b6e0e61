"""Both stages in their default form, from observations to actions in one compiled call for each thread."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import njit
from ..model.gait_box import GAIT_SIZE, GaitLimits
from ..model.robot import RobotModel
from ..settings.planner_config import PlannerConfig
from ..stage_1.planner import ROW_SIZE, all_finite, scale_action, stage_1_constants, stage_1_row
from ..stage_2.forms import hold_inputs, write_input
from ..stage_2.kernel import INPUTS, OUTPUTS, plan_rows
from ..stage_2.planner import ROWS_A_THREAD, CopPlanner

Floats = NDArray[np.float64]
Actions = NDArray[np.float32]


@njit(cache=True, nogil=True)
def two_stage_actions(
    observations: Any, c: Any, actions: Any, results: Any, numbers: Any, counts: Any, scratch: Any
) -> bool:
    """Actions (n, 7) of observations (n, 36), and stage 2's results (n, 7); False where one is impossible."""
    if not all_finite(observations):
        return False
    own, low, high = c[: -2 * GAIT_SIZE - 3], c[-2 * GAIT_SIZE - 3 : -GAIT_SIZE - 3], c[-GAIT_SIZE - 3 : -3]
    adapt, use_cop, use_trunk = c[-3] > 0.0, c[-2] > 0.0, c[-1] > 0.0
    n = observations.shape[0]
    rows, inputs = np.empty((n, ROW_SIZE)), np.empty((n, INPUTS))
    for i in range(n):
        stage_1_row(observations[i], own, low, high, adapt, rows[i])
        write_input(observations[i], rows[i], inputs[i])
    if plan_rows(inputs, results, numbers, counts, scratch) > 0:
        return False
    for i in range(n):
        hold_inputs(observations[i], rows[i], low, high, use_cop, use_trunk, results[i])
        rows[i, 3], rows[i, 4] = results[i, 0], results[i, 1]
        if use_trunk:
            rows[i, 5], rows[i, 6] = results[i, 2], results[i, 3]
        scale_action(rows[i], observations[i], low, high, 0.0, actions[i])
    return True


class CompiledTwoStage:
    """The default form without double support; large batches are shared by the threads of its planner."""

    def __init__(
        self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig, adapt: bool, planner: CopPlanner
    ):
        """Pack the constants.

        Args:
            robot: physical constants.
            limits: step box, CoP and trunk bounds.
            config: weights and margins.
            adapt: False walks the nominal gait without reaction.
            planner: stage 2 of the same robot, limits and configuration.
        """
        flags = float(adapt), float(config.use_cop), float(config.use_trunk)
        constants = stage_1_constants(robot, limits, config)
        self._constants = np.concatenate([constants, limits.low, limits.high, flags])
        self._planner = planner

    def __call__(self, observations: Floats) -> tuple[Actions, Floats] | None:
        """Actions (n, 7) and stage 2's results (n, 7), see `CopPlanner.plan_batch`.

        None where an observation is impossible; the stages, called one by one, say which.
        """
        n, planner, constants = len(observations), self._planner, self._constants
        actions, results = np.empty((n, GAIT_SIZE), np.float32), np.empty((n, OUTPUTS))
        if planner.threads.threads == 1 or n < 2 * ROWS_A_THREAD:
            fine = two_stage_actions(observations, constants, actions, results, *planner.packed[0])
            return (actions, results) if fine else None
        refused = []

        def job(worker: int, first: int, end: int) -> None:
            part = observations[first:end], constants, actions[first:end], results[first:end]
            if not two_stage_actions(*part, *planner.packed[worker]):
                refused.append(first)

        planner.threads.run(job, n, ROWS_A_THREAD)
        return None if refused else (actions, results)
