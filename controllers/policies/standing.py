"""When a standing robot steps, with which foot and after how long a shift of its load.

As long as the DCM can be caught in place (`model/standing.py`), stage 2 of standing answers. Where it cannot,
or the command is to walk, a step has to come. Before a foot lifts, the CoP may still be anywhere in the hull
of both soles; held at z for t seconds it brings the DCM to

    xi(t) = e^(omega t) xi - (e^(omega t) - 1) z,

and the best z is the one that brings it nearest to where a nominal step of that foot begins. For either foot
and every t of a grid, stage 1 says what step would follow, and how far from the nominal offset b the DCM
would end. The plan is the candidate of the least cost of stage 1, with the shortest shift that saves all but
a hundredth of what shifts can save. It is made anew in every period.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..model.capturability import capture_constants
from ..model.gait_box import COP, DURATION, STEP, TRUNK, GaitLimits
from ..model.nominal_gait import NOMINAL_DURATION, NOMINAL_STEP, drifting_dcm_kernel, nearest_in_hull
from ..model.observation import (
    COM,
    COM_VELOCITY,
    COMMAND,
    DCM,
    ELAPSED,
    PUSH_ESTIMATE,
    SWING_CONTACT,
    SWING_POSITION,
    SWING_VELOCITY,
    TRUNK_ANGLE,
    TRUNK_RATE,
)
from ..model.robot import RobotModel
from ..model.standing import (
    HULL_COLUMNS,
    HULL_ROWS,
    NORMAL,
    OFFSET,
    THROWN,
    standing_margin_kernel,
    write_hull,
)
from ..settings import PlannerConfig
from ..stage_1 import DCM_AHEAD, NOMINAL, NOMINAL_OFFSET, RESULT, ROW_SIZE, StepPlanner
from ..stage_2.problem import RESULT_COP, RESULT_TRUNK, Regulator, cop_bounds
from ..stage_2.standing import StandingPlanner

Floats = NDArray[np.float64]
LONGEST_SHIFT = 0.4  # of the load before a foot lifts [s]
LEFT = 0.01  # of what a shift can save, which is not waited for
NEAR = 2e-3  # nor is a DCM so near to where a step begins [m]
# Entries towards the swing side, whose sign is another one from the other foot
MIRRORED = [
    pair.start + 1
    for pair in (DCM, COM, COM_VELOCITY, SWING_VELOCITY, TRUNK_ANGLE, TRUNK_RATE, COMMAND, PUSH_ESTIMATE)
]


def from_other_foot(observation: Floats) -> Floats:
    """The observation (36,) of a standing robot as seen from its other foot, the action left as it was."""
    seen = observation.copy()
    x, y = observation[SWING_POSITION][:2]
    seen[MIRRORED] *= -1.0
    for pair in (DCM, COM):
        seen[pair.start], seen[pair.start + 1] = observation[pair.start] - x, y - observation[pair.start + 1]
    seen[SWING_POSITION.start] = -x
    return seen


def was_thrown(observation: Floats) -> bool:
    """Whether the other foot of a standing robot has been pushed off the floor."""
    return observation[SWING_CONTACT] == 0.0 and observation[SWING_POSITION][2] > THROWN


class Stander:
    """Decides for standing robots, between stage 2 of standing and a first step."""

    def __init__(
        self,
        robot: RobotModel,
        limits: GaitLimits,
        config: PlannerConfig,
        stage_1: StepPlanner,
        stage_2: Regulator,
        worker: int = 0,
    ):
        self._worker = worker
        self._robot, self._limits, self._config = robot, limits, config
        self._stage_1, self._stage_2 = stage_1, stage_2
        self._in_place = (
            StandingPlanner(robot, limits, config) if config.use_cop or config.use_trunk else None
        )
        self._capture = capture_constants(robot, limits, config.use_cop, config.use_trunk)
        self._half_sole = cop_bounds(limits, config)
        period = config.first_interval_min
        self._shifts = np.arange(0.0, LONGEST_SHIFT + 0.5 * period, period)[: None if config.use_cop else 1]

    def plan(self, observation: Floats, row: Floats) -> None:
        """Write the plan of a standing robot's observation (36,) into a row (ROW_SIZE,) of stage 1."""
        planner, thrown = self._in_place, was_thrown(observation)
        if planner is None or thrown or observation[COMMAND].any() or self._margin(observation) < 0.0:
            self._step(observation, row, thrown)
        else:
            self._stay(observation, row, planner)

    def _margin(self, observation: Floats) -> float:
        """How far the DCM is within what can be caught in place [m]."""
        hull = np.empty((HULL_ROWS, HULL_COLUMNS))
        other, limits = observation[SWING_POSITION], self._limits
        write_hull(other[0], other[1], 0.0, limits.cop_x_max, limits.cop_y_max, hull)
        if not self._config.use_cop:
            hull[:, OFFSET] = 0.5 * hull[:, NORMAL : NORMAL + 2] @ other[:2]
        dcm, lean, rate = observation[DCM], observation[TRUNK_ANGLE], observation[TRUNK_RATE]
        return standing_margin_kernel(dcm[0], dcm[1], lean, rate, hull, self._capture)

    def _stay(self, observation: Floats, row: Floats, planner: StandingPlanner) -> None:
        """Stage 2 of standing; the duration T_max asks for no step."""
        push, config = observation[PUSH_ESTIMATE], self._config
        felt = np.hypot(*push) >= config.push_threshold
        carry = -math.expm1(-self._robot.omega * config.standing_carry) * felt
        other, dcm = observation[SWING_POSITION][:2], observation[DCM] + carry * push
        state = np.concatenate([other, [0.0], dcm, observation[TRUNK_ANGLE], observation[TRUNK_RATE]])
        result = planner.plan_batch(state[None])[0]
        self._ask_for_no_step(row)
        row[RESULT:] = result
        row[COP : COP + 2] = result[RESULT_COP : RESULT_COP + 2]
        if self._config.use_trunk:
            row[TRUNK : TRUNK + 2] = result[RESULT_TRUNK : RESULT_TRUNK + 2]

    def _ask_for_no_step(self, row: Floats) -> None:
        row[STEP], row[STEP + 1], row[DURATION] = 0.0, self._robot.pelvis_width, self._limits.duration_max

    def _step(self, observation: Floats, row: Floats, thrown: bool) -> None:
        """The best of all candidates: the shift of the load goes on, or a foot lifts now.

        Of a foot that was thrown off the floor there is nothing to choose: it steps.
        """
        found = []
        for swapped in (False,) if thrown else (False, True):
            seen = from_other_foot(observation) if swapped else observation.copy()
            seen[ELAPSED] = 0.0
            cops, costs, rows = self._candidates(seen)
            least, near = costs.min(), self._config.alpha_offset * NEAR**2
            k = 0 if thrown else int(np.argmax(costs <= least + LEFT * (costs[0] - least) + near))
            found.append((costs[k], swapped, k, seen, cops[k], rows[k]))
        _, swapped, k, seen, cop, planned = min(found, key=lambda one: one[0])
        if k == 0:
            batch, rows = seen[None], planned[None].copy()
            self._stage_2.regulate(batch, rows, self._worker)
            planned, cop = rows[0], rows[0, COP : COP + 2]
            row[DURATION] = min(planned[DURATION], 0.999 * self._limits.duration_max)
            row[TRUNK : TRUNK + 2] = planned[TRUNK : TRUNK + 2] * [1.0, -1.0 if swapped else 1.0]
            row[STEP : STEP + 2] = planned[STEP : STEP + 2]
        else:
            self._ask_for_no_step(row)
        x, y = observation[SWING_POSITION][:2]
        row[COP : COP + 2] = (x + cop[0], y - cop[1]) if swapped else cop

    def _candidates(self, seen: Floats) -> tuple[Floats, Floats, Floats]:
        """CoPs (K, 2) while the load shifts, costs (K,) and stage 1's rows (K, ROW_SIZE), of the shifts."""
        config, omega, K = self._config, self._robot.omega, len(self._shifts)
        batch, rows = np.tile(seen, (K, 1)), np.empty((K, ROW_SIZE))
        self._stage_1.plan(batch[:1], rows[:1])
        ahead = rows[0, DCM_AHEAD : DCM_AHEAD + 2].copy()
        start = np.array(drifting_dcm_kernel(rows[0, NOMINAL : NOMINAL + 5], omega, config.touchdown_delay))
        growth = np.exp(omega * self._shifts)[:, None]
        wanted = (growth * ahead - start) / np.maximum(growth - 1.0, 1e-9)
        other = seen[SWING_POSITION.start], seen[SWING_POSITION.start + 1]
        cops = np.array([nearest_in_hull(x, y, *other, *self._half_sole) for x, y in wanted])
        batch[:, DCM] = growth * ahead - (growth - 1.0) * cops
        batch[:, PUSH_ESTIMATE] = 0.0  # it is in the DCM ahead
        self._stage_1.plan(batch, rows)
        nominal, offset = rows[:, NOMINAL : NOMINAL + 3], rows[:, NOMINAL_OFFSET : NOMINAL_OFFSET + 2]
        u, T = rows[:, STEP : STEP + 2], rows[:, DURATION]
        grown = batch[:, DCM] * np.exp(omega * (T + config.touchdown_delay))[:, None] - u
        tau = np.exp(omega * T) - np.exp(omega * nominal[:, NOMINAL_DURATION])
        costs = config.alpha_offset * np.square(grown - offset).sum(axis=1)
        costs += config.alpha_step * np.square(u - nominal[:, NOMINAL_STEP : NOMINAL_STEP + 2]).sum(axis=1)
        costs += config.alpha_duration * np.square(tau)
        return cops, costs, rows
