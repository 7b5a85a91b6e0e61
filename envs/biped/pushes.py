"""Pushes as external forces on n bipeds; compiled, every physics step."""

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from numba.np.numpy_support import carray

from ...controllers.compiled.kernels import njit
from ...controllers.compiled.stack_array import stack_floats
from ...controllers.compiled.vector_3 import cross, to_world, vector_at, vector_of
from ...controllers.model.gait_box import DURATION
from ...controllers.whole_body.gait_machine import Gait
from ...controllers.whole_body.kinematics import BODIES, PUSHED_BODY, Physics
from ..scenario.push_arrays import Pushes
from ..scenario.push_force import mean_force, resolve_starts, turn_forces


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
