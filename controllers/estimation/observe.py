"""The gait observation of n bipeds, and how far they are from what can be recovered."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..compiled.kernels import njit
from ..compiled.vector_3 import Vector, add, scaled, subtract, vector_at
from ..model.capturability import capture_margin_kernel
from ..model.frame import Frame, canonical, canonical_frame, in_world
from ..whole_body.gait_machine import Gait, GaitSettings, Point
from ..whole_body.kinematics import (
    PELVIS,
    TRUNK,
    WAIST_DOF,
    WAIST_JOINT,
    Array,
    Physics,
    base_angular_velocity,
    sole_motion,
    sole_position,
)
from ..whole_body.mass_matrix import com_velocity
from ..whole_body.turning import turned_command

CMP_OFF = 0.05  # of the CMP that acted from the planned one, from which the DCM counts as off its plan [m]


class Contacts(NamedTuple):
    """What the contacts gave n robots since they were last observed, and how fast they were then."""

    force: Array  # (n, 20) live generalised forces of contacts and joint limits (qfrc_constraint) [N, N m]
    impulse: Array  # (n, 3) in world axes [N s]
    time: Array  # (n,) since the last observation [s]
    velocity: Array  # (n, 3) of the CoM at the last observation [m/s]


@njit(cache=True, forceinline=True)
def count_contacts(contacts: Contacts, k: int, dt: float) -> None:
    """Add the contact forces of the physics step that robot k has just made.

    The rows of the free joint's translation hold the sum of all external contacts in world axes, which force
    sensors in the feet would measure: joint limits and contacts between two legs cancel in it.
    """
    contacts.impulse[k, 0] += dt * contacts.force[k, 0]
    contacts.impulse[k, 1] += dt * contacts.force[k, 1]
    contacts.impulse[k, 2] += dt * contacts.force[k, 2]
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
    """Mean external force over m omega^2 since the last observation (34-35) of one robot, canonical frame.

    delta = (m (v - v_before) - int f dt) / (m omega^2 time) [m], v the CoM's velocity, f the contact force:
    what inertial sensor, joint encoders and force sensors in the feet would tell of a push.
    Where no time has passed the entries stay.
    """
    if contacts.time[k] > 0.0:
        x, y = external_force(contacts, k, mass, s, velocity)
        o[34], o[35] = canonical(frame, x, y)
    contacts.time[k] = 0.0
    for i in range(3):
        contacts.impulse[k, i] = 0.0
        contacts.velocity[k, i] = velocity[i]


@njit(cache=True, forceinline=True)
def write_motion(
    phys: Physics,
    gait: Gait,
    k: int,
    s: GaitSettings,
    frame: Frame,
    velocity: Vector,
    omega: Vector,
    o: Array,
) -> None:
    """DCM, CoM and swing sole (observation 1-14) of one robot, canonical frame."""
    stance = gait.stance[k]
    sole, foot = sole_position(phys, k, stance), sole_motion(phys, k, 1 - stance, omega)
    com = subtract(vector_at(phys.com, k, 0), sole)
    o[3], o[4] = canonical(frame, com[0], com[1])
    o[5], o[6] = canonical(frame, velocity[0], velocity[1])
    o[1], o[2] = o[3] + o[5] / s.omega, o[4] + o[6] / s.omega
    o[7], o[8] = com[2] - s.com_height, velocity[2]
    place = subtract(foot.position, sole)
    o[9], o[10] = canonical(frame, place[0], place[1])
    o[12], o[13] = canonical(frame, foot.velocity[0], foot.velocity[1])
    o[11], o[14] = foot.position[2] - gait.height[k, 3], foot.velocity[2]


@njit(cache=True, forceinline=True)
def lean(phys: Physics, k: int, body: int, frame: Frame) -> tuple[float, float]:
    """Lean of a body forwards and to the swing side [rad]."""
    x, y = canonical(frame, phys.xmat[k, body, 2], phys.xmat[k, body, 5])
    return math.atan2(x, phys.xmat[k, body, 8]), math.atan2(y, phys.xmat[k, body, 8])


@njit(cache=True, forceinline=True)
def write_posture(phys: Physics, gait: Gait, k: int, frame: Frame, omega: Vector, o: Array) -> None:
    """Lean of trunk and pelvis, heading and contacts (observation 15-24) of one robot, canonical frame."""
    o[15], o[16] = lean(phys, k, TRUNK, frame)
    trunk_omega = omega
    for j in range(2):
        axis, rate = vector_at(phys.xaxis, k, WAIST_JOINT + j), phys.qvel[k, WAIST_DOF + j]
        trunk_omega = add(trunk_omega, scaled(axis, rate))
    o[17], o[18] = canonical(frame, trunk_omega[1], -trunk_omega[0])  # of the top, 1 m up: omega x z
    o[19], o[20] = lean(phys, k, PELVIS, frame)
    x, y = canonical(frame, phys.xmat[k, PELVIS, 0], phys.xmat[k, PELVIS, 3])
    o[21], o[22] = math.atan2(y, x), frame.sign * omega[2]
    stance = gait.stance[k]
    o[23] = 1.0 if phys.load[k, stance] > 1.0 else 0.0
    o[24] = 1.0 if phys.load[k, 1 - stance] > 1.0 else 0.0


@njit(cache=True, forceinline=True)
def write_world(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, frame: Frame, o: Array, world: Array
) -> None:
    """DCM, CoP and CMP of one robot in the world, (6,) [m]; the CoP is the one asked of the stance sole."""
    sole, vertical = sole_position(phys, k, gait.stance[k]), max(gait.wrench[k, 2], 1.0)
    dcm_x, dcm_y = in_world(frame, o[1], o[2])
    shift_x, shift_y = in_world(frame, s.cmp_gain * gait.plan[k, 5], s.cmp_gain * gait.plan[k, 6])
    world[0], world[1] = sole[0] + dcm_x, sole[1] + dcm_y
    world[2] = sole[0] - gait.wrench[k, 4] / vertical
    world[3] = sole[1] + gait.wrench[k, 3] / vertical
    world[4], world[5] = world[2] + shift_x, world[3] + shift_y


@njit(cache=True, forceinline=True)
def tracks_plan(
    phys: Physics, gait: Gait, k: int, span: float, s: GaitSettings, before: Point, o: Array, world: Array
) -> bool:
    """Whether the DCM moved in the last `span` [s] as the plan would have it; True where a step ended in it.

    xi' = cmp + growth (xi - cmp) + (growth - 1) push, growth = exp(omega span). What is missing, over
    (growth - 1), is how far the CMP that acted was from the planned one; at most CMP_OFF of it is allowed.

    Args:
        phys: of all robots, and so the gait machines.
        gait: their state, with the plan that was held.
        k: the robot.
        span: of the period [s].
        s: constants.
        before: DCM at the beginning of the period, world [m].
        o: observation (36,), of which the push estimate.
        world: points (6,) at the end, of which the DCM [m].
    """
    if span <= 0.0 or gait.elapsed[k] < span - 1e-9:
        return True
    plan, sole = gait.plan[k], sole_position(phys, k, gait.stance[k])
    frame = canonical_frame(gait.heading[k], gait.stance[k])
    x, y = in_world(frame, plan[3] + s.cmp_gain * plan[5], plan[4] + s.cmp_gain * plan[6])
    push_x, push_y = in_world(frame, o[34], o[35])
    growth = math.exp(s.omega * span)
    x = world[0] - sole[0] - x - growth * (before[0] - sole[0] - x) - (growth - 1.0) * push_x
    y = world[1] - sole[1] - y - growth * (before[1] - sole[1] - y) - (growth - 1.0) * push_y
    return not math.hypot(x, y) > CMP_OFF * (growth - 1.0)


@njit(cache=True)
def observe(
    phys: Physics, gait: Gait, k: int, contacts: Contacts, mass: float, s: GaitSettings, command: Array,
    previous: Array, capture: Array, o: Array, world: Array,
) -> float:  # fmt: skip
    """Write observation (36,) and world points (6,) [m] of one robot; returns its capture margin [m]."""
    frame = canonical_frame(gait.heading[k], gait.stance[k])
    omega, velocity = base_angular_velocity(phys, k), com_velocity(phys, k)
    o[0] = gait.elapsed[k]
    write_motion(phys, gait, k, s, frame, velocity, omega, o)
    write_posture(phys, gait, k, frame, omega, o)
    o[25], o[26] = command[0], frame.sign * command[1]
    if command[2] != 0.0:
        period = gait.plan[k, 2] + s.landing_delay
        told = turned_command(command[0], command[1], command[2], period, s.omega)
        o[25], o[26] = told[0], frame.sign * told[1]
    for i in range(previous.shape[0]):
        o[27 + i] = previous[i]
    write_push_estimate(contacts, k, mass, s, frame, velocity, o)
    write_world(phys, gait, k, s, frame, o, world)
    return capture_margin_kernel(o[0], o[1:3], o[15:17], o[17:19], capture)
