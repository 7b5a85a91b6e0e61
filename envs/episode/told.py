"""What `info` tells of n robots in numbers: a row a robot, written in one compiled call."""

# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

import numpy as np

from ...controllers.compiled.array_table import part_of
from ...controllers.compiled.kernels import njit
from ...controllers.model.observation import ELAPSED, STANCE_CONTACT, SWING_CONTACT
from .period_end import Array, Ints, Judged

TIME, MARGIN, PHASE = 0, 1, 2  # since reset [s], capture margin [m], share of the step that is over
SIDE, FAILURE = 3, 4  # indices into SIDES and into the reasons of a fall
RECOVERED_AT = 5  # [s], NaN: it has not
PUSH, PUSH_START = 6, 7  # index of `told_push`, and its start [s], NaN while its gait event has not come
DCM, COP, CMP = slice(8, 10), slice(10, 12), slice(12, 14)  # in the world [m]
LOADED = slice(14, 16)  # whether the left and the right foot carry load
COLUMNS = 16

_POINTS, _LOADED = DCM.start, LOADED.start


def tell(table: Ints, n: int) -> Array:
    """Rows (n, COLUMNS) of the moment, from an address table of `period_table`."""
    told = np.empty((n, COLUMNS))
    _write(table, told)
    return told


@njit(cache=True)
def _write(t, told):  # pragma: no cover
    robots, episodes = part_of(t, Judged, "robots"), part_of(t, Judged, "episodes")
    monitor = part_of(t, Judged, "monitor")
    for k in range(told.shape[0]):
        row, obs, time, side = told[k], robots.observation[k], robots.time[k], robots.side[k]
        row[TIME], row[MARGIN] = time, robots.margin[k]
        row[PHASE] = min(obs[ELAPSED] / episodes.planned[k], 1.0)
        row[SIDE], row[FAILURE] = side, robots.failure[k]
        row[RECOVERED_AT] = monitor.recovered_at[k]
        row[PUSH] = push = told_push(robots.push_start[k], episodes.pushes[k], time)
        come = push >= 0 and robots.push_start[k, push] < np.inf
        row[PUSH_START] = robots.push_start[k, push] if come else np.nan
        for i in range(robots.world.shape[1]):
            row[_POINTS + i] = robots.world[k, i]
        row[_LOADED + side], row[_LOADED + 1 - side] = obs[STANCE_CONTACT], obs[SWING_CONTACT]


@njit(cache=True)
def told_push(starts, count, time):  # pragma: no cover
    """The push to tell of: the latest that has begun, otherwise the first; -1 without pushes.

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
