"""What a planning period was to n robots: recovered criterion, reward and end, in one compiled call.

Numba unpacks every array of a call, so the two dozen arrays come as one table of addresses.
"""

# to_fixed_tuple is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ...controllers.compiled.array_table import Floats1, Floats2, Ints1, part_of, parts_table
from ...controllers.compiled.kernels import njit
from ...controllers.model.frame import canonical, canonical_frame
from ...controllers.model.gait_box import DURATION, GAIT_SIZE, GaitLimits
from ...controllers.model.nominal_gait import NOMINAL_DURATION, NOMINAL_SIZE, nominal_gait_kernel
from ...controllers.model.observation import COMMAND
from ...controllers.model.robot import RobotModel
from .recovery import MonitorState, nominal_dcm_kernel, record_touchdown, started_dcm_kernel
from .reward import write_reward

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

_COMMAND = COMMAND.start


class Motion(NamedTuple):
    """How far n robots have come."""

    steps: Ints  # (n,) completed
    com: Array  # (n, 2) in the world [m]
    time: Array  # (n,) since reset [s]
    side: Ints  # (n,) stance foot, index into SIDES
    heading: Array  # (n,) of the canonical frame [rad]


class Robots(NamedTuple):
    """What the core says of n robots after a period; the first five are those of `Motion`."""

    steps: Ints1
    com: Floats2
    time: Floats1
    side: Ints1
    heading: Floats1
    failure: Ints1  # (n,) why they have fallen, 0: they have not
    observation: Floats2  # (n, 36), without noise
    margin: Floats1  # (n,) capture margin [m]
    command: Floats2  # (n, 3) in force: velocity in the heading frame [m/s], turn [rad/s]
    action: Floats2  # (n, 7) in force in the period
    push_start: Floats2  # (n, P) [s], inf while the gait event has not come
    push_duration: Floats2  # (n, P) [s]
    world: Floats2  # (n, 6) DCM, CoP and CMP in the world [m]


class Episodes(NamedTuple):
    """What the episodes of n robots know of themselves."""

    pushes: Ints1  # (n,) how many
    changed: Floats1  # (n,) when the command changes or a kick comes for the last time [s], 0: never
    fixed: Floats1  # (n,) length of the episode [s]; NaN: it ends `settle` after the last event
    settle: Floats1  # (n,) [s]
    uphill: Floats2  # (n, 2) what the slope moves the DCM by, world axes [m]
    before: Floats2  # (n, 7) action in force in the period before, written for the next one
    planned: Floats1  # (n,) step duration T that the last action asked for [s], written
    terms: Floats2  # (n, 7) of the reward, in the order of REWARD_TERMS, written
    total: Floats1  # (n,) reward, written


class PeriodConstants(NamedTuple):
    """What the nominal gait follows from, beside its box."""

    omega: float  # [1/s]
    pelvis_width: float  # l_p [m]
    delay: float  # of touchdown [s]
    double_support: float  # [s]


CONSTANTS = len(PeriodConstants._fields)


class Judged(NamedTuple):
    """Everything that `end_period` reads and writes."""

    robots: Robots
    episodes: Episodes
    monitor: MonitorState


def period_table(robots: Robots, episodes: Episodes, monitor: MonitorState) -> Ints:
    """Address table of all arrays, part by part; they must stay alive."""
    return parts_table(Judged(robots, episodes, monitor))


def period_constants(robot: RobotModel, limits: GaitLimits, delay: float, double_support: float) -> Array:
    """`PeriodConstants`, then the box of the gait variables: low, high."""
    constants = PeriodConstants(robot.omega, robot.pelvis_width, delay, double_support)
    return np.array([*constants, *limits.low, *limits.high], dtype=np.float64)


@njit(cache=True)
def last_push_end(robots, k, count):  # pragma: no cover
    """When the last of robot k's pushes ends [s]; 0 without pushes, inf while one is still to come."""
    last = 0.0 if count == 0 else -np.inf
    for i in range(count):
        last = max(last, robots.push_start[k, i] + robots.push_duration[k, i])
    return last


@njit(cache=True)
def end_period(t, c, gaits, ends):  # pragma: no cover
    """Judge n robots after a period under `gaits` (n, 7); writes `ends` (2, n): failed, out of time."""
    robots, episodes = part_of(t, Judged, "robots"), part_of(t, Judged, "episodes")
    monitor = part_of(t, Judged, "monitor")
    omega, width, delay, double_support = to_fixed_tuple(c[:CONSTANTS], CONSTANTS)
    low, high = c[CONSTANTS : CONSTANTS + GAIT_SIZE], c[CONSTANTS + GAIT_SIZE :]
    nominal, start, started, uphill = np.empty(NOMINAL_SIZE), np.empty(2), np.empty(2), np.empty(2)
    for k in range(ends.shape[1]):
        obs, time = robots.observation[k], robots.time[k]
        vx, vy = obs[_COMMAND], obs[_COMMAND + 1]
        nominal_gait_kernel(vx, vy, width, low, high, omega, delay, nominal, double_support)
        nominal_dcm_kernel(nominal, width, omega, delay, double_support, start)
        frame = canonical_frame(robots.heading[k], robots.side[k])
        uphill[0], uphill[1] = canonical(frame, episodes.uphill[k, 0], episodes.uphill[k, 1])
        started_dcm_kernel(obs, uphill, double_support, omega, started)
        event = max(last_push_end(robots, k, episodes.pushes[k]), episodes.changed[k])
        if robots.steps[k] != monitor.steps[k]:
            monitor.steps[k] = robots.steps[k]
            error = np.hypot(started[0] - start[0], started[1] - start[1])
            record_touchdown(
                monitor, k, error, robots.com[k], robots.heading[k], time, event, robots.command[k]
            )
        ends[0, k] = robots.failure[k] != 0
        end = event + episodes.settle[k] if np.isnan(episodes.fixed[k]) else episodes.fixed[k]
        ends[1, k] = time >= end - 1e-9 and not ends[0, k]
        episodes.planned[k] = gaits[k, DURATION]
        episodes.total[k] = write_reward(
            obs, episodes.before[k], episodes.planned[k], robots.margin[k], ends[0, k], started, start,
            nominal[NOMINAL_DURATION], episodes.terms[k],
        )  # fmt: skip
        episodes.before[k] = robots.action[k]
