"""The end of a planning period for n robots, in one compiled call: reward, recovered criterion, end, `info`.

A reward term is a function in `TERMS`, of one robot's `Moment` to a number; its name is that of the function.
Numba unpacks every array of a call, so the two dozen arrays come as one table of addresses.
"""

# part_of and to_fixed_tuple are intrinsics: their arguments are the signature's, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ...controllers.array_table import NO_STATE, Floats1, Floats2, Ints1, part_of
from ...controllers.jit import njit
from ...controllers.model import observation as layout
from ...controllers.model.gait_box import DURATION, GAIT_SIZE, GaitLimits
from ...controllers.model.nominal_gait import NOMINAL_DURATION, NOMINAL_SIZE, nominal_gait_kernel
from ...controllers.model.robot import RobotModel
from .recovery import MonitorState, nominal_dcm_kernel, record_standing, record_touchdown, started_dcm_kernel

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
_ANGLE, _RATE, _ACTION, _COMMAND = (
    part.start for part in (layout.TRUNK_ANGLE, layout.TRUNK_RATE, layout.PREVIOUS_ACTION, layout.COMMAND)
)
_DCM, _COM_VELOCITY, _SWING = (
    part.start for part in (layout.DCM, layout.COM_VELOCITY, layout.SWING_POSITION)
)


class Moment(NamedTuple):
    """One robot at the end of a planning period, as reward terms see it."""

    obs: Any  # (36,) observation without noise; its previous action is this period's
    before: Any  # (7,) action in force in the period before
    planned: float  # step duration T asked for [s]
    margin: float  # capture margin [m]
    failed: bool
    started: Any  # (2,) DCM at the start of the step [m]
    start: Any  # (2,) the nominal gait's [m]
    nominal_duration: float  # T_nom [s]


@njit(cache=True)
def alive(m):  # pragma: no cover
    """1 while standing."""
    return 0.0 if m.failed else 1.0


@njit(cache=True)
def fall(m):  # pragma: no cover
    """-50 once, at a fall."""
    return -50.0 if m.failed else 0.0


@njit(cache=True)
def dcm(m):  # pragma: no cover
    """exp(-|e|^2 / (0.1 m)^2), e the DCM's error against the nominal gait at the start of the step.

    In double support what the CoP's transfer will take off the DCM counts in both.
    """
    squared = (m.started[0] - m.start[0]) ** 2 + (m.started[1] - m.start[1]) ** 2
    return 0.0 if m.failed else math.exp(-squared / 0.01)


@njit(cache=True)
def margin(m):  # pragma: no cover
    """-1 at a capture margin of zero or below, 0 from 0.1 m on."""
    return -min(max(1.0 - m.margin / 0.1, 0.0), 1.0)


@njit(cache=True)
def duration(m):  # pragma: no cover
    """-0.5 ((T - T_nom) / T_nom)^2."""
    return -0.5 * (m.planned / m.nominal_duration - 1.0) ** 2


@njit(cache=True)
def trunk(m):  # pragma: no cover
    """-0.3 |lean|^2 - 0.01 |rate|^2, at least -2."""
    lean = m.obs[_ANGLE] ** 2 + m.obs[_ANGLE + 1] ** 2
    rate = m.obs[_RATE] ** 2 + m.obs[_RATE + 1] ** 2
    return max(-0.3 * lean - 0.01 * rate, -2.0)


@njit(cache=True)
def smoothness(m):  # pragma: no cover
    """-0.02 |a - a_before|^2."""
    total = 0.0
    for i in range(m.before.shape[0]):
        total += (m.obs[_ACTION + i] - m.before[i]) ** 2
    return -0.02 * total


TERMS = (alive, fall, dcm, margin, duration, trunk, smoothness)
REWARD_TERMS = tuple(term.__name__ for term in TERMS)


def _then(term: Any, later: Any) -> Any:
    """A compiled function that writes a term at `i` and then the later ones; part of what calls it."""

    @njit(cache=False)
    def write(moment, terms, i):  # pragma: no cover
        terms[i] = term(moment)
        later(moment, terms, i + 1)

    return write


@njit(cache=False)
def _write_terms(moment, terms, i):  # pragma: no cover
    """Write no term: the end of the chain."""


for _term in reversed(TERMS):
    _write_terms = _then(_term, _write_terms)


class Reward(NamedTuple):
    """Reward of one planning period for n robots."""

    total: Array  # (n,)
    terms: Array  # (n, terms) in the order of the episodes' `reward_terms`


class Motion(NamedTuple):
    """Progress of n robots."""

    steps: Ints  # (n,) completed
    com: Array  # (n, 2) in the world [m]
    time: Array  # (n,) since reset [s]
    side: Ints  # (n,) stance foot, index into SIDES
    heading: Array  # (n,) of the canonical frame [rad]


class Robots(NamedTuple):
    """State of n robots after a period, from the core; the first five are those of `Motion`."""

    steps: Ints1
    com: Floats2
    time: Floats1
    side: Ints1
    heading: Floats1
    failure: Ints1  # (n,) why they have fallen, 0: they have not
    observation: Floats2  # (n, 36), without noise
    margin: Floats1  # (n,) capture margin [m]
    command: Floats2  # (n, 4) in force: velocity in the heading frame [m/s], turn [rad/s], 1: stand
    action: Floats2  # (n, 7) in force in the period
    push_start: Floats2  # (n, P) [s], inf while the gait event has not come
    push_duration: Floats2  # (n, P) [s]
    world: Floats2  # (n, 6) DCM, CoP and CMP in the world [m]


class Episodes(NamedTuple):
    """State of the episodes of n robots."""

    pushes: Ints1  # (n,) how many
    changed: Floats1  # (n,) when the command changes or a kick comes for the last time [s], 0: never
    fixed: Floats1  # (n,) length of the episode [s]; NaN: it ends `settle` after the last event
    settle: Floats1  # (n,) [s]
    uphill: Floats2  # (n, 2) what the slope moves the DCM by, world axes [m]
    before: Floats2  # (n, 7) action in force in the period before, written for the next one
    planned: Floats1  # (n,) step duration T that the last action asked for [s], written
    event: Floats1  # (n,) end of the last push, or last change of the command if later [s], written
    terms: Floats2  # (n, 7) of the reward, in the order of REWARD_TERMS, written
    total: Floats1  # (n,) reward, written


class PeriodConstants(NamedTuple):
    """Constants of the nominal gait, beside its box."""

    omega: float  # [1/s]
    pelvis_width: float  # l_p [m]
    delay: float  # of touchdown [s]
    double_support: float  # [s]


CONSTANTS = len(PeriodConstants._fields)


class PeriodArrays(NamedTuple):
    """Everything that `end_period` reads and writes, which gets it as the `parts_table` of this."""

    robots: Annotated[Robots, NO_STATE]  # the core's
    episodes: Episodes
    monitor: MonitorState


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
    robots, episodes = part_of(t, PeriodArrays, "robots"), part_of(t, PeriodArrays, "episodes")
    monitor = part_of(t, PeriodArrays, "monitor")
    omega, width, delay, double_support = to_fixed_tuple(c[:CONSTANTS], CONSTANTS)
    low, high = c[CONSTANTS : CONSTANTS + GAIT_SIZE], c[CONSTANTS + GAIT_SIZE :]
    nominal, start, started, uphill = np.empty(NOMINAL_SIZE), np.empty(2), np.empty(2), np.empty(2)
    for k in range(ends.shape[1]):
        obs, time = robots.observation[k], robots.time[k]
        vx, vy = obs[_COMMAND], obs[_COMMAND + 1]
        nominal_gait_kernel(vx, vy, width, low, high, omega, delay, nominal, double_support)
        nominal_dcm_kernel(nominal, width, omega, delay, double_support, start)
        frame = layout.canonical_frame(robots.heading[k], robots.side[k])
        uphill[0], uphill[1] = layout.canonical(frame, episodes.uphill[k, 0], episodes.uphill[k, 1])
        started_dcm_kernel(obs, uphill, double_support, omega, started)
        event = max(last_push_end(robots, k, episodes.pushes[k]), episodes.changed[k])
        episodes.event[k] = event
        if obs[layout.ELAPSED] < 0.0:
            monitor.steps[k] = robots.steps[k]
            for axis in range(2):
                started[axis], start[axis] = obs[_DCM + axis] - uphill[axis], 0.5 * obs[_SWING + axis]
            error = np.hypot(started[0] - start[0], started[1] - start[1])
            speed = np.hypot(obs[_COM_VELOCITY], obs[_COM_VELOCITY + 1])
            record_standing(monitor, k, error, speed, time, event)
        elif robots.steps[k] != monitor.steps[k]:
            monitor.steps[k] = robots.steps[k]
            error = np.hypot(started[0] - start[0], started[1] - start[1])
            record_touchdown(
                monitor, k, error, robots.com[k], robots.heading[k], time, event, robots.command[k]
            )
        ends[0, k] = robots.failure[k] != 0
        end = event + episodes.settle[k] if np.isnan(episodes.fixed[k]) else episodes.fixed[k]
        ends[1, k] = time >= end - 1e-9 and not ends[0, k]
        episodes.planned[k] = gaits[k, DURATION]
        moment = Moment(
            obs, episodes.before[k], episodes.planned[k], robots.margin[k], ends[0, k], started, start,
            nominal[NOMINAL_DURATION],
        )  # fmt: skip
        _write_terms(moment, episodes.terms[k], 0)
        episodes.total[k] = 0.0
        for i in range(episodes.terms.shape[1]):
            episodes.total[k] += episodes.terms[k, i]
        episodes.before[k] = robots.action[k]


# Columns of the numbers for `info`
TIME, MARGIN, PHASE = 0, 1, 2  # since reset [s], capture margin [m], share of the step that is over
SIDE, FAILURE = 3, 4  # indices into SIDES and into the reasons of a fall
RECOVERED_AT = 5  # [s], NaN: it has not
PUSH, PUSH_START = 6, 7  # index of `latest_push`, and its start [s], NaN while its gait event has not come
DCM, COP, CMP = slice(8, 10), slice(10, 12), slice(12, 14)  # in the world [m]
LOADED = slice(14, 16)  # whether the left and the right foot carry load
COLUMNS = 16

_POINTS, _LOADED = DCM.start, LOADED.start


@njit(cache=True)
def write_info(t, rows):  # pragma: no cover
    """Write the numbers of the moment, (n, COLUMNS), from the table of `PeriodArrays`."""
    robots, episodes = part_of(t, PeriodArrays, "robots"), part_of(t, PeriodArrays, "episodes")
    monitor = part_of(t, PeriodArrays, "monitor")
    for k in range(rows.shape[0]):
        row, obs, time, side = rows[k], robots.observation[k], robots.time[k], robots.side[k]
        row[TIME], row[MARGIN] = time, robots.margin[k]
        row[PHASE] = max(min(obs[layout.ELAPSED] / episodes.planned[k], 1.0), 0.0)
        row[SIDE], row[FAILURE] = side, robots.failure[k]
        row[RECOVERED_AT] = monitor.recovered_at[k]
        row[PUSH] = push = latest_push(robots.push_start[k], episodes.pushes[k], time)
        begun = push >= 0 and robots.push_start[k, push] < np.inf
        row[PUSH_START] = robots.push_start[k, push] if begun else np.nan
        for i in range(robots.world.shape[1]):
            row[_POINTS + i] = robots.world[k, i]
        row[_LOADED + side], row[_LOADED + 1 - side] = obs[layout.STANCE_CONTACT], obs[layout.SWING_CONTACT]


@njit(cache=True)
def latest_push(starts, count, time):  # pragma: no cover
    """Index of the latest push that has begun, otherwise of the first; -1 without pushes.

    Of two that began together it is the first.

    Args:
        starts: (P,) [s], inf while the gait event has not come.
        count: how many of them are the robot's.
        time: now [s].
    """
    if count == 0:
        return -1
    latest = -1
    for i in range(count):
        if starts[i] < time and (latest < 0 or starts[i] > starts[latest]):
            latest = i
    return max(latest, 0)
