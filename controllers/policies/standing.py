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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..array_table import Floats1, Floats2, Ints2, only_part_of, parts_table, tuple_reader
from ..jit import njit
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
from ..stage_2.problem import RESULT_COP, RESULT_SIZE, RESULT_TRUNK, Regulator, cop_bounds
from ..stage_2.standing import DCM as STATE_DCM
from ..stage_2.standing import INPUTS, LEAN_RATE, OTHER_FOOT, StandingPlanner, plan_standing_rows
from ..stage_2.standing import LEAN as STATE_LEAN

Floats = NDArray[np.float64]

# only_part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false
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


@njit(cache=True)
def was_thrown(observation: Any) -> bool:
    """Whether the other foot of a standing robot has been pushed off the floor."""
    return observation[SWING_CONTACT] == 0.0 and observation[SWING_POSITION.start + 2] > THROWN


class StayConstants(NamedTuple):
    """Constants of staying in place."""

    half_x: float  # of a sole [m]
    half_y: float  # [m]
    use_cop: float  # 1 or 0
    use_trunk: float  # 1 or 0
    carry: float  # of a push that is felt, which is expected to last on
    push_threshold: float  # of what counts as felt [m]
    pelvis_width: float  # [m]
    duration_max: float  # T that asks for no step [s]


constants_of = tuple_reader(StayConstants)


class Staying(NamedTuple):
    """Arrays of the compiled loop."""

    constants: Floats1  # `StayConstants`
    capture: Floats1  # of `capture_constants`
    stage_2: Ints2  # of `StandingPlanner.packed`
    hull: Floats2  # of `write_hull`, scratch
    state: Floats2  # (1, INPUTS), scratch
    result: Floats2  # (1, RESULT_SIZE), scratch


@njit(cache=True)
def write_no_step(row: Any, c: StayConstants) -> None:
    """Ask for no step in a row (ROW_SIZE,) of stage 1."""
    row[STEP], row[STEP + 1], row[DURATION] = 0.0, c.pelvis_width, c.duration_max


@njit(cache=True)
def margin_in_place(seen: Any, c: StayConstants, capture: Any, hull: Any) -> float:
    """How far the DCM of an observation (36,) is within what can be caught in place [m]."""
    x, y = seen[SWING_POSITION.start], seen[SWING_POSITION.start + 1]
    write_hull(x, y, 0.0, c.half_x, c.half_y, hull)
    if c.use_cop == 0.0:
        for e in range(hull.shape[0]):
            hull[e, OFFSET] = 0.5 * (hull[e, NORMAL] * x + hull[e, NORMAL + 1] * y)
    dcm, lean, rate = seen[DCM.start], seen[TRUNK_ANGLE], seen[TRUNK_RATE]
    return standing_margin_kernel(dcm, seen[DCM.start + 1], lean, rate, hull, capture)


@njit(cache=True)
def stay_rows(batch: Any, rows: Any, step: Any, packed: Any) -> int:
    """Write the plans of robots that stand and stay, of a batch (n, 36), into rows (n, ROW_SIZE) of stage 1.

    Returns how many stand and cannot stay, or are told to walk, which is written into `step` (n,).
    """
    s, count = only_part_of(packed, Staying), 0
    c, state, result = constants_of(s.constants), s.state, s.result
    for i in range(batch.shape[0]):
        seen, row = batch[i], rows[i]
        if seen[ELAPSED] >= 0.0:
            continue
        moves = was_thrown(seen) or seen[COMMAND].any()
        if moves or margin_in_place(seen, c, s.capture, s.hull) < 0.0:
            step[i], count = True, count + 1
            continue
        push = seen[PUSH_ESTIMATE]
        carry = c.carry if math.hypot(push[0], push[1]) >= c.push_threshold else 0.0
        for axis in range(2):
            state[0, OTHER_FOOT + axis] = seen[SWING_POSITION.start + axis]
            state[0, STATE_DCM + axis] = seen[DCM.start + axis] + carry * push[axis]
            state[0, STATE_LEAN + axis] = seen[TRUNK_ANGLE.start + axis]
            state[0, LEAN_RATE + axis] = seen[TRUNK_RATE.start + axis]
        plan_standing_rows(state, result, s.stage_2)
        write_no_step(row, c)
        row[RESULT:] = result[0]
        row[COP : COP + 2] = result[0, RESULT_COP : RESULT_COP + 2]
        if c.use_trunk != 0.0:
            row[TRUNK : TRUNK + 2] = result[0, RESULT_TRUNK : RESULT_TRUNK + 2]
    return count


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
        self._half_sole = cop_bounds(limits, config)
        self._constants = StayConstants(
            half_x=limits.cop_x_max, half_y=limits.cop_y_max, use_cop=float(config.use_cop),
            use_trunk=float(config.use_trunk), carry=-math.expm1(-robot.omega * config.standing_carry),
            push_threshold=config.push_threshold, pelvis_width=robot.pelvis_width,
            duration_max=limits.duration_max,
        )  # fmt: skip
        self._in_place: Staying | None = None
        if config.use_cop or config.use_trunk:
            self._stage_2_in_place = StandingPlanner(robot, limits, config)  # lives as long as its addresses
            self._in_place = Staying(
                np.array(self._constants), capture_constants(robot, limits, config.use_cop, config.use_trunk),
                self._stage_2_in_place.packed, np.empty((HULL_ROWS, HULL_COLUMNS)), np.zeros((1, INPUTS)),
                np.empty((1, RESULT_SIZE)),
            )  # fmt: skip
            self._packed = parts_table([self._in_place])
        period = config.first_interval_min
        self._shifts = np.arange(0.0, LONGEST_SHIFT + 0.5 * period, period)[: None if config.use_cop else 1]

    def plan(self, batch: Floats, rows: Floats) -> None:
        """Write the plans of those that stand, of a batch (n, 36), into rows (n, ROW_SIZE)."""
        if self._in_place is None:
            step = batch[:, ELAPSED] < 0.0
        else:
            step = np.zeros(len(batch), np.bool_)
            if not stay_rows(batch, rows, step, self._packed):
                return
        for k in step.nonzero()[0]:
            self._step(batch[k], rows[k], was_thrown(batch[k]))

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
            write_no_step(row, self._constants)
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
