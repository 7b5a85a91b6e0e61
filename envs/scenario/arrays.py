"""Pushes and command changes of n robots as arrays for compiled loops.

The command changes of n robots as arrays, and the command in force.

The pushes of n robots as arrays for compiled loops, and what each has delivered.

A kick has a row after those of the pushes, without a force: what counts from the first push on, as limits met
do, counts from it on.

When a push starts, and the exact share of its force in any interval; compiled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.array_table import Floats2, Floats3, Ints1, Ints2
from ...controllers.jit import njit
from ...controllers.model.observation import heading_frame, in_world
from .push import BODIES, FRAMES, PENDING, GaitEvent, Push, Side
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


MARK = 1e-3  # duration of a kick's row [s]
NUMBERS = {name: number for number, name in enumerate(BODIES)}


class PushArrays(NamedTuple):
    """The pushes of one scenario as arrays for compiled loops; P pushes."""

    force: NDArray[np.float64]  # (P, 3) [N]; the env writes here where it turns one into the world
    duration: NDArray[np.float64]  # (P,) [s]
    start: NDArray[np.float64]  # (P,) [s], PENDING until the gait event has come; the env writes here
    step: NDArray[np.int64]  # (P,) index of the event's step, -1 for a push at a time
    fraction: NDArray[np.float64]  # (P,) of the planned step duration
    body: NDArray[np.int64]  # (P,) number of the body, at first those of BODIES
    offset: NDArray[np.float64]  # (P, 3) [m]
    frame: NDArray[np.int64]  # (P,) of the force, index into FRAMES; the env writes here


def push_arrays(pushes: Sequence[Push], first_side: Side, bodies: Mapping[str, int] = NUMBERS) -> PushArrays:
    """Arrays of the pushes for an episode; a fresh copy each time.

    Args:
        pushes: of the episode.
        first_side: that its step 0 stands on.
        bodies: number of each body that is pushed, by name.
    """
    events = [push.start if isinstance(push.start, GaitEvent) else None for push in pushes]
    times = [PENDING if isinstance(push.start, GaitEvent) else push.start for push in pushes]
    return PushArrays(
        force=np.array([push.force for push in pushes], dtype=np.float64).reshape(-1, 3),
        duration=np.array([push.duration for push in pushes], dtype=np.float64),
        start=np.array(times, dtype=np.float64),
        step=np.array([-1 if e is None else e.step_index(first_side) for e in events], dtype=np.int64),
        fraction=np.array([0.0 if e is None else e.fraction for e in events], dtype=np.float64),
        body=np.array([bodies[push.body] for push in pushes], dtype=np.int64),
        offset=np.array([push.offset for push in pushes], dtype=np.float64).reshape(-1, 3),
        frame=np.array([FRAMES.index(push.frame) for push in pushes], dtype=np.int64),
    )


class Pushes(NamedTuple):
    """The fields of `PushArrays` for n robots with at most P pushes each, and the impulse delivered."""

    force: Floats3  # (n, P, 3) [N]
    duration: Floats2  # (n, P) [s]
    start: Floats2  # (n, P) [s], PENDING until the gait event has come
    step: Ints2  # (n, P)
    fraction: Floats2  # (n, P)
    body: Ints2  # (n, P) number of the body, at first those of BODIES
    offset: Floats3  # (n, P, 3) from the body's CoM, body axes [m]
    frame: Ints2  # (n, P) of the force, index into FRAMES
    delivered: Floats3  # (n, P, 3) impulse so far [N s]


def empty_pushes(n: int, count: int) -> Pushes:
    """Arrays of `count` pushes for n robots, none of which ever starts."""
    shape = (n, count)
    return Pushes(
        np.zeros((*shape, 3)), np.zeros(shape), np.full(shape, PENDING), np.full(shape, -1, dtype=np.int64),
        np.zeros(shape), np.zeros(shape, dtype=np.int64), np.zeros((*shape, 3)),
        np.zeros(shape, dtype=np.int64), np.zeros((*shape, 3)),
    )  # fmt: skip


def assign_pushes(pushes: Pushes, k: int, scenario: Scenario, bodies: Mapping[str, int] = NUMBERS) -> Pushes:
    """Give robot k the pushes of a scenario, in place; returns larger arrays where they do not fit."""
    marks = (Push((0.0, 0.0, 0.0), MARK, kick.start) for kick in scenario.kicks)
    new = push_arrays((*scenario.pushes, *marks), scenario.stance_side, bodies)
    n, capacity = pushes.start.shape
    count = new.start.shape[0]
    if count > capacity:
        grown = empty_pushes(n, count)
        for old, field in zip(pushes, grown, strict=True):
            field[:, :capacity] = old
        pushes, capacity = grown, count
    for field, blank in zip(pushes, empty_pushes(1, capacity), strict=True):
        field[k] = blank[0]
    for field, value in zip(pushes[:-1], new, strict=True):
        field[k, :count] = value
    return pushes


@njit(cache=True)
def resolve_starts(
    start: NDArray[np.float64],
    step: NDArray[np.int64],
    fraction: NDArray[np.float64],
    step_index: int,
    step_start: float,
    planned_duration: float,
    t0: float,
    t1: float,
) -> None:
    """Write the start times of the gait events that come within [t0, t1) into `start`, in place.

    start = max(t0, step_start + fraction * planned_duration) in the event's step, t0 if that step is over.
    `step_index` and `step_start` [s] are those of the present step, `planned_duration` its planned T [s].
    """
    for i in range(start.shape[0]):
        if step[i] < 0 or start[i] != np.inf or step_index < step[i]:
            continue
        moment = step_start + fraction[i] * planned_duration if step_index == step[i] else t0
        if moment < t1:
            start[i] = max(t0, moment)


@njit(cache=True)
def turn_forces(
    force: NDArray[np.float64],
    frame: NDArray[np.int64],
    start: NDArray[np.float64],
    heading: float,
    t1: float,
) -> None:
    """Turn forces in the heading's frame by the heading [rad] where their push starts before t1, in place.

    They are in the world's frame from then on: F_world = R_z(heading) F.
    """
    for i in range(start.shape[0]):
        if frame[i] == 0 or start[i] >= t1:
            continue
        force[i, 0], force[i, 1] = in_world(heading_frame(heading), force[i, 0], force[i, 1])
        frame[i] = 0


@njit(cache=True)
def overlap(start: float, duration: float, t0: float, t1: float) -> float:
    """Length of [start, start + duration] within [t0, t1] [s]; PENDING starts give 0."""
    return max(0.0, min(t1, start + duration) - max(t0, start))


@njit(cache=True)
def mean_force(
    force: NDArray[np.float64],
    duration: NDArray[np.float64],
    start: NDArray[np.float64],
    index: int,
    t0: float,
    t1: float,
    out: NDArray[np.float64],
) -> bool:
    """Write the force of push `index` averaged over [t0, t1] into `out` (3,) [N]; True where it is not zero.

    mean = F * |[start, start + d] and [t0, t1]| / (t1 - t0), so that the sum of mean * (t1 - t0) over any
    partition of time is F d exactly (to rounding), at every control rate.
    """
    share = overlap(start[index], duration[index], t0, t1) / (t1 - t0)
    for axis in range(3):
        out[axis] = force[index, axis] * share
    return share > 0.0
