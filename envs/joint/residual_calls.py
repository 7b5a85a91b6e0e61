"""A planning period under a residual on joint torques: whole-body control finds them, the residual is added.

The planner's gait goes through gait machine and whole-body control as it does without a residual.
"""

# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from ...controllers.compiled.array_table import part_of
from ...controllers.compiled.kernels import njit
from ...controllers.joints.drives import add_residual, count_effort
from ...controllers.whole_body.gait_machine import control
from ...controllers.whole_body.kinematics import Array, Ints
from ..biped.period import (
    PeriodCalls,
    begin_period,
    bounds_of,
    finish_period,
    gains_of,
    move,
    plant_of,
    settings_of,
)
from .arena import JointArena, observe_all, take_over


@njit(cache=True, nogil=True)
def begin_residual(t: Ints, c: Array, gaits: Array, actions: Array, first: int, end: int) -> None:
    """Take over the planner's gaits (n, 7) and actions (n, 7), and the residuals, of robots first..end-1."""
    take_over(t, first, end)
    begin_period(t, c, gaits, actions, first, end)


@njit(cache=True, nogil=True)
def residual_steps(t: Ints, c: Array, steps: int, dt: float, first: int, end: int) -> None:
    """Whole-body control, what is added to it, and physics of robots first..end-1; as `physics_steps`."""
    plant, bounds, gains, settings = plant_of(t), bounds_of(t, c), gains_of(c), settings_of(c)
    phys, gait, record, joints = plant.physics, plant.gait, plant.met, part_of(t, JointArena, "joints")
    for k in range(first, end):
        if gait.failure[k] != 0:
            continue
        bounds.grip[0] = plant.known.grip[k]
        for _ in range(steps):
            met = control(phys, gait, k, settings, gains, bounds, record.landing, dt) | record.plan[k]
            met |= add_residual(phys, k, joints, bounds)
            count_effort(phys, k, joints, 1.0 / steps)
            if not move(plant, t, k, met, dt):
                break


@njit(cache=True, nogil=True)
def finish_residual(t: Ints, c: Array, first: int, end: int) -> None:
    """`finish_period` and both observations of robots first..end-1."""
    finish_period(t, c, first, end)
    observe_all(t, c, first, end, True)


@njit(cache=True, nogil=True)
def whole_residual(
    t: Ints, c: Array, gaits: Array, actions: Array, steps: int, dt: float, first: int, end: int
) -> None:
    """A planning period of robots first..end-1 under gaits and a residual on their torques."""
    begin_residual(t, c, gaits, actions, first, end)
    residual_steps(t, c, steps, dt, first, end)
    finish_residual(t, c, first, end)


RESIDUAL_CALLS = PeriodCalls(whole_residual, begin_residual, residual_steps, finish_residual)
