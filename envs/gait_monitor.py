"""Has the robot recovered? Gait statistics at every touchdown, for n robots.

A step counts as good where the DCM at its start lies within OFFSET_TOLERANCE of the nominal gait's; what the
CoP's transfer in double support will take off it, p kappa, counts in both.
Recovered means: after the last push two good steps in a row, over which the mean velocity is within
SPEED_TOLERANCE of the command. It is judged anew at each touchdown, and taken back where it no longer holds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..controllers.double_support import transfer_weight
from ..controllers.limits import GaitLimits
from ..controllers.nominal_gait import nominal_gait_kernel
from ..controllers.observation import COMMAND, DCM, ELAPSED, SWING_POSITION
from ..controllers.robot import RobotModel

Array = NDArray[np.float64]

OFFSET_TOLERANCE = 0.05  # [m]
SPEED_TOLERANCE = 0.15  # [m/s]

_DCM, _COMMAND, _SWING = DCM.start, COMMAND.start, SWING_POSITION.start


class MonitorState(NamedTuple):
    """What is remembered of n robots; the three latest touchdowns, newest first."""

    touchdowns: NDArray[np.int64]  # (n,) since reset
    time: Array  # (n, 3) [s]
    com: Array  # (n, 3, 2) in the heading frame [m]
    error: Array  # (n, 3) of the DCM against the nominal gait [m]
    speed_error: Array  # (n,) over the last two steps [m/s]
    recovered_at: Array  # (n,) [s], NaN while not recovered


@njit(cache=True)
def nominal_dcm_kernel(
    velocity_x, velocity_y, width, low, high, omega, delay, double_support, out
):  # pragma: no cover
    """Write the DCM at the start of a nominal step (2,) [m], canonical frame, and return nothing.

    With double support less its transfer: (u_T + b_nom) / lambda.
    """
    nominal = np.empty(5)
    nominal_gait_kernel(velocity_x, velocity_y, width, low, high, omega, delay, nominal, double_support)
    if double_support > 0.0:
        decay = math.exp(-omega * nominal[2])
        out[0], out[1] = (nominal[0] + nominal[3]) * decay, (nominal[1] + nominal[4]) * decay
        return
    growth = math.exp(omega * (nominal[2] + delay))
    out[0] = nominal[3]
    out[1] = (nominal[1] - width) / (growth - 1.0) + width / (growth + 1.0)


@njit(cache=True)
def started_dcm_kernel(obs, double_support, omega, out):  # pragma: no cover
    """Trace the DCM (2,) of an observation (36,), less the transfer to come, back to the step's start."""
    back, shift = math.exp(-omega * obs[ELAPSED]), transfer_weight(obs[ELAPSED], double_support, omega)
    for axis in range(2):
        out[axis] = obs[_DCM + axis] * back
        if shift > 0.0:
            out[axis] -= shift * obs[_SWING + axis] * back


@njit(cache=True)
def _record(state, k, obs, com, time, push_end, command, start, omega, double_support):  # pragma: no cover
    """One touchdown of robot k; the DCM is traced back to the moment of touchdown."""
    for i in range(2, 0, -1):
        state.time[k, i] = state.time[k, i - 1]
        state.error[k, i] = state.error[k, i - 1]
        state.com[k, i] = state.com[k, i - 1]
    here = np.empty(2)
    started_dcm_kernel(obs, double_support, omega, here)
    state.time[k, 0] = time
    state.com[k, 0] = com
    state.error[k, 0] = math.hypot(here[0] - start[0], here[1] - start[1])
    state.touchdowns[k] += 1
    good = False
    if state.touchdowns[k] >= 3:
        span = state.time[k, 0] - state.time[k, 2]
        vx = (state.com[k, 0, 0] - state.com[k, 2, 0]) / span
        vy = (state.com[k, 0, 1] - state.com[k, 2, 1]) / span
        state.speed_error[k] = math.hypot(vx - command[0], vy - command[1])
        good = (
            state.time[k, 1] >= push_end
            and max(state.error[k, 0], state.error[k, 1]) <= OFFSET_TOLERANCE
            and state.speed_error[k] <= SPEED_TOLERANCE
        )
    if not good:
        state.recovered_at[k] = np.nan
    elif math.isnan(state.recovered_at[k]):
        state.recovered_at[k] = time


@njit(cache=True)
def _update(
    state, steps, previous, obs, com, time, push_end, command, constants, low, high
):  # pragma: no cover
    start = np.empty(2)
    for k in range(steps.shape[0]):
        if steps[k] == previous[k]:
            continue
        previous[k] = steps[k]
        o = obs[k]
        nominal_dcm_kernel(
            o[_COMMAND], o[_COMMAND + 1], constants[1], low, high, constants[0], constants[2], constants[3],
            start,
        )  # fmt: skip
        _record(state, k, o, com[k], time[k], push_end[k], command[k], start, constants[0], constants[3])


class GaitMonitor:
    """Watches n robots; call `update` once per control cycle."""

    def __init__(
        self,
        n: int,
        robot: RobotModel,
        limits: GaitLimits,
        touchdown_delay: float = 0.0,
        double_support: float = 0.0,
    ):
        self.state = MonitorState(
            np.zeros(n, np.int64), np.zeros((n, 3)), np.zeros((n, 3, 2)), np.zeros((n, 3)), np.zeros(n),
            np.full(n, np.nan),
        )  # fmt: skip
        self._steps = np.zeros(n, np.int64)
        self._constants = np.array([robot.omega, robot.pelvis_width, touchdown_delay, double_support])
        self._low, self._high = limits.low, limits.high

    def reset(self, k: int) -> None:
        """Forget robot k, which stands at the start of step 0."""
        for field in self.state:
            field[k] = 0
        self.state.recovered_at[k] = np.nan
        self._steps[k] = 0

    def update(
        self,
        steps: NDArray[np.int64],
        observations: Array,
        com: Array,
        time: Array,
        push_end: Array,
        command: Array,
    ) -> None:
        """Judge the robots that have touched down since the last call.

        Args:
            steps: (n,) completed steps.
            observations: (n, 36).
            com: (n, 2) horizontal, in a frame fixed to the commanded heading [m].
            time: (n,) since reset [s].
            push_end: (n,) when the last push ends [s], inf while one is still to come.
            command: (n, 2) commanded velocity in the same frame [m/s].
        """
        _update(
            self.state, steps, self._steps, observations, com, time, push_end, command, self._constants,
            self._low, self._high,
        )  # fmt: skip

    def recovered_at(self, k: int) -> float | None:
        """When robot k recovered for good, as far as is known [s]; None where it has not."""
        value = float(self.state.recovered_at[k])
        return None if math.isnan(value) else value
