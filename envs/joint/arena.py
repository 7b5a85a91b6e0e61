"""What actions on the joints add to the arena of bipeds: a part of the address table, and its two uses."""

# part_of is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

from typing import Any, NamedTuple, get_type_hints

from ...controllers.compiled.array_table import part_of
from ...controllers.compiled.kernels import njit
from ...controllers.joints.canonical import to_own
from ...controllers.joints.drives import Joints
from ...controllers.joints.observation import observe_joints, velocity_noise
from ...controllers.model.observation import OBSERVATION_SIZE
from ...controllers.whole_body.gait_machine import NOT_FINITE
from ...controllers.whole_body.kinematics import Array, Ints
from ..biped.period import Arena, settings_of

# The arena of any biped, and after it what is asked of the joints.
_PARTS: Any = [*get_type_hints(Arena).items(), ("joints", Joints)]
JointArena: Any = NamedTuple("JointArena", _PARTS)


@njit(cache=True)
def take_over(t: Ints, first: int, end: int) -> None:
    """Hold the actions asked of the joints of robots first..end-1, in their own order from now on."""
    joints, gait = part_of(t, JointArena, "joints"), part_of(t, Arena, "gait")
    mirror = part_of(t, Arena, "physics").mirror
    for k in range(first, end):
        if gait.failure[k] == 0:
            to_own(joints.asked[k], mirror, gait.stance[k], joints.held[k])
            joints.effort[k] = 0.0


@njit(cache=True)
def observe_all(t: Ints, c: Array, first: int, end: int, planned: bool) -> None:
    """Joint observations of robots first..end-1; after that of the gait where a planner acts as well.

    One whose state is not finite keeps the observation that it had.
    """
    phys, gait, settings = part_of(t, Arena, "physics"), part_of(t, Arena, "gait"), settings_of(c)
    joints, exchange = part_of(t, JointArena, "joints"), part_of(t, Arena, "exchange")
    known = part_of(t, Arena, "shown").observation
    for k in range(first, end):
        if gait.failure[k] == NOT_FINITE:
            continue
        seen, out = exchange.observation[k], joints.observation[k]
        if planned:
            out[:OBSERVATION_SIZE] = seen
            out = out[OBSERVATION_SIZE:]
        noise = velocity_noise(seen, known[k])
        observe_joints(phys, gait, k, settings, joints, exchange.command[k], noise, out)
