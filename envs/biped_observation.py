"""The gait observation of n bipeds, and how far they are from what can be recovered."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..controllers.capturability import capture_margin_kernel
from .biped_gait import Gait, GaitSettings, side_sign
from .biped_kinematics import (
    PELVIS,
    TRUNK,
    WAIST_DOF,
    WAIST_JOINT,
    Array,
    Ints,
    Physics,
    base_angular_velocity,
    com_velocity,
    sole_motion,
    sole_position,
)


class Contacts(NamedTuple):
    """What the contacts gave n robots since they were last observed, and how fast they were then."""

    force: Array  # (n, 20) live generalised forces of contacts and joint limits (qfrc_constraint) [N, N m]
    impulse: Array  # (n, 2) horizontal, in world axes [N s]
    time: Array  # (n,) since the last observation [s]
    velocity: Array  # (n, 3) of the CoM at the last observation [m/s]


@njit(cache=True)
def count_contacts(contacts: Contacts, k: int, dt: float) -> None:
    """Add the contact forces of the physics step that robot k has just made.

    The rows of the free joint's translation hold the sum of all external contacts in world axes, which force
    sensors in the feet would measure: joint limits and contacts between two legs cancel in it.
    """
    contacts.impulse[k, 0] += dt * contacts.force[k, 0]
    contacts.impulse[k, 1] += dt * contacts.force[k, 1]
    contacts.time[k] += dt


@njit(cache=True)
def write_push_estimate(
    contacts: Contacts, gait: Gait, k: int, s: GaitSettings, velocity: Array, o: Array
) -> None:
    """Mean external force over m omega^2 since the last observation (34-35) of one robot, canonical frame.

    delta = (m (v - v_before) - int f dt) / (m omega^2 time) [m], v the CoM's velocity, f the contact force:
    what inertial sensor, joint encoders and force sensors in the feet would tell of a push.
    Where no time has passed the entries stay.
    """
    span = contacts.time[k]
    if span > 0.0:
        scale = 1.0 / (s.mass * s.omega**2 * span)
        x = scale * (s.mass * (velocity[0] - contacts.velocity[k, 0]) - contacts.impulse[k, 0])
        y = scale * (s.mass * (velocity[1] - contacts.velocity[k, 1]) - contacts.impulse[k, 1])
        cos, sin = np.cos(gait.heading[k]), np.sin(gait.heading[k])
        o[34], o[35] = cos * x + sin * y, side_sign(gait.stance[k]) * (-sin * x + cos * y)
    contacts.impulse[k] = 0.0
    contacts.time[k] = 0.0
    contacts.velocity[k] = velocity


@njit(cache=True)
def write_motion(
    phys: Physics, gait: Gait, k: int, s: GaitSettings, velocity: Array, o: Array, omega: Array
) -> None:
    """DCM, CoM and swing sole (observation 1-14) of one robot, canonical frame."""
    stance = gait.stance[k]
    sign = side_sign(stance)
    cos, sin = np.cos(gait.heading[k]), np.sin(gait.heading[k])
    sole, foot = sole_position(phys, k, stance), sole_motion(phys, k, 1 - stance, omega)
    com = phys.com[k, 0]
    dx, dy = com[0] - sole[0], com[1] - sole[1]
    o[3], o[4] = cos * dx + sin * dy, sign * (-sin * dx + cos * dy)
    o[5], o[6] = cos * velocity[0] + sin * velocity[1], sign * (-sin * velocity[0] + cos * velocity[1])
    o[1], o[2] = o[3] + o[5] / s.omega, o[4] + o[6] / s.omega
    o[7], o[8] = com[2] - sole[2] - s.com_height, velocity[2]
    p, v = foot.position, foot.twist
    dx, dy = p[0] - sole[0], p[1] - sole[1]
    o[9], o[10], o[11] = cos * dx + sin * dy, sign * (-sin * dx + cos * dy), p[2]
    o[12], o[13], o[14] = cos * v[0] + sin * v[1], sign * (-sin * v[0] + cos * v[1]), v[2]


@njit(cache=True)
def write_posture(phys: Physics, gait: Gait, k: int, o: Array, omega: Array) -> None:
    """Lean of trunk and pelvis, heading and contacts (observation 15-24) of one robot, canonical frame."""
    sign = side_sign(gait.stance[k])
    cos, sin = np.cos(gait.heading[k]), np.sin(gait.heading[k])
    trunk_omega = omega.copy()
    for j in range(2):
        for i in range(3):
            trunk_omega[i] += phys.xaxis[k, WAIST_JOINT + j, i] * phys.qvel[k, WAIST_DOF + j]
    for b in range(2):
        R = phys.xmat[k, TRUNK] if b == 0 else phys.xmat[k, PELVIS]
        o[15 + 4 * b] = np.arctan2(cos * R[2] + sin * R[5], R[8])
        o[16 + 4 * b] = sign * np.arctan2(-sin * R[2] + cos * R[5], R[8])
    o[17] = -sin * trunk_omega[0] + cos * trunk_omega[1]
    o[18] = -sign * (cos * trunk_omega[0] + sin * trunk_omega[1])
    yaw = np.arctan2(phys.xmat[k, PELVIS, 3], phys.xmat[k, PELVIS, 0]) - gait.heading[k]
    o[21] = sign * np.arctan2(np.sin(yaw), np.cos(yaw))
    o[22] = sign * omega[2]
    o[23] = 1.0 if phys.load[k, gait.stance[k]] > 1.0 else 0.0
    o[24] = 1.0 if phys.load[k, 1 - gait.stance[k]] > 1.0 else 0.0


@njit(cache=True)
def write_world(phys: Physics, gait: Gait, k: int, s: GaitSettings, o: Array, world: Array) -> None:
    """DCM, CoP and CMP of one robot in the world, (6,) [m]; the CoP is the one asked of the stance sole."""
    sign = side_sign(gait.stance[k])
    cos, sin = np.cos(gait.heading[k]), np.sin(gait.heading[k])
    sole, wrench = sole_position(phys, k, gait.stance[k]), gait.wrench[k]
    vertical = max(wrench[2], 1.0)
    dcm_x, dcm_y = o[1], sign * o[2]
    shift_x, shift_y = s.cmp_gain * gait.plan[k, 5], sign * s.cmp_gain * gait.plan[k, 6]
    world[0], world[1] = sole[0] + cos * dcm_x - sin * dcm_y, sole[1] + sin * dcm_x + cos * dcm_y
    world[2], world[3] = sole[0] - wrench[4] / vertical, sole[1] + wrench[3] / vertical
    world[4] = world[2] + cos * shift_x - sin * shift_y
    world[5] = world[3] + sin * shift_x + cos * shift_y


@njit(cache=True)
def observe(
    phys: Physics, gait: Gait, k: int, contacts: Contacts, s: GaitSettings, index: Ints, command: Array,
    previous: Array, capture: Array, o: Array, world: Array,
) -> float:  # fmt: skip
    """Write observation (36,) and world points (6,) [m] of one robot; returns its capture margin [m]."""
    omega, velocity = base_angular_velocity(phys, k), com_velocity(phys, k, index)
    o[0] = gait.elapsed[k]
    write_motion(phys, gait, k, s, velocity, o, omega)
    write_posture(phys, gait, k, o, omega)
    sign = side_sign(gait.stance[k])
    cos, sin = np.cos(gait.heading[k]), np.sin(gait.heading[k])
    o[25] = cos * command[0] + sin * command[1]
    o[26] = sign * (-sin * command[0] + cos * command[1])
    o[27:34] = previous
    write_push_estimate(contacts, gait, k, s, velocity, o)
    write_world(phys, gait, k, s, o, world)
    return capture_margin_kernel(o[0], o[1:3], o[15:17], o[17:19], capture)
