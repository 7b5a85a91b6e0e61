"""The pushes of n robots as arrays for compiled loops, and what each has delivered."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .push import PENDING, push_arrays
from .scenario import Scenario

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Pushes(NamedTuple):
    """The fields of `PushArrays` for n robots with at most P pushes each, and the impulse delivered."""

    force: Array  # (n, P, 3) [N]
    duration: Array  # (n, P) [s]
    start: Array  # (n, P) [s], PENDING until the gait event has come
    step: Ints  # (n, P)
    fraction: Array  # (n, P)
    body: Ints  # (n, P) index into BODIES
    offset: Array  # (n, P, 3) from the body's CoM, body axes [m]
    frame: Ints  # (n, P) of the force, index into FRAMES
    delivered: Array  # (n, P, 3) impulse so far [N s]


def empty_pushes(n: int, count: int) -> Pushes:
    """Arrays of `count` pushes for n robots, none of which ever starts."""
    shape = (n, count)
    return Pushes(
        np.zeros((*shape, 3)), np.zeros(shape), np.full(shape, PENDING), np.full(shape, -1, dtype=np.int64),
        np.zeros(shape), np.zeros(shape, dtype=np.int64), np.zeros((*shape, 3)),
        np.zeros(shape, dtype=np.int64), np.zeros((*shape, 3)),
    )  # fmt: skip


def assign_pushes(pushes: Pushes, k: int, scenario: Scenario) -> Pushes:
    """Give robot k the pushes of a scenario, in place; returns larger arrays where they do not fit."""
    new = push_arrays(scenario.pushes, scenario.stance_side)
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
