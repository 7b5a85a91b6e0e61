"""Pushes as forces and kicks as jumps of velocity on n bipeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numba.np.numpy_support import carray

from ...controllers.jit import njit
from ...controllers.math3 import cross, stack_floats, to_world, vector_at, vector_of
from ...controllers.model.gait_box import DURATION
from ...controllers.whole_body.gait_machine import Gait
from ...controllers.whole_body.kinematics import BODIES, PUSHED_BODY, Physics
from ..scenario.arrays import Pushes, mean_force, resolve_starts, turn_forces
from ..scenario.push import Kick

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

DUE = 1e-9  # a kick this soon after the period begins is due: times are sums of steps [s]


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


@njit(cache=True, forceinline=True)
def place_of(number: int) -> int:
    """Row of `Physics` that a body has: those of `push.BODIES` their own, a robot's links the last ones."""
    return PUSHED_BODY[number] if number < len(PUSHED_BODY) else BODIES + number - len(PUSHED_BODY)


@njit(cache=True, forceinline=True)
def apply_pushes(phys: Physics, gait: Gait, k: int, pushes: Pushes, dt: float) -> None:
    """Write the mean push over the coming physics step into the external forces of one robot."""
    now, mean = gait.time[k], carray(stack_floats(3), (3,))
    resolve_starts(
        pushes.start[k], pushes.step[k], pushes.fraction[k], gait.steps[k], now - gait.elapsed[k],
        gait.plan[k, DURATION], now, now + dt,
    )  # fmt: skip
    turn_forces(pushes.force[k], pushes.frame[k], pushes.start[k], gait.heading[k], now + dt)
    phys.xfrc[k] = 0.0
    for i in range(pushes.start.shape[1]):
        if mean_force(pushes.force[k], pushes.duration[k], pushes.start[k], i, now, now + dt, mean):
            body, force = place_of(pushes.body[k, i]), vector_of(mean, 0)
            torque = cross(to_world(phys.xmat, k, body, vector_at(pushes.offset, k, i)), force)
            for a in range(3):
                phys.xfrc[k, body, a] += force[a]
                phys.xfrc[k, body, 3 + a] += torque[a]
                pushes.delivered[k, i, a] += force[a] * dt
