"""The inverse of a leg's Jacobian in closed form.

The three hip axes meet in one point, the two ankle axes in another, and hip pitch, knee and ankle pitch are
parallel. Seen from the pelvis, ankle and foot move by

    v = hip x r + knee s,    omega = hip + (knee + ankle_pitch) pitch + ankle_roll roll,

with hip the rotation that the three hip joints make together, r = ankle - hip and s the velocity of the ankle
per rate of the knee. The part of v along r is the knee's alone, what is across fixes the hip's rotation but
for that about r; what is left of omega divides between r and the two ankle axes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..compiled.kernels import njit
from ..compiled.vector_3 import (
    ZERO,
    Vector,
    add,
    cross,
    dot,
    dual_basis,
    scaled,
    subtract,
    vector_at,
    vector_of,
)
from .kinematics import LEG_JOINT, Array, Physics


class LegInverses(NamedTuple):
    """J^-1 of both legs: rate of joint i = velocity[leg, i] . v + omega[leg, i] . omega."""

    velocity: Array  # (2, 6, 3) [1/m]
    omega: Array  # (2, 6, 3)


YAW_ROLL_PITCH_AXES = (
    (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0),
)  # of a leg's joints in the reference posture, from hip to sole  # fmt: skip
YAW, ROLL, PITCH, KNEE, ANKLE_PITCH, ANKLE_ROLL = range(6)  # joints of a leg


@njit(cache=True, forceinline=True)
def _across(y: Vector, along: Vector, s: Vector, knee: Vector, length: float) -> Vector:
    """Product with v that gives y . (along x (v - s knee . v)) / length, the rotation of r about y."""
    out = cross(y, along)
    return scaled(subtract(out, scaled(knee, dot(out, s))), 1.0 / length)


@njit(cache=True, forceinline=True)
def _write_row(inverses: LegInverses, leg: int, joint: int, v: Vector, omega: Vector, offset: Vector) -> None:
    """Write a row of J^-1 whose joint has the rate v . (velocity of the ankle) + omega . (rotation)."""
    turn = subtract(omega, cross(offset, v))
    for i in range(3):
        inverses.velocity[leg, joint, i] = v[i]
        inverses.omega[leg, joint, i] = turn[i]


@njit(cache=True, forceinline=True)
def write_leg_inverse(
    phys: Physics, k: int, leg: int, sole: Vector, damping: float, inverses: LegInverses
) -> None:
    """Write J^-1 of a leg: rates of its joints from the twist of its sole relative to the pelvis.

    1 / c becomes c / (c^2 + damping), c the velocity of the ankle along the leg per rate of the knee [m]:
    that bounds the rates near a straight knee.
    """
    first = LEG_JOINT[leg]
    hip, shank = vector_at(phys.xanchor, k, first), vector_at(phys.xanchor, k, first + KNEE)
    ankle = vector_at(phys.xanchor, k, first + ANKLE_PITCH)
    yaw, roll = vector_at(phys.xaxis, k, first + YAW), vector_at(phys.xaxis, k, first + ROLL)
    pitch, foot = vector_at(phys.xaxis, k, first + PITCH), vector_at(phys.xaxis, k, first + ANKLE_ROLL)
    r, s, offset = subtract(ankle, hip), cross(pitch, subtract(ankle, shank)), subtract(sole, ankle)
    length = math.sqrt(dot(r, r))
    along = scaled(r, 1.0 / length)
    stretch = dot(along, s)
    knee = scaled(along, stretch / (stretch * stretch + damping))
    _write_row(inverses, leg, KNEE, knee, ZERO, offset)
    about_leg, about_pitch, about_foot = dual_basis(along, pitch, foot)
    spin = _across(about_leg, along, s, knee, length)  # rotation about r is about_leg . omega - spin . v
    v = add(knee, _across(about_pitch, along, s, knee, length))
    _write_row(inverses, leg, ANKLE_PITCH, scaled(v, -1.0), about_pitch, offset)
    v = _across(about_foot, along, s, knee, length)
    _write_row(inverses, leg, ANKLE_ROLL, scaled(v, -1.0), about_foot, offset)
    rows = dual_basis(yaw, roll, pitch)
    for i in range(3):
        share = dot(rows[i], along)
        v = subtract(_across(rows[i], along, s, knee, length), scaled(spin, share))
        _write_row(inverses, leg, YAW + i, v, scaled(about_leg, share), offset)


@njit(cache=True, forceinline=True)
def subtract_leg_torques(phys: Physics, k: int, leg: int, sole: Vector, wrench: Array, torque: Array) -> None:
    """Subtract J' w from the torques (14,) for the wrench (6,) on a sole."""
    force, moment, at = vector_of(wrench, 0), vector_of(wrench, 3), 2 + 6 * leg
    for j in range(6):
        arm = subtract(sole, vector_at(phys.xanchor, k, LEG_JOINT[leg] + j))
        torque[at + j] -= dot(vector_at(phys.xaxis, k, LEG_JOINT[leg] + j), add(moment, cross(arm, force)))
