"""The command changes of n robots as arrays, and the command in force."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.array_table import Floats2, Floats3, Ints1
from ...controllers.compiled.kernels import njit
from .scenario import Scenario

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

DUE = 1e-9  # a change this soon after the period begins is due: times are sums of steps [s]


class Schedule(NamedTuple):
    """What the n robots will be told, at most C changes each."""

    time: Floats2  # (n, C) since reset [s], rising; inf: there are no more
    command: Floats3  # (n, C, 3) velocity in the heading frame [m/s], turn [rad/s]
    next: Ints1  # (n,) index of the first change to come


def empty_schedule(n: int, count: int = 0) -> Schedule:
    """Arrays of `count` changes for n robots, none of which ever comes."""
    return Schedule(np.full((n, count), np.inf), np.zeros((n, count, 3)), np.zeros(n, np.int64))


def assign_changes(schedule: Schedule, k: int, scenario: Scenario) -> Schedule:
    """Give robot k the changes of a scenario, in place; returns larger arrays where they do not fit."""
    n, capacity = schedule.time.shape
    count = len(scenario.changes)
    if count > capacity:
        grown = empty_schedule(n, count)
        grown.time[:, :capacity], grown.command[:, :capacity] = schedule.time, schedule.command
        grown.next[:] = schedule.next
        schedule = grown
    schedule.time[k], schedule.next[k] = np.inf, 0
    for i, change in enumerate(scenario.changes):
        schedule.time[k, i] = change.time
        command = change.command
        schedule.command[k, i] = command.vx, command.vy, command.turn
    return schedule


@njit(cache=True)
def follow(schedule, k, now, command):  # pragma: no cover
    """Put the latest command (3,) that is due `now` [s] into force for robot k."""
    i = schedule.next[k]
    while i < schedule.time.shape[1] and schedule.time[k, i] <= now + DUE:
        for axis in range(command.shape[0]):
            command[axis] = schedule.command[k, i, axis]
        i += 1
    schedule.next[k] = i


@njit(cache=True)
def follow_all(schedule, now, command, first, end):  # pragma: no cover
    """`follow` for robots first..end-1: now (n,) [s], command (n, 3)."""
    for k in range(first, end):
        follow(schedule, k, now[k], command[k])
