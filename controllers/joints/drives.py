"""From what is asked of the joints to torques: PD control of targets, or a share added to other torques.

    tau = clip(k (q_0 + r a - q) - d qd,  range of the motor at its speed)

with a in [-1, 1] the action held, q_0 the standing posture, r the reach of an action of 1. The stiffness is
the motor's full torque over r = 1 rad, so that an action of 1 asks for all of it at q_0, and the damping
0.02 s times the stiffness. Public training code of the robot H1 of Unitree, whose motors these resemble, has
150-200 N m/rad at hips and knees of 200-300 N m, and 0.013-0.025 s. Damping that is critical for a leg with
the pelvis held is too much for a light pelvis and torques that come 4 ms late: it then shakes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled.array_table import Floats1, Floats2, Ints1, Ints2
from ..compiled.kernels import njit
from ..whole_body.bounds import NEVER, Bounds
from ..whole_body.bounds_met import JOINT_TORQUE
from ..whole_body.kinematics import NU, NV, Array, Physics
from ..whole_body.motors import write_torque_range

TARGET_REACH = 1.0  # r: of a joint target [rad]
DAMPING_TIME = 0.02  # d / k [s]
JOINT = 7  # first joint coordinate; a base has seven


class Joints(NamedTuple):
    """What n robots are asked of their joints, and the constants of their drives."""

    asked: Floats2  # (n, 14) action of the period, canonical, in [-1, 1]
    held: Floats2  # (n, 14) the same in the robot's own order and coordinates
    lifted: Ints1  # (n,) 1 where the swing foot has been off the floor in this step
    air: Ints2  # (n, 2) physics steps that the left and the right foot have carried no load by now
    effort: Floats1  # (n,) sum over the joints of (tau / largest)^2, mean of the period's steps
    observation: Floats2  # (n, size) that policies see
    posture: Floats1  # (14,) q_0 [rad]
    reach: Floats1  # (14,) of an action of 1: of a target [rad], of a residual [N m]
    stiffness: Floats1  # (14,) k [N m/rad]
    damping: Floats1  # (14,) d [N m s/rad]
    largest: Floats1  # (14,) torque of each motor [N m]; 0 for a joint that the robot does not have
    gait: Floats1  # (10,) of the nominal gait, see `contact_gait.NominalConstants`


def joint_constants(motors: Array) -> tuple[Array, Array, Array]:
    """Largest torque (14,) [N m], stiffness k (14,) [N m/rad] and damping d (14,) [N m s/rad].

    `motors` (2, 14) are largest torque [N m], NEVER for a joint that the robot does not have, and speed
    without load [rad/s].
    """
    largest = np.where(motors[0] < NEVER, motors[0], 0.0)
    stiffness = largest / TARGET_REACH
    return largest, stiffness, DAMPING_TIME * stiffness


@njit(cache=True, forceinline=True)
def limit_to_motors(phys: Physics, k: int, joints: Joints, bounds: Bounds) -> int:
    """Clip the torques of robot k to what its motors give now; JOINT_TORQUE where that binds, otherwise 0."""
    torque, met = phys.ctrl[k], 0
    for i in range(NU):
        low, high = bounds.torque_range[0, i], bounds.torque_range[1, i]
        if joints.largest[i] > 0.0 and not low < torque[i] < high:
            torque[i] = min(max(torque[i], low), high)
            met = JOINT_TORQUE
    return met


@njit(cache=True, forceinline=True)
def follow_targets(phys: Physics, k: int, joints: Joints, bounds: Bounds) -> int:
    """PD torques of robot k towards the targets that it holds; returns the bounds met, as bits."""
    for i in range(NU):
        target = joints.posture[i] + joints.reach[i] * joints.held[k, i]
        lack, rate = target - phys.qpos[k, JOINT + i], phys.qvel[k, NV - NU + i]
        phys.ctrl[k, i] = joints.stiffness[i] * lack - joints.damping[i] * rate
    write_torque_range(phys, k, bounds.motors, bounds.torque_range)
    return limit_to_motors(phys, k, joints, bounds)


@njit(cache=True, forceinline=True)
def add_residual(phys: Physics, k: int, joints: Joints, bounds: Bounds) -> int:
    """Add what robot k holds to the torques that whole-body control has just found for it.

    Without a residual these keep their bits. Returns the bounds met, as bits.
    """
    some = False
    for i in range(NU):
        if joints.held[k, i] != 0.0:
            phys.ctrl[k, i] += joints.reach[i] * joints.held[k, i]
            some = True
    return limit_to_motors(phys, k, joints, bounds) if some else 0


@njit(cache=True, forceinline=True)
def count_effort(phys: Physics, k: int, joints: Joints, share: float) -> None:
    """Add the torques asked of robot k in one of 1 / share physics steps."""
    for i in range(NU):
        if joints.largest[i] > 0.0:
            joints.effort[k] += share * (phys.ctrl[k, i] / joints.largest[i]) ** 2
