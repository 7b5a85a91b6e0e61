"""Pushes, kicks and command changes of n robots for compiled loops: when they come, and how much of them.

The forces of all disturbances have a row each; after them a jump of the velocity has one without a force, so
that what counts from the first disturbance on, as limits that are met do, counts from it on, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from ...controllers.array_table import NO_STATE, Floats2, Floats3, Ints1, Ints2, Ints3
from ...controllers.jit import njit
from ...controllers.model.observation import heading_frame, in_world
from ...controllers.whole_body.swing import COMMAND_SIZE, COMMAND_X, COMMAND_Y, STAND
from .push import BODIES, FRAMES, PENDING, TERMS, GaitEvent, Kick, Push
from .scenario import Command, Scenario

DUE = 1e-9  # a change or kick this soon after the period begins is due: times are sums of steps [s]


def command_row(command: Command) -> tuple[float, float, float, float]:
    """A command as a row (COMMAND_SIZE,)."""
    return command.vx, command.vy, command.turn, float(command.stand)


@njit(cache=True)
def may_stay(command):  # pragma: no cover
    """Whether a standing robot may go on standing under a command (4,): to stand, or while it gets going."""
    return command[STAND] != 0.0 or command[COMMAND_X] != 0.0 or command[COMMAND_Y] != 0.0


class Schedule(NamedTuple):
    """Changes of the command of n robots, at most C each."""

    time: Floats2  # (n, C) since reset [s], rising; inf: there are no more
    command: Floats3  # (n, C, 4) velocity in the heading frame [m/s], turn [rad/s], 1: stand
    next: Ints1  # (n,) index of the first change to come


def empty_schedule(n: int, count: int = 0) -> Schedule:
    """Arrays of `count` changes for n robots, none of which ever comes."""
    return Schedule(np.full((n, count), np.inf), np.zeros((n, count, COMMAND_SIZE)), np.zeros(n, np.int64))


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
        schedule.command[k, i] = command_row(change.command)
    return schedule


@njit(cache=True)
def follow(schedule, k, now, command):  # pragma: no cover
    """Put the latest command (4,) that is due `now` [s] into force for robot k."""
    i = schedule.next[k]
    while i < schedule.time.shape[1] and schedule.time[k, i] <= now + DUE:
        for axis in range(command.shape[0]):
            command[axis] = schedule.command[k, i, axis]
        i += 1
    schedule.next[k] = i


@njit(cache=True)
def follow_all(schedule, now, command, first, end):  # pragma: no cover
    """`follow` for robots first..end-1: now (n,) [s], command (n, 4)."""
    for k in range(first, end):
        follow(schedule, k, now[k], command[k])


MARK = 1e-3  # duration of a jump's row [s]
NUMBERS = {name: number for number, name in enumerate(BODIES)}
PROGRESS, PLACES = 20, 3  # numbers of the state of a law, and addresses that it works by


class Pushes(NamedTuple):
    """The forces that act on n robots, at most P each, and the impulse that they have delivered."""

    force: Floats3  # (n, P, 3) [N]; written where one is turned into the world
    duration: Floats2  # (n, P) [s]
    start: Floats2  # (n, P) [s], PENDING until the gait event has come; written then
    step: Ints2  # (n, P) index of the event's step, -1 for a push at a time
    fraction: Floats2  # (n, P) of the planned step duration
    body: Ints2  # (n, P) number of the body, at first those of BODIES
    offset: Floats3  # (n, P, 3) from the body's CoM, body axes [m]
    frame: Ints2  # (n, P) of the force, index into FRAMES; written
    delivered: Floats3  # (n, P, 3) impulse so far [N s]
    law: Ints2  # (n, P) number of the law that the force follows, 0: it is constant
    terms: Floats3  # (n, P, TERMS) numbers of the law
    progress: Floats3  # (n, P, PROGRESS) its state, written
    places: Annotated[Ints3, NO_STATE]  # (n, P, PLACES) addresses, see `envs/biped/laws.py`


def empty_pushes(n: int, count: int) -> Pushes:
    """Arrays of `count` pushes for n robots, none of which ever starts."""
    shape = (n, count)
    return Pushes(
        np.zeros((*shape, 3)), np.zeros(shape), np.full(shape, PENDING), np.full(shape, -1, dtype=np.int64),
        np.zeros(shape), np.zeros(shape, dtype=np.int64), np.zeros((*shape, 3)),
        np.zeros(shape, dtype=np.int64), np.zeros((*shape, 3)), np.zeros(shape, dtype=np.int64),
        np.zeros((*shape, TERMS)), np.zeros((*shape, PROGRESS)), np.zeros((*shape, PLACES), dtype=np.int64),
    )  # fmt: skip


def assign_pushes(pushes: Pushes, k: int, scenario: Scenario, bodies: Mapping[str, int] = NUMBERS) -> Pushes:
    """Give robot k the disturbances of a scenario, in place; returns larger arrays where they do not fit.

    `bodies` has the number of each body that is pushed, by name.
    """
    marks = (Push((0.0, 0.0, 0.0), MARK, kick.start) for kick in scenario.jumps)
    own = [*scenario.forces, *marks]
    n, capacity = pushes.start.shape
    if len(own) > capacity:
        grown = empty_pushes(n, len(own))
        for old, field in zip(pushes, grown, strict=True):
            field[:, :capacity] = old
        pushes = grown
    for field, blank in zip(pushes, empty_pushes(1, max(capacity, len(own))), strict=True):
        field[k] = blank[0]
    for i, push in enumerate(own):
        pushes.force[k, i], pushes.duration[k, i], pushes.offset[k, i] = (
            push.force,
            push.duration,
            push.offset,
        )
        if isinstance(push.start, GaitEvent):
            pushes.step[k, i] = push.start.step_index(scenario.stance_side)
            pushes.fraction[k, i] = push.start.fraction
        else:
            pushes.start[k, i] = push.start
        pushes.body[k, i], pushes.frame[k, i] = bodies[push.body], FRAMES.index(push.frame)
        if push.law is not None:
            terms = push.law.terms
            pushes.law[k, i], pushes.terms[k, i, : len(terms)] = push.law.number, terms
    return pushes


@njit(cache=True)
def resolve_starts(
    start, step, fraction, step_index, step_start, planned_duration, t0, t1
):  # pragma: no cover
    """Write the start times of the gait events that come within [t0, t1) into `start` (P,), in place.

    start = max(t0, step_start + fraction * planned_duration) in the event's step, t0 if that step is over.
    `step` and `fraction` (P,) are the events', `step_index` and `step_start` [s] those of the present step,
    `planned_duration` its planned T [s].
    """
    for i in range(start.shape[0]):
        if step[i] < 0 or start[i] != np.inf or step_index < step[i]:
            continue
        moment = step_start + fraction[i] * planned_duration if step_index == step[i] else t0
        if moment < t1:
            start[i] = max(t0, moment)


@njit(cache=True)
def turn_forces(force, frame, start, heading, t1):  # pragma: no cover
    """Turn forces in the heading's frame by the heading [rad] where their push starts before t1, in place.

    They are in the world's frame from then on: F_world = R_z(heading) F.
    """
    for i in range(start.shape[0]):
        if frame[i] == 0 or start[i] >= t1:
            continue
        force[i, 0], force[i, 1] = in_world(heading_frame(heading), force[i, 0], force[i, 1])
        frame[i] = 0


@njit(cache=True)
def mean_force(force, duration, start, index, t0, t1, out):  # pragma: no cover
    """Write the force of push `index` averaged over [t0, t1] into `out` (3,) [N]; True where it is not zero.

    mean = F * |[start, start + d] and [t0, t1]| / (t1 - t0), so that the sum of mean * (t1 - t0) over any
    partition of time is F d exactly (to rounding), at every control rate. A PENDING start gives 0.
    """
    span = max(0.0, min(t1, start[index] + duration[index]) - max(t0, start[index]))
    share = span / (t1 - t0)
    for axis in range(3):
        out[axis] = force[index, axis] * share
    return share > 0.0


class Kicks:
    """Kicks of n robots in the order of their start; `done` counts those that have come, a robot's state."""

    def __init__(self, n: int):
        self.done = np.zeros(n, np.int64)
        self.waiting: set[int] = set()  # robots with a kick to come
        self._kicks: list[Sequence[Kick]] = [()] * n

    def assign(self, k: int, kicks: Sequence[Kick]) -> None:
        """Give robot k the kicks of a scenario, none of which has come."""
        self._kicks[k] = sorted(kicks, key=lambda kick: kick.start)
        self.pass_over(k, 0)

    def pass_over(self, k: int, done: int) -> None:
        """Let the first `done` kicks of robot k count as come."""
        self.done[k] = done
        (self.waiting.add if done < len(self._kicks[k]) else self.waiting.discard)(k)

    def due(self, k: int, now: float) -> Iterator[Kick]:
        """The kicks of robot k that come now [s]."""
        while k in self.waiting and (kick := self._kicks[k][self.done[k]]).start <= now + DUE:
            self.pass_over(k, int(self.done[k]) + 1)
            yield kick
