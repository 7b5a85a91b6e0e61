"""Control of single joints: canonical order, drives, steps by contacts, and the joint observation.

The canonical order is waist, stance leg, swing leg, as if the robot stood on its right foot. A robot that
stands on its left foot is seen in a mirror, so left and right are one problem, as for gaits
(`observation.canonical_frame`). With s the sign of the canonical y, a mirror leaves of a polar vector
(x, s y, z), of an axial one (s x, y, s z), and turns the coordinate of each joint by its own sign
(`Physics.mirror`).

Torques follow from PD control of targets, or are a share added to other torques:

    tau = clip(k (q_0 + r a - q) - d qd,  range of the motor at its speed)

with a in [-1, 1] the action held, q_0 the standing posture, r the reach of an action of 1. The stiffness is
the motor's full torque over r = 1 rad, so that an action of 1 asks for all of it at q_0, and the damping
0.02 s times the stiffness. Public training code of the robot H1 of Unitree, whose motors these resemble, has
150-200 N m/rad at hips and knees of 200-300 N m, and 0.013-0.025 s. Damping that is critical for a leg with
the pelvis held is too much for a light pelvis and torques that come 4 ms late: it then shakes.

Where no planner leads, the contacts alone say where a step ends. Stance side, time in the step and touchdown
are what every episode is judged by; the gait machine holds the nominal gait of the command, and a touchdown
is the same one as under a gait (`has_landed`: near T, or under heavy load late in the step), of a foot that
has been off the floor since the step began. A robot that stands on both feet makes no steps.

The joint observation is proprioception in the base's own axes, canonical left to right: what robots that
learn to walk are commonly given (velocity, angular velocity and gravity in the base's axes, command, joints
less a posture, their rates, the previous action, a clock), and nothing beyond a robot's own sensors: with
onboard sensing every entry is their reading or their estimate.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from .array_table import COMMON, Floats1, Floats2, Ints1, Ints2, tuple_reader
from .jit import njit
from .math3 import Vector, add, to_body, vector_in
from .model.gait_box import COP, DURATION, STEP, GaitLimits
from .model.nominal_gait import NOMINAL_DURATION, NOMINAL_SIZE, NOMINAL_STEP, nominal_gait_kernel
from .model.observation import COM_VELOCITY, COMMAND, canonical, canonical_frame, in_world
from .model.robot import GRAVITY, RobotModel
from .whole_body.gait_machine import FLOOR, Gait, GaitSettings, has_landed, touch_down
from .whole_body.kinematics import NU, NV, PELVIS, Array, Physics, sole_position
from .whole_body.limits import JOINT_TORQUE, NEVER, Bounds, write_torque_range
from .whole_body.swing import SWING, TURN

WAIST = 2  # joints of the waist, which come first
LEG = 6  # joints of a leg: the stance leg's come next

JOINT_NAMES = (
    "waist_pitch", "waist_roll",
    *(f"{leg}_{joint}" for leg in ("stance", "swing")
      for joint in ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")),
)  # fmt: skip


@njit(cache=True, forceinline=True)
def own_joint(c: int, stance: int) -> int:
    """Number in the robot's own order (waist, left leg, right leg) of canonical joint c."""
    if c < WAIST:
        return c
    leg = stance if c < WAIST + LEG else 1 - stance
    return WAIST + LEG * leg + (c - WAIST) % LEG


@njit(cache=True, forceinline=True)
def joint_sign(mirror: Array, own: int, stance: int) -> float:
    """Sign of a joint's canonical coordinate in its own, and the other way round."""
    return mirror[own] if stance == 0 else 1.0


@njit(cache=True, forceinline=True)
def to_canonical(own: Array, mirror: Array, stance: int, out: Array) -> None:
    """Write values of the joints in their own order and coordinates (14,) in canonical ones (14,)."""
    for c in range(NU):
        i = own_joint(c, stance)
        out[c] = joint_sign(mirror, i, stance) * own[i]


@njit(cache=True, forceinline=True)
def to_own(values: Array, mirror: Array, stance: int, out: Array) -> None:
    """Write canonical values of the joints (14,) in their own order and coordinates (14,)."""
    for c in range(NU):
        i = own_joint(c, stance)
        out[i] = joint_sign(mirror, i, stance) * values[c]


@njit(cache=True, forceinline=True)
def polar(sign: float, a: Vector) -> Vector:
    """A velocity or direction in the axes of the base, its y towards the swing side."""
    return a[0], sign * a[1], a[2]


@njit(cache=True, forceinline=True)
def axial(sign: float, a: Vector) -> Vector:
    """An angular velocity in the axes of the base, the same way."""
    return sign * a[0], a[1], sign * a[2]


TARGET_REACH = 1.0  # r: of a joint target [rad]
DAMPING_TIME = 0.02  # d / k [s]
JOINT = 7  # first joint coordinate; a base has seven


class Joints(NamedTuple):
    """Actions asked of the joints of n robots, and the constants of their drives."""

    asked: Floats2  # (n, 14) action of the period, canonical, in [-1, 1]
    held: Floats2  # (n, 14) the same in the robot's own order and coordinates
    lifted: Ints1  # (n,) 1 where the swing foot has been off the floor in this step
    air: Ints2  # (n, 2) physics steps that the left and the right foot have carried no load by now
    effort: Floats1  # (n,) sum over the joints of (tau / largest)^2, mean of the period's steps
    observation: Floats2  # (n, size) that policies see
    posture: Annotated[Floats1, COMMON]  # (14,) q_0 [rad]
    reach: Annotated[Floats1, COMMON]  # (14,) of an action of 1: of a target [rad], of a residual [N m]
    stiffness: Annotated[Floats1, COMMON]  # (14,) k [N m/rad]
    damping: Annotated[Floats1, COMMON]  # (14,) d [N m s/rad]
    largest: Annotated[Floats1, COMMON]  # (14,) torque of each motor [N m]; 0 where the robot has no joint
    gait: Annotated[Floats1, COMMON]  # (10,) of the nominal gait, see `NominalConstants`


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


UNLOADED = 1.0  # load under a foot that is off the floor, at most [N]
LIFTED = 10  # physics steps without load after which a foot counts as lifted: 20 ms

_COMMAND = COMMAND.start
_BOX = 3  # bounds of step length, width and duration
_LOW = 4  # where they begin


class NominalConstants(NamedTuple):
    """Constants of the nominal gait; the low and the high bounds of the step come after them."""

    omega: float  # [1/s]
    pelvis_width: float  # [m]
    delay: float  # of touchdown [s]
    double_support: float  # [s]


nominal_constants_of = tuple_reader(NominalConstants)


def nominal_constants(robot: RobotModel, limits: GaitLimits, delay: float) -> Array:
    """`NominalConstants` and the bounds of the step, (10,)."""
    constants = NominalConstants(robot.omega, robot.pelvis_width, delay, 0.0)
    return np.array([*constants, *limits.low[:_BOX], *limits.high[:_BOX]])


@njit(cache=True, forceinline=True)
def hold_nominal(gait: Gait, k: int, observation: Array, constants: Array) -> None:
    """Hold the nominal step of the command that the observation (36,) of robot k repeats."""
    nominal, c = np.empty(NOMINAL_SIZE), nominal_constants_of(constants[:_LOW])
    nominal_gait_kernel(
        observation[_COMMAND], observation[_COMMAND + 1], c.pelvis_width, constants[_LOW : _LOW + _BOX],
        constants[_LOW + _BOX :], c.omega, c.delay, nominal, c.double_support,
    )  # fmt: skip
    plan = gait.plan[k]
    plan[STEP], plan[STEP + 1] = nominal[NOMINAL_STEP], nominal[NOMINAL_STEP + 1]
    plan[DURATION] = nominal[NOMINAL_DURATION]
    plan[COP:] = 0.0


@njit(cache=True, forceinline=True)
def follow_contacts(phys: Physics, gait: Gait, k: int, s: GaitSettings, joints: Joints) -> None:
    """Exchange the feet of robot k where its swing foot has landed.

    That foot was lifted in this step, or the stance foot is now: the robot then stands on the other. The
    heading goes on by what the command asked for in the step.
    """
    stance, air = gait.stance[k], joints.air[k]
    for leg in range(2):
        air[leg] = air[leg] + 1 if phys.load[k, leg] <= UNLOADED else 0
    if air[1 - stance] >= LIFTED:
        joints.lifted[k] = 1
    if joints.lifted[k] == 0 and air[stance] < LIFTED:
        return
    if has_landed(phys.load[k, 1 - stance], gait.elapsed[k], gait.plan[k, DURATION], s):
        gait.yaw[k, SWING] = gait.turn[k] * gait.elapsed[k]
        touch_down(phys, gait, k)
        gait.height[k, FLOOR] = sole_position(phys, k, gait.stance[k])[2]
        joints.lifted[k] = 0


BASE_VELOCITY = 0  # three entries [m/s]
BASE_RATE = 3  # three entries [rad/s]
GRAVITY_DIRECTION = 6  # three entries
HEADING_ERROR = 9  # yaw of the base over the heading [rad]
COMMAND_COLUMN = 10  # velocity x, y [m/s], turn [rad/s]
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
    """Motion of the base of robot k, its velocity with noise (canonical frame), gravity and the command."""
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
    o[COMMAND_COLUMN], o[COMMAND_COLUMN + 1] = command[0], frame.sign * command[1]
    o[COMMAND_COLUMN + 2] = frame.sign * command[TURN]


@njit(cache=True)
def observe_joints(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, joints: Joints, command: Array,
    noise: tuple[float, float], o: Array,
) -> None:  # fmt: skip
    """Write the observation (JOINT_OBSERVATION_SIZE,) of robot k, as control knows it, into `o`.

    `command` (4,) is in force, its velocity in the heading frame [m/s], turn [rad/s]; `noise` is that of the
    velocity, canonical frame [m/s].
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
    """Noise that an observation (36,) adds to the velocity of the one without it (36,) [m/s]."""
    first = COM_VELOCITY.start
    return seen[first] - known[first], seen[first + 1] - known[first + 1]
