"""Stage 2 of a robot that stands: CoP in the hull of both soles and trunk, over a fixed horizon.

No step ends the horizon, so it moves on with the robot; what is wanted at its end is the DCM over the middle
between the feet, where CoM and CoP are at rest. With all positions counted from there, per axis,

    min   beta_dcm xi_N^2 + sum_k beta_cop z_k^2
          + sum_k beta_trunk a_k^2 + beta_rate theta'_k^2 + beta_angle theta_k^2
    s.t.  n . z_k <= offset - n . middle  for all edges of the hull of both soles,
          a_k within the torque,  |theta_k| <= theta_max,

on a grid of sampling intervals and the trunk's braking tail, whose CMP is part of xi_N as in single support.
Grid and weights never change, so the unconstrained optimum is a constant feedback of DCM, lean and rate.
Where it passes a bound, the nearest plan that keeps all of them is a least-distance problem for DAQP.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..array_table import Floats1, Floats2, Ints1, only_part_of, parts_table
from ..errors import InvalidValueError
from ..jit import njit
from ..model.gait_box import GaitLimits
from ..model.robot import RobotModel
from ..model.standing import HULL_COLUMNS, HULL_ROWS, NORMAL, OFFSET, REACH, write_hull
from ..qp import LeastDistance, solve_least_distance
from ..settings import PlannerConfig
from . import problem
from .problem import Constants, acceleration_interval, constants_of

Floats = NDArray[np.float64]

# only_part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

# Columns of an input row; of a pair (x, y) the first one
OTHER_FOOT = 0  # pair, its centre [m]
TURN = 2  # of the other foot [rad]
DCM = 3  # pair [m]
LEAN = 5  # pair [rad]
LEAN_RATE = 7  # pair [rad/s]
INPUTS = 9

FREE = 1e9  # a bound that never binds


class Program(NamedTuple):
    """Constant matrices of one axis with n inputs, CoPs first, and the workspace of both axes."""

    numbers: Floats1  # see `Constants`
    feedback: Floats2  # (n, 3) optimum per DCM, lean and rate
    lean: Floats2  # (trunks, n + 2) angle after each interval per input, then per lean and rate
    end: Floats1  # (n + 1,) DCM at the end per input, then per DCM
    whitened: Floats2  # (n, n) L^-T, H = L L': inputs per solution of the least-distance problem
    handle: Ints1
    matrix: Floats2  # (rows, 2 n): trunk accelerations and angles of x, then of y; edge by edge the CoPs
    lower: Floats1  # (rows,)
    upper: Floats1  # (rows,)
    solution: Floats1  # (2 n,)
    plan: Floats2  # (2, n), of both axes
    hull: Floats2  # of `write_hull`


@njit(cache=True)
def plan_standing_rows(rows: Any, out: Any, packed: Any) -> None:
    """Plan every row of (n, INPUTS) into (n, RESULT_SIZE); see `StandingPlanner.plan_batch`."""
    p = only_part_of(packed, Program)
    c = constants_of(p.numbers)
    for i in range(rows.shape[0]):
        out[i, problem.RESULT_STATUS] = _solve(rows[i], c, p)
        _write_plan(rows[i], out[i], c, p)


@njit(cache=True)
def _solve(row: Any, c: Constants, p: Program) -> int:
    """Plan one row: the optimum, and the nearest plan within the bounds where it passes one; the status."""
    n, trunks = p.feedback.shape[0], p.lean.shape[0]
    cops = n - trunks
    write_hull(row[OTHER_FOOT], row[OTHER_FOOT + 1], row[TURN], c.cop_x, c.cop_y, p.hull)
    inside = True
    for axis in range(2):
        dcm, lean, rate = (
            row[DCM + axis] - 0.5 * row[OTHER_FOOT + axis],
            row[LEAN + axis],
            row[LEAN_RATE + axis],
        )
        low, high = acceleration_interval(lean, c.gravity, c.torque, c.pitch if axis == 0 else c.roll)
        u, at = p.plan[axis], 2 * axis * trunks
        for j in range(n):
            u[j] = p.feedback[j, 0] * dcm + p.feedback[j, 1] * lean + p.feedback[j, 2] * rate
        for j in range(trunks):
            p.lower[at + j], p.upper[at + j] = low - u[cops + j], high - u[cops + j]
        for k in range(trunks):
            angle = p.lean[k, n] * lean + p.lean[k, n + 1] * rate
            for j in range(n):
                angle += p.lean[k, j] * u[j]
            p.lower[at + trunks + k], p.upper[at + trunks + k] = -c.angle - angle, c.angle - angle
    first = 4 * trunks
    for e in range(REACH):
        x, y = p.hull[e, NORMAL], p.hull[e, NORMAL + 1]
        room = p.hull[e, OFFSET] - 0.5 * (x * row[OTHER_FOOT] + y * row[OTHER_FOOT + 1])
        for k in range(cops):
            p.lower[first + e * cops + k] = -FREE
            p.upper[first + e * cops + k] = room - x * p.plan[0, k] - y * p.plan[1, k]
    for i in range(p.lower.shape[0]):
        inside = inside and p.lower[i] <= 0.0 <= p.upper[i]
    if inside:
        return problem.SOLVED
    for e in range(REACH):
        x, y = p.hull[e, NORMAL], p.hull[e, NORMAL + 1]
        for k in range(cops):
            for j in range(n):
                p.matrix[first + e * cops + k, j] = x * p.whitened[k, j]
                p.matrix[first + e * cops + k, n + j] = y * p.whitened[k, j]
    if solve_least_distance(p.handle) <= 0:
        return problem.CLIPPED
    for axis in range(2):
        for i in range(n):
            for j in range(n):
                p.plan[axis, i] += p.whitened[i, j] * p.solution[axis * n + j]
    return problem.SOLVED


@njit(cache=True)
def _write_plan(row: Any, out: Any, c: Constants, p: Program) -> None:
    """CoP, trunk acceleration and expected DCM, within the bounds whatever became of the solver."""
    n, cops = p.feedback.shape[0], p.feedback.shape[0] - p.lean.shape[0]
    for axis in range(2):
        rest, u = 0.5 * row[OTHER_FOOT + axis], p.plan[axis]
        low, high = acceleration_interval(
            row[LEAN + axis], c.gravity, c.torque, c.pitch if axis == 0 else c.roll
        )
        out[problem.RESULT_COP + axis] = rest + u[0] if cops > 0 else rest
        out[problem.RESULT_TRUNK + axis] = min(max(u[cops], low), high) if n > cops else 0.0
        out[problem.RESULT_DCM_END + axis] = rest + p.end[n] * (row[DCM + axis] - rest)
        for j in range(n):
            out[problem.RESULT_DCM_END + axis] += p.end[j] * u[j]
    cop = out[problem.RESULT_COP : problem.RESULT_COP + 2]
    for e in range(REACH):
        x, y = p.hull[e, NORMAL], p.hull[e, NORMAL + 1]
        beyond = max(x * cop[0] + y * cop[1] - p.hull[e, OFFSET], 0.0)
        cop[0], cop[1] = cop[0] - beyond * x, cop[1] - beyond * y


class StandingPlanner:
    """Plans CoP and trunk acceleration of robots that stand on both feet, for one robot and configuration.

    A planner owns scratch memory: use one per thread. Pickling builds it anew.
    """

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        """Factorise the program.

        Raises:
            InvalidValueError: a margin leaves no CoP, or a weight that must be positive is zero.
        """
        self.robot, self.limits, self.config = robot, limits, config
        self._numbers = problem.pack_constants(robot, limits, config, limits.trunk_accelerations)
        self._until = max(round(config.standing_horizon / config.sampling_time), 1)
        self.durations = np.repeat(
            [config.sampling_time, config.tail_sampling_time], [self._until, config.tail_intervals]
        )  # [s]
        self._cops = self._until if config.use_cop else 0
        self._trunks = self.durations.size if config.use_trunk else 0
        self._program, self._solver = self._build()
        self.packed = parts_table([self._program])  # addresses, good as long as this planner lives

    def __reduce__(self) -> tuple[Any, ...]:
        return StandingPlanner, (self.robot, self.limits, self.config)

    def _build(self) -> tuple[Program, LeastDistance]:
        config, cops, trunks = self.config, self._cops, self._trunks
        n = cops + trunks
        end, lean, rate = self._unrolled()
        H, f = np.diag(np.repeat([config.beta_cop, config.beta_trunk], [cops, trunks])), np.zeros((n, 3))
        weighted = (
            (config.beta_dcm, end), (config.beta_trunk_rate, rate), (config.beta_trunk_angle, lean)
        )  # fmt: skip
        for weight, rows in weighted:
            H += weight * rows[:, :n].T @ rows[:, :n]
            f += weight * rows[:, :n].T @ rows[:, n:]
        whitened = np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(H)).T, np.float64)
        block, edges = 2 * trunks, REACH * cops
        matrix = np.zeros((2 * block + edges, 2 * n))
        matrix[:block, :n] = matrix[block : 2 * block, n:] = np.vstack(
            [whitened[cops:], lean[:, :n] @ whitened]
        )
        matrix[2 * block :, :n] = np.tile(whitened[:cops], (REACH, 1))  # until a hull is known
        soft = np.tile(np.repeat([0.0, config.beta_trunk_limit], trunks), 2)
        solver = LeastDistance(matrix, np.concatenate([soft, np.zeros(edges)]))
        program = Program(
            numbers=self._numbers, feedback=np.asarray(-np.linalg.solve(H, f), np.float64),
            lean=np.delete(lean, n, axis=1), end=end[0, : n + 1].copy(),
            whitened=whitened, handle=solver.handle, matrix=solver.M,
            lower=solver.lower, upper=solver.upper, solution=solver.x, plan=np.zeros((2, n)),
            hull=np.zeros((HULL_ROWS, HULL_COLUMNS)),
        )  # fmt: skip
        return program, solver

    def _unrolled(self) -> tuple[Floats, Floats, Floats]:
        """What the inputs, then DCM, lean and rate of now lead to: rows of numbers per unit (.., n + 3).

        Returns:
            The DCM at the end, less what the braking tail moves it by; lean and rate after every interval.
        """
        omega, cops, trunks = self.robot.omega, self._cops, self._trunks
        n, ends = cops + trunks, np.cumsum(self.durations)
        horizon = ends[self._until - 1]
        effect = np.exp(omega * (horizon - ends)) * np.expm1(omega * self.durations)  # of a CMP so long
        if not self.config.trunk_debt:
            effect[self._until :] = 0.0
        end = np.zeros((1, n + 3))
        end[0, :cops], end[0, n] = -effect[:cops], math.exp(omega * horizon)
        end[0, cops:n] = -self.robot.cmp_per_trunk_acceleration * effect[:trunks]
        lean, rate = np.zeros((trunks, n + 3)), np.zeros((trunks, n + 3))
        for k in range(trunks):
            d = self.durations[: k + 1]
            lean[k, cops : cops + k + 1] = d * (ends[k] - ends[: k + 1] + 0.5 * d)
            rate[k, cops : cops + k + 1] = d
            lean[k, n + 1 :] = 1.0, ends[k]
            rate[k, n + 2] = 1.0
        return end, lean, rate

    def plan_batch(self, rows: Floats) -> Floats:
        """Plan n robots by DAQP in one compiled loop.

        Args:
            rows: (n, 9): centre of the other foot (2) [m] and its turn [rad], dcm (2) [m], trunk angle (2)
                [rad], trunk rate (2) [rad/s]; from the centre of the stance sole, in its axes.

        Returns:
            (n, 7): cop (2), trunk acceleration (2), predicted dcm at the end (2), index into `STATUS`.

        Raises:
            InvalidValueError: another shape, or not finite.
        """
        rows = problem.as_rows(rows, INPUTS)
        if not (fine := np.isfinite(rows).all(axis=1)).all():
            raise InvalidValueError(f"stage 2 of standing needs finite states, got {rows[~fine][0].tolist()}")
        out = np.zeros((len(rows), problem.RESULT_SIZE))
        plan_standing_rows(rows, out, self.packed)
        return out
