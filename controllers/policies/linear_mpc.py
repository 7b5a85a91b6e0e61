"""Linear model predictive control with automatic footstep placement (Herdt et al.), steps of a fixed time.

Herdt, Diedam, Wieber, Dimitrov, Mombaur, Diehl (Advanced Robotics 24, 2010): jerks of the CoM and the next
two footsteps from one quadratic program with the CoP in the feet and the feet in the step box. Here they are
deviations from the nominal gait at the same moment, so that the nominal gait is kept where it can be:

    min  sum_k d_k (|z_k - p_k|^2 + w_velocity |c'_k|^2) + w_jerk sum_i d_i |c'''_i|^2
         + w_step (|u_1|^2 + |u_2|^2)
    s.t. |z_k - p_k| <= sole - margin,    u_min <= u_nom + u_i <= u_max

over the nodes k and intervals i of the horizon, d seconds each, p_k the foot of a node's step. All feet point
along the heading, so the axes do not couple and each is one program.

Along one axis, with c = x, v = x' / omega, a = x'' / omega^2, j = x''' / omega^3 [m] and s = omega d for an
interval of d seconds, the cart-table model with a constant jerk is exactly (Wieber 2006, eq. 5)

    c + v s + a s^2 / 2 + j s^3 / 6,    v + a s + j s^2 / 2,    a + j s,        z = c - a (the CoP).

Each step has SAMPLES equal intervals. The new foot takes over at once, so a is free anew at each touchdown,
as it is now: a robot can put its CoP anywhere in the sole at any time. A quantity is a row of coefficients of
the columns below; the matrices are the same for both axes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidValueError, PushRecoveryError
from ..jit import njit
from ..model.gait_box import COP, STEP, GaitLimits
from ..model.nominal_gait import NOMINAL_DURATION, NOMINAL_STEP
from ..model.observation import COM
from ..model.robot import RobotModel
from ..qp import QuadraticProgram, solve_qp
from ..settings import PlannerConfig
from ..stage_1 import DCM_AHEAD, DCM_END, HELD, NOMINAL, NOMINAL_OFFSET, OFFSET, REMAINING, STATUS, TARGET
from ..stage_2.problem import SOLVED, cop_bounds

STEPS = 3  # this one, and the two whose feet are placed
SAMPLES = 4  # intervals of a step
NODES = STEPS * (SAMPLES + 1)  # beginning and ends of the intervals of each step

# Columns
ACCELERATION = 0  # a at the beginning of each step
JERK = ACCELERATION + STEPS  # j of each interval
FOOT = JERK + STEPS * SAMPLES  # first and second footstep, each from the foot before
UNKNOWNS = FOOT + STEPS - 1
POSITION, RATE = UNKNOWNS, UNKNOWNS + 1  # c and v now
COLUMNS = RATE + 1


@njit(cache=True)
def predict(remaining, period, omega, cop, rate, spans):  # pragma: no cover
    """Write the nodes of the horizon: `remaining` until the next touchdown, then steps of a period [s].

    `cop` (NODES, COLUMNS) is the CoP less the centre of the foot that it is in and `rate` (NODES, COLUMNS) v
    [m]; `spans` (NODES,) the time that each node stands for, half of the intervals beside it [s].
    """
    c, v, a, foot = np.zeros(COLUMNS), np.zeros(COLUMNS), np.zeros(COLUMNS), np.zeros(COLUMNS)
    c[POSITION], v[RATE] = 1.0, 1.0
    node = 0
    spans[:] = 0.0
    for step in range(STEPS):
        span = (remaining if step == 0 else period) / SAMPLES
        s = omega * span
        a[:] = 0.0
        a[ACCELERATION + step] = 1.0
        if step > 0:
            foot[FOOT + step - 1] = 1.0
        cop[node], rate[node] = c - a - foot, v
        for interval in range(SAMPLES):
            jerk = JERK + step * SAMPLES + interval
            c += v * s + a * (0.5 * s * s)
            v += a * s
            c[jerk], v[jerk], a[jerk] = s**3 / 6.0, 0.5 * s * s, s
            spans[node] += 0.5 * span
            node += 1
            spans[node] += 0.5 * span
            cop[node], rate[node] = c - a - foot, v
        node += 1


Floats = NDArray[np.float64]


class Horizon(NamedTuple):
    """Cost and rows that the programs of both axes have in common."""

    H: Floats  # (UNKNOWNS, UNKNOWNS) cost
    F: Floats  # (UNKNOWNS, 2) linear cost by c and v now
    A: Floats  # rows: CoP at the nodes, both footsteps
    cop_now: Floats  # (NODES, 2) what c and v now give to the CoP rows


class LinearMpc:
    """Place of the next step and CoP of observations whose rows stage 1 has filled in by the capture point.

    Raises:
        InvalidValueError: margins that leave no sole, or double support, which it does not plan.
    """

    workers, decides = 1 << 16, True

    def __init__(self, robot: RobotModel, limits: GaitLimits, config: PlannerConfig):
        if config.double_support > 0:
            raise InvalidValueError(
                f"linear MPC plans no double support, got {config.double_support} s; set double_support to 0"
            )
        self._omega, self._pelvis_width, self._config = robot.omega, robot.pelvis_width, config
        self._limits, self._sole = limits, cop_bounds(limits, config)

    def regulate(self, observations: Floats, rows: Floats, worker: int = 0) -> None:
        """Replace place, CoP and what follows from them in rows (n, ROW_SIZE); see `Regulator`.

        Raises:
            PushRecoveryError: the solver fails, which no observation in bounds should bring about.
        """
        for obs, row in zip(observations, rows, strict=True):
            horizon = self.horizon(float(row[REMAINING]), self._period(row))
            for axis in range(2):
                self._write(obs, row, axis, horizon)
            row[STATUS] = SOLVED

    def horizon(self, remaining: float, period: float) -> Horizon:
        """Cost and rows of the program, for the times until the next touchdown and between later ones [s]."""
        config, omega = self._config, self._omega
        remaining = max(remaining, config.first_interval_min)
        cop, rate, spans = np.empty((NODES, COLUMNS)), np.empty((NODES, COLUMNS)), np.empty(NODES)
        predict(remaining, period, omega, cop, rate, spans)
        cost = 2.0 * ((rate.T * (config.mpc_velocity * omega**2 * spans)) @ rate + (cop.T * spans) @ cop)
        lengths = np.repeat([remaining, *[period] * (STEPS - 1)], SAMPLES) / SAMPLES
        jerks = np.arange(JERK, FOOT)
        cost[jerks, jerks] += 2.0 * config.mpc_jerk * omega**6 * lengths
        feet = np.arange(FOOT, UNKNOWNS)
        cost[feet, feet] += 2.0 * config.mpc_step
        rows = np.zeros((NODES + STEPS - 1, UNKNOWNS))
        rows[:NODES] = cop[:, :UNKNOWNS]
        rows[np.arange(NODES, NODES + STEPS - 1), feet] = 1.0
        return Horizon(cost[:UNKNOWNS, :UNKNOWNS], cost[:UNKNOWNS, POSITION:], rows, cop[:, POSITION:])

    def program(self, obs: Floats, row: Floats, axis: int, horizon: Horizon) -> QuadraticProgram:
        """The program of one axis."""
        now = self._deviation(obs, row, axis)
        low, high = self._step_bounds(row, axis)
        shift = horizon.cop_now @ now
        sole = np.full(NODES, self._sole[axis])
        return QuadraticProgram(
            H=horizon.H,
            f=horizon.F @ now,
            A=horizon.A,
            lower=np.concatenate([-sole - shift, low]),
            upper=np.concatenate([sole - shift, high]),
            soft_weight=np.zeros(len(horizon.A)),
        )

    def _write(self, obs: Floats, row: Floats, axis: int, horizon: Horizon) -> None:
        """Solve the program of one axis and put its solution into the row."""
        solution = solve_qp(self.program(obs, row, axis, horizon), self._config.solver)
        if solution.status != "solved":
            raise PushRecoveryError(f"linear MPC: the program of axis {axis} is {solution.status}")
        position = self._deviation(obs, row, axis)[0]
        row[COP + axis] = position - solution.x[ACCELERATION]
        if not row[HELD]:
            row[STEP + axis] = row[NOMINAL + NOMINAL_STEP + axis] + solution.x[FOOT]
        row[TARGET + axis] = row[STEP + axis] + row[NOMINAL_OFFSET + axis]
        growth = math.exp(self._omega * row[REMAINING])
        row[DCM_END + axis] = row[COP + axis] + (row[DCM_AHEAD + axis] - row[COP + axis]) * growth
        row[OFFSET + axis] = row[DCM_END + axis] - row[STEP + axis]

    def _period(self, row: Floats) -> float:
        """From touchdown to touchdown of the nominal gait [s]."""
        return float(row[NOMINAL + NOMINAL_DURATION]) + self._config.touchdown_delay

    def _deviation(self, obs: Floats, row: Floats, axis: int) -> Floats:
        """The horizon's c and v now, less those of the nominal gait at the same time before touchdown [m].

        The nominal gait has xi = c + v and zeta = c - v, of which xi grows and zeta decays; it is periodic
        over two steps, the second one mirrored. With q = exp(-omega P) a step of length L begins with
        zeta_x = -L / (1 - q), one of width l_p + sway with zeta_y = l_p / (1 + q) - sway / (1 - q).
        """
        period, remaining = self._period(row), float(row[REMAINING])
        q = math.exp(-self._omega * period)
        step = float(row[NOMINAL + NOMINAL_STEP + axis])
        width = self._pelvis_width if axis else 0.0
        began = width / (1.0 + q) - (step - width) / (1.0 - q)
        zeta = began * math.exp(-self._omega * (period - remaining))
        xi = (step + row[NOMINAL_OFFSET + axis]) * math.exp(-self._omega * remaining)
        com, dcm = obs[COM][axis], row[DCM_AHEAD + axis]
        return np.array([com - 0.5 * (xi + zeta), dcm - com - 0.5 * (xi - zeta)])

    def _step_bounds(self, row: Floats, axis: int) -> tuple[Floats, Floats]:
        """Bounds of the two footsteps' deviations, (2,) each [m]; a step that is held has none to choose.

        The second step is mirrored: seen from here it goes the other way, and its nominal width is
        2 l_p - W.
        """
        low, high = self._limits.low[STEP + axis], self._limits.high[STEP + axis]
        step = row[NOMINAL + NOMINAL_STEP + axis]
        first = (low - step, high - step)
        second = first
        if axis:
            other = 2.0 * self._pelvis_width - step
            second = other - high, other - low
        if row[HELD]:
            first = (row[STEP + axis] - step,) * 2
        return np.array([first[0], second[0]]), np.array([first[1], second[1]])
