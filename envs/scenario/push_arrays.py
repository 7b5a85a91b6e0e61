"""The pushes of n robots as arrays for compiled loops, and what each has delivered.

A kick has a row after those of the pushes, without a force: what counts from the first push on, as limits met
do, counts from it on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.array_table import Floats2, Floats3, Ints2
from .push import BODIES, FRAMES, PENDING, GaitEvent, Push, Side
from .scenario import Scenario

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

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
