"""The gait observation of n bipeds, and how far they are from what can be recovered."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..array_table import Floats1, Floats2
from ..jit import njit
from ..math3 import Vector, add, scaled, subtract, vector_at
from ..model import observation
from ..model.capturability import transfer_margin_kernel
from ..model.gait_box import COP, DURATION, TRUNK
from ..model.observation import WORLD_CMP, WORLD_COP, WORLD_DCM, Frame, canonical, canonical_frame, in_world
from ..model.standing import margin_on_both_feet
from ..whole_body import kinematics
from ..whole_body.gait_machine import FLOOR, MOMENT, Gait, GaitSettings, Point
from ..whole_body.kinematics import PELVIS, Array, Physics, sole_position
from ..whole_body.swing import TURN, turned_command

# Columns of the observation; of a pair (x, y) the first one
_DCM, _COM, _VELOCITY = observation.DCM.start, observation.COM.start, observation.COM_VELOCITY.start
_SWING, _SWING_VELOCITY = observation.SWING_POSITION.start, observation.SWING_VELOCITY.start
_ANGLE, _RATE = observation.TRUNK_ANGLE.start, observation.TRUNK_RATE.start
_PELVIS, _COMMAND = observation.PELVIS_ANGLE.start, observation.COMMAND.start
_PREVIOUS, _PUSH = observation.PREVIOUS_ACTION.start, observation.PUSH_ESTIMATE.start
CMP_OFF = 0.05  # of the CMP that acted from the planned one, from which the DCM counts as off its plan [m]


class Contacts(NamedTuple):
    """Forces and impulses of the contacts of n robots since they were last observed, and their speed then."""

    force: Floats2  # (n, 20) live generalised forces of contacts and joint limits (qfrc_constraint) [N, N m]
    impulse: Floats2  # (n, 3) in world axes [N s]
    time: Floats1  # (n,) since the last observation [s]
    velocity: Floats2  # (n, 3) of the CoM at the last observation [m/s]


@njit(cache=True, forceinline=True)
def count_contacts(contacts: Contacts, k: int, dt: float) -> None:
    """Add the contact forces of the physics step that robot k has just made.

    The rows of the free joint's translation hold the sum of all external contacts in world axes, which force
    sensors in the feet would measure: joint limits and contacts between two legs cancel in it.
    """
    for i in range(3):
        contacts.impulse[k, i] += dt * contacts.force[k, i]
    contacts.time[k] += dt


@njit(cache=True, forceinline=True)
def external_force(
    contacts: Contacts, k: int, mass: float, s: GaitSettings, velocity: Vector
) -> tuple[float, float]:
    """Mean external force over m omega^2 since the last observation of one robot, world axes [m]."""
    scale = 1.0 / (mass * s.omega**2 * contacts.time[k])
    x = scale * (mass * (velocity[0] - contacts.velocity[k, 0]) - contacts.impulse[k, 0])
    y = scale * (mass * (velocity[1] - contacts.velocity[k, 1]) - contacts.impulse[k, 1])
    return x, y


@njit(cache=True, forceinline=True)
def write_push_estimate(
    contacts: Contacts, k: int, mass: float, s: GaitSettings, frame: Frame, velocity: Vector, o: Array
) -> None:
    """Mean external force over m omega^2 since the last observation of one robot, canonical frame.

    delta = (m (v - v_before) - int f dt) / (m omega^2 time) [m], v the CoM's velocity, f the contact force:
    how inertial sensor, joint encoders and force sensors in the feet would see a push.
    Where no time has passed the entries stay.
    """
    if contacts.time[k] > 0.0:
        x, y = external_force(contacts, k, mass, s, velocity)
        o[_PUSH], o[_PUSH + 1] = canonical(frame, x, y)
    contacts.time[k] = 0.0
    for i in range(3):
        contacts.impulse[k, i] = 0.0
        contacts.velocity[k, i] = velocity[i]


@njit(cache=True, forceinline=True)
def write_motion(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, frame: Frame, velocity: Vector, omega: Vector,
    o: Array,
) -> None:  # fmt: skip
    """DCM, CoM and swing sole of one robot, canonical frame."""
    stance = gait.stance[k]
    sole, foot = sole_position(phys, k, stance), kinematics.sole_motion(phys, k, 1 - stance, omega)
    com = subtract(vector_at(phys.com, k, 0), sole)
    o[_COM], o[_COM + 1] = canonical(frame, com[0], com[1])
    o[_VELOCITY], o[_VELOCITY + 1] = canonical(frame, velocity[0], velocity[1])
    for axis in range(2):
        o[_DCM + axis] = o[_COM + axis] + o[_VELOCITY + axis] / s.omega
    o[observation.COM_HEIGHT_ERROR] = com[2] - s.com_height
    o[observation.COM_VERTICAL_VELOCITY] = velocity[2]
    place = subtract(foot.position, sole)
    o[_SWING], o[_SWING + 1] = canonical(frame, place[0], place[1])
    o[_SWING_VELOCITY], o[_SWING_VELOCITY + 1] = canonical(frame, foot.velocity[0], foot.velocity[1])
    o[_SWING + 2] = foot.position[2] - gait.height[k, FLOOR]
    o[_SWING_VELOCITY + 2] = foot.velocity[2]


@njit(cache=True, forceinline=True)
def lean(phys: Physics, k: int, body: int, frame: Frame) -> tuple[float, float]:
    """Lean of a body forwards and to the swing side [rad]."""
    x, y = canonical(frame, phys.xmat[k, body, 2], phys.xmat[k, body, 5])
    return math.atan2(x, phys.xmat[k, body, 8]), math.atan2(y, phys.xmat[k, body, 8])


@njit(cache=True, forceinline=True)
def write_posture(phys: Physics, gait: Gait, k: int, frame: Frame, omega: Vector, o: Array) -> None:
    """Lean of trunk and pelvis, heading and contacts of one robot, canonical frame."""
    o[_ANGLE], o[_ANGLE + 1] = lean(phys, k, kinematics.TRUNK, frame)
    trunk_omega = omega
    for j in range(2):
        axis = vector_at(phys.xaxis, k, kinematics.WAIST_JOINT + j)
        trunk_omega = add(trunk_omega, scaled(axis, phys.qvel[k, kinematics.WAIST_DOF + j]))
    # of the top, 1 m up: omega x z
    o[_RATE], o[_RATE + 1] = canonical(frame, trunk_omega[1], -trunk_omega[0])
    o[_PELVIS], o[_PELVIS + 1] = lean(phys, k, PELVIS, frame)
    x, y = canonical(frame, phys.xmat[k, PELVIS, 0], phys.xmat[k, PELVIS, 3])
    o[observation.HEADING_ERROR], o[observation.YAW_RATE] = math.atan2(y, x), frame.sign * omega[2]
    stance = gait.stance[k]
    o[observation.STANCE_CONTACT] = 1.0 if phys.load[k, stance] > 1.0 else 0.0
    o[observation.SWING_CONTACT] = 1.0 if phys.load[k, 1 - stance] > 1.0 else 0.0


@njit(cache=True, forceinline=True)
def write_world(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, frame: Frame, o: Array, world: Array
) -> None:
    """DCM, CoP and CMP of one robot in the world, (6,) [m]; the CoP is the one asked of the stance sole."""
    sole, vertical = sole_position(phys, k, gait.stance[k]), max(gait.wrench[k, 2], 1.0)
    dcm_x, dcm_y = in_world(frame, o[_DCM], o[_DCM + 1])
    pitch, roll = gait.plan[k, TRUNK], gait.plan[k, TRUNK + 1]
    shift_x, shift_y = in_world(frame, s.cmp_gain * pitch, s.cmp_gain * roll)
    world[WORLD_DCM], world[WORLD_DCM + 1] = sole[0] + dcm_x, sole[1] + dcm_y
    world[WORLD_COP] = sole[0] - gait.wrench[k, MOMENT + 1] / vertical
    world[WORLD_COP + 1] = sole[1] + gait.wrench[k, MOMENT] / vertical
    world[WORLD_CMP], world[WORLD_CMP + 1] = world[WORLD_COP] + shift_x, world[WORLD_COP + 1] + shift_y


@njit(cache=True, forceinline=True)
def tracks_plan(
    phys: Physics, gait: Gait, k: int, span: float, s: GaitSettings, before: Point, o: Array, world: Array
) -> bool:
    """Whether the DCM moved in the last `span` [s] as the plan would have it; True where a step ended in it.

    xi' = cmp + growth (xi - cmp) + (growth - 1) push, growth = exp(omega span). What is missing, over
    (growth - 1), is how far the CMP that acted was from the planned one; at most CMP_OFF of it is allowed.
    `before` is the DCM at the beginning of the period in the world [m]; of the observation `o` (36,) and the
    points `world` (6,) at the end, push estimate and DCM count.
    """
    if span <= 0.0 or gait.elapsed[k] < span - 1e-9:
        return True
    plan, sole = gait.plan[k], sole_position(phys, k, gait.stance[k])
    frame = canonical_frame(gait.heading[k], gait.stance[k])
    x, y = plan[COP] + s.cmp_gain * plan[TRUNK], plan[COP + 1] + s.cmp_gain * plan[TRUNK + 1]
    x, y = in_world(frame, x, y)
    push_x, push_y = in_world(frame, o[_PUSH], o[_PUSH + 1])
    growth = math.exp(s.omega * span)
    x = world[WORLD_DCM] - sole[0] - x - growth * (before[0] - sole[0] - x) - (growth - 1.0) * push_x
    y = world[WORLD_DCM + 1] - sole[1] - y - growth * (before[1] - sole[1] - y) - (growth - 1.0) * push_y
    return not math.hypot(x, y) > CMP_OFF * (growth - 1.0)


@njit(cache=True)
def observe(
    phys: Physics, gait: Gait, k: int, contacts: Contacts, mass: float, s: GaitSettings, command: Array,
    previous: Array, capture: Array, o: Array, world: Array,
) -> float:  # fmt: skip
    """Write observation (36,) and world points (6,) [m] of one robot; returns its capture margin [m].

    `capture` are `CaptureConstants`.
    """
    frame = canonical_frame(gait.heading[k], gait.stance[k])
    omega, velocity = kinematics.base_angular_velocity(phys, k), kinematics.com_velocity(phys, k)
    o[observation.ELAPSED] = gait.elapsed[k]
    write_motion(phys, gait, k, s, frame, velocity, omega, o)
    write_posture(phys, gait, k, frame, omega, o)
    o[_COMMAND], o[_COMMAND + 1] = command[0], frame.sign * command[1]
    if command[TURN] != 0.0:
        period = gait.plan[k, DURATION] + s.landing_delay
        x, y = turned_command(command[0], command[1], command[TURN], period, s.omega)
        o[_COMMAND], o[_COMMAND + 1] = x, frame.sign * y
    for i in range(previous.shape[0]):
        o[_PREVIOUS + i] = previous[i]
    write_push_estimate(contacts, k, mass, s, frame, velocity, o)
    write_world(phys, gait, k, s, frame, o, world)
    dcm, angle, rate = o[_DCM : _DCM + 2], o[_ANGLE : _ANGLE + 2], o[_RATE : _RATE + 2]
    other = o[_SWING : _SWING + 2]
    if gait.elapsed[k] < 0.0:
        return margin_on_both_feet(other, dcm, angle, rate, capture)
    left = max(s.double_support - gait.elapsed[k], 0.0)
    return transfer_margin_kernel(gait.elapsed[k], left, other, dcm, angle, rate, capture)
