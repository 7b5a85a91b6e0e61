"""Layout of the joint observation: proprioception in the base's own axes, canonical left to right.

It is what legged robots that learn are commonly given (velocity, angular velocity and gravity in the base's
axes, command, joints less a posture, their rates, the previous action, a clock), and nothing that a robot's
own sensors do not tell: with onboard sensing every entry is their reading or their estimate.
"""

from __future__ import annotations

import math

from ..compiled.kernels import njit
from ..compiled.vector_3 import add, to_body, vector_in
from ..model.frame import canonical, canonical_frame, in_world
from ..model.gait_box import DURATION
from ..model.observation import COM_VELOCITY
from ..model.robot import GRAVITY
from ..whole_body.gait_machine import Gait, GaitSettings
from ..whole_body.kinematics import NU, NV, PELVIS, Array, Physics
from ..whole_body.turning import TURN
from .canonical import JOINT_NAMES, axial, joint_sign, own_joint, polar, to_canonical
from .drives import JOINT, Joints

BASE_VELOCITY = 0  # three entries [m/s]
BASE_RATE = 3  # three entries [rad/s]
GRAVITY_DIRECTION = 6  # three entries
HEADING_ERROR = 9  # yaw of the base over the heading [rad]
COMMAND = 10  # velocity x, y [m/s], turn [rad/s]
ANGLES = 13  # of the joints, less the standing posture [rad]
RATES = ANGLES + NU  # [rad/s]
PREVIOUS_ACTION = RATES + NU
LOADS = PREVIOUS_ACTION + NU  # under stance and swing foot, over the weight
PHASE = LOADS + 2  # time since touchdown over the duration of the step
JOINT_OBSERVATION_SIZE = PHASE + 1
LATEST_PHASE = 2.0

JOINT_OBSERVATION_NAMES = (
    "base_velocity_x", "base_velocity_y", "base_velocity_z", "base_rate_x", "base_rate_y", "base_rate_z",
    "gravity_x", "gravity_y", "gravity_z", "heading_error", "command_x", "command_y", "command_turn",
    *(f"{name}_angle" for name in JOINT_NAMES), *(f"{name}_rate" for name in JOINT_NAMES),
    *(f"previous_{name}" for name in JOINT_NAMES), "stance_load", "swing_load", "phase",
)  # fmt: skip


@njit(cache=True, forceinline=True)
def write_base(
    phys: Physics, gait: Gait, k: int, noise: tuple[float, float], command: Array, o: Array
) -> None:
    """Motion of the base of robot k, gravity and the command.

    `noise` is added to the velocity, canonical frame [m/s].
    """
    frame = canonical_frame(gait.heading[k], gait.stance[k])
    noise_x, noise_y = in_world(frame, noise[0], noise[1])
    velocity = add(vector_in(phys.qvel, k, 0), (noise_x, noise_y, 0.0))
    moves = polar(frame.sign, to_body(phys.xmat, k, PELVIS, velocity))
    turns = axial(frame.sign, vector_in(phys.qvel, k, 3))
    falls = polar(frame.sign, to_body(phys.xmat, k, PELVIS, (0.0, 0.0, -1.0)))
    for i in range(3):
        o[BASE_VELOCITY + i], o[BASE_RATE + i], o[GRAVITY_DIRECTION + i] = moves[i], turns[i], falls[i]
    x, y = canonical(frame, phys.xmat[k, PELVIS, 0], phys.xmat[k, PELVIS, 3])
    o[HEADING_ERROR] = math.atan2(y, x)
    o[COMMAND], o[COMMAND + 1] = command[0], frame.sign * command[1]
    o[COMMAND + 2] = frame.sign * command[TURN]


@njit(cache=True)
def observe_joints(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, joints: Joints, command: Array,
    noise: tuple[float, float], o: Array,
) -> None:  # fmt: skip
    """Write the observation (JOINT_OBSERVATION_SIZE,) of robot k.

    Args:
        phys: of all robots, as control knows them.
        gait: their gait machines.
        k: the robot.
        s: constants.
        joints: what they are asked, and their standing posture.
        command: in force (3,), its velocity in the heading frame [m/s], turn [rad/s].
        noise: of the velocity, canonical frame [m/s].
        o: written.
    """
    stance = gait.stance[k]
    write_base(phys, gait, k, noise, command, o)
    for c in range(NU):
        i = own_joint(c, stance)
        sign = joint_sign(phys.mirror, i, stance)
        o[ANGLES + c] = sign * (phys.qpos[k, JOINT + i] - joints.posture[i])
        o[RATES + c] = sign * phys.qvel[k, NV - NU + i]
    to_canonical(joints.held[k], phys.mirror, stance, o[PREVIOUS_ACTION : PREVIOUS_ACTION + NU])
    weight = s.mass * GRAVITY
    o[LOADS], o[LOADS + 1] = phys.load[k, stance] / weight, phys.load[k, 1 - stance] / weight
    o[PHASE] = min(gait.elapsed[k] / gait.plan[k, DURATION], LATEST_PHASE)


@njit(cache=True, forceinline=True)
def velocity_noise(seen: Array, known: Array) -> tuple[float, float]:
    """What an observation (36,) adds to the velocity of the one without its noise (36,) [m/s]."""
    first = COM_VELOCITY.start
    return seen[first] - known[first], seen[first + 1] - known[first + 1]
