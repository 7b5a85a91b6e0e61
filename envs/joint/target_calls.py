"""A planning period under joint targets: PD control finds the torques, the contacts say where a step ends.

What the torques act on is that of any biped (`biped.period.move`), and so is what judges it.
"""

# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from ...controllers.compiled.array_table import part_of
from ...controllers.compiled.kernels import njit
from ...controllers.joints.contact_gait import follow_contacts, hold_nominal
from ...controllers.joints.drives import count_effort, follow_targets
from ...controllers.whole_body.gait_machine import NOT_FINITE
from ...controllers.whole_body.kinematics import Array, Ints
from ..biped.period import Arena, PeriodCalls, bounds_of, finish_period, move, plant_of, settings_of
from .arena import JointArena, observe_all, take_over
from .floor_points import write_floor_points


@njit(cache=True, nogil=True)
def begin_targets(t: Ints, c: Array, gaits: Array, actions: Array, first: int, end: int) -> None:
    """Take over joint targets of robots first..end-1; `gaits` and `actions` are nobody's."""
    joints, seen = part_of(t, JointArena, "joints"), part_of(t, Arena, "exchange").observation
    gait, errors = part_of(t, Arena, "gait"), part_of(t, Arena, "errors")
    take_over(t, first, end)
    for k in range(first, end):
        if gait.failure[k] == 0:
            errors.period[k] += 1
            hold_nominal(gait, k, seen[k], joints.gait)


@njit(cache=True, nogil=True)
def target_steps(t: Ints, c: Array, steps: int, dt: float, first: int, end: int) -> None:
    """PD control and physics of robots first..end-1; otherwise as `physics_steps`."""
    plant, bounds, settings = plant_of(t), bounds_of(t, c), settings_of(c)
    phys, gait, joints = plant.physics, plant.gait, part_of(t, JointArena, "joints")
    for k in range(first, end):
        if gait.failure[k] != 0:
            continue
        for _ in range(steps):
            follow_contacts(phys, gait, k, settings, joints)
            met = follow_targets(phys, k, joints, bounds)
            count_effort(phys, k, joints, 1.0 / steps)
            if not move(plant, t, k, met, dt):
                break


@njit(cache=True, nogil=True)
def finish_targets(t: Ints, c: Array, first: int, end: int) -> None:
    """`finish_period`, points on the floor and joint observations of robots first..end-1."""
    judged, gait = part_of(t, Arena, "judged"), part_of(t, Arena, "gait")
    felt, world = part_of(t, Arena, "judged_contacts"), part_of(t, Arena, "exchange").world
    finish_period(t, c, first, end)
    for k in range(first, end):
        if gait.failure[k] != NOT_FINITE:
            write_floor_points(judged, gait, k, felt.force[k], world[k])
    observe_all(t, c, first, end, False)


@njit(cache=True, nogil=True)
def whole_targets(
    t: Ints, c: Array, gaits: Array, actions: Array, steps: int, dt: float, first: int, end: int
) -> None:
    """A planning period of robots first..end-1, from their targets to their observations."""
    begin_targets(t, c, gaits, actions, first, end)
    target_steps(t, c, steps, dt, first, end)
    finish_targets(t, c, first, end)


TARGET_CALLS = PeriodCalls(whole_targets, begin_targets, target_steps, finish_targets)
