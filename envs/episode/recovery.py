"""Has the robot recovered? Gait statistics at every touchdown, for n robots.

A step counts as good where the DCM at its start lies within OFFSET_TOLERANCE of the nominal gait's; what the
CoP's transfer in double support will take off it, p kappa, counts in both. On a slope the nominal gait is the
slope's own: gravity along the floor acts like a CoP h tan(slope) further uphill, and moves the DCM there.
Recovered means: after the last push and the last change of command two good steps in a row, over which the
mean velocity is within SPEED_TOLERANCE of the command. It is judged anew at each touchdown, and taken back
where it no longer holds. A robot that stands has recovered while its DCM is within OFFSET_TOLERANCE of the
middle between its feet and its CoM slower than SPEED_TOLERANCE, as long as it stays so.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.array_table import Floats1, Floats2, Floats3, Ints1
from ...controllers.jit import njit
from ...controllers.model.nominal_gait import drifting_dcm_kernel, step_start_dcm_kernel, transfer_weight
from ...controllers.model.observation import DCM, ELAPSED, SWING_POSITION, canonical, heading_frame

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

OFFSET_TOLERANCE = 0.05  # [m]
SPEED_TOLERANCE = 0.15  # [m/s]

_DCM, _SWING = DCM.start, SWING_POSITION.start


class MonitorState(NamedTuple):
    """Gait statistics of n robots; the three latest touchdowns, newest first."""

    steps: Ints1  # (n,) completed when last looked at
    touchdowns: Ints1  # (n,) since reset
    time: Floats2  # (n, 3) [s]
    com: Floats3  # (n, 3, 2) in the world [m]
    error: Floats2  # (n, 3) of the DCM against the nominal gait [m]
    speed_error: Floats1  # (n,) over the last two steps [m/s]
    recovered_at: Floats1  # (n,) [s], NaN while not recovered
    heading: Floats2  # (n, 3) of the steps that began then [rad]


@njit(cache=True)
def nominal_dcm_kernel(nominal, width, omega, delay, double_support, out):  # pragma: no cover
    """Write the DCM (2,) that a step of a nominal gait (5,) starts with, less its transfer to come [m]."""
    if double_support > 0.0:
        out[0], out[1] = drifting_dcm_kernel(nominal, omega, delay)
    else:
        out[0], out[1] = step_start_dcm_kernel(nominal, width, omega, delay, double_support)


def uphill_dcm(com_height: float, slope_forward: float, slope_left: float) -> tuple[float, float]:
    """How far a slope moves the DCM of a gait: h tan(slope), world axes [m].

    x'' = omega^2 (x - p) - g tan(slope) = omega^2 (x - (p + h tan(slope))) with omega^2 = g / h.
    """
    return com_height * math.tan(slope_forward), com_height * math.tan(slope_left)


@njit(cache=True)
def started_dcm_kernel(obs, uphill, double_support, omega, out):  # pragma: no cover
    """Trace the DCM (2,) of an observation (36,), less the transfer to come, back to the step's start.

    The slope's shift `uphill` (2,), canonical frame [m], is left out.
    """
    back, shift = math.exp(-omega * obs[ELAPSED]), transfer_weight(obs[ELAPSED], double_support, omega)
    for axis in range(2):
        out[axis] = (obs[_DCM + axis] - uphill[axis]) * back
        if shift > 0.0:
            out[axis] -= shift * obs[_SWING + axis] * back


@njit(cache=True)
def record_touchdown(state, k, error, com, heading, time, event, command):  # pragma: no cover
    """Judge robot k, which has just touched down.

    Args:
        state: of n robots, written.
        k: the robot.
        error: of the DCM at the start of the step against the nominal gait [m].
        com: (2,) in the world [m].
        heading: of the step that begins [rad].
        time: since reset [s].
        event: when the last push has ended and the command has changed for the last time [s], inf while a
            push waits for its gait event.
        command: in force (4,), its velocity in the heading frame [m/s].
    """
    for i in range(2, 0, -1):
        state.time[k, i], state.error[k, i] = state.time[k, i - 1], state.error[k, i - 1]
        state.com[k, i], state.heading[k, i] = state.com[k, i - 1], state.heading[k, i - 1]
    state.time[k, 0], state.error[k, 0] = time, error
    state.com[k, 0], state.heading[k, 0] = com, heading
    state.touchdowns[k] += 1
    good = False
    if state.touchdowns[k] >= 3:
        span = state.time[k, 0] - state.time[k, 2]
        dx = (state.com[k, 0, 0] - state.com[k, 2, 0]) / span
        dy = (state.com[k, 0, 1] - state.com[k, 2, 1]) / span
        mean = 0.5 * (state.heading[k, 1] + state.heading[k, 2])  # of the two steps that are over
        vx, vy = canonical(heading_frame(mean), dx, dy)
        state.speed_error[k] = math.hypot(vx - command[0], vy - command[1])
        good = (
            state.time[k, 1] >= event
            and max(state.error[k, 0], state.error[k, 1]) <= OFFSET_TOLERANCE
            and state.speed_error[k] <= SPEED_TOLERANCE
        )
    judge(state, k, good, time)


@njit(cache=True)
def record_standing(state, k, error, speed, time, event):  # pragma: no cover
    """Judge robot k, which stands: good where DCM and CoM are nearly at rest after the last event.

    Args:
        state: of n robots, written.
        k: the robot.
        error: of the DCM against the middle between the feet [m].
        speed: of the CoM [m/s].
        time: since reset [s].
        event: as for `record_touchdown`.
    """
    good = time >= event and error <= OFFSET_TOLERANCE and speed <= SPEED_TOLERANCE
    judge(state, k, good, time)


@njit(cache=True)
def judge(state, k, good, time):  # pragma: no cover
    """Robot k has recovered since the first of the good moments that go on until now [s]."""
    if not good:
        state.recovered_at[k] = np.nan
    elif math.isnan(state.recovered_at[k]):
        state.recovered_at[k] = time


class GaitMonitor:
    """Gait statistics of n robots, which the compiled end of a period (`period_end`) writes."""

    def __init__(self, n: int):
        self.state = MonitorState(
            np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3)), np.zeros((n, 3, 2)),
            np.zeros((n, 3)), np.zeros(n), np.full(n, np.nan), np.zeros((n, 3)),
        )  # fmt: skip

    def reset(self, k: int) -> None:
        """Forget robot k, which stands at the start of step 0."""
        for field in self.state:
            field[k] = 0
        self.state.recovered_at[k] = np.nan

    def recovered_at(self, k: int) -> float | None:
        """When robot k recovered for good, as far as is known [s]; None where it has not."""
        value = self.state.recovered_at.item(k)
        return None if math.isnan(value) else value
