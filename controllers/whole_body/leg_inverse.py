"""The inverse of a leg's Jacobian, in closed form where its axes allow.

The three hip axes meet in one point, the two ankle axes in another, and hip pitch, knee and ankle pitch are
parallel. Seen from the pelvis, ankle and foot move by

    v = hip x r + knee s,    omega = hip + (knee + ankle_pitch) pitch + ankle_roll roll,

with hip the rotation that the three hip joints make together, r = ankle - hip and s the velocity of the ankle
per rate of the knee. The part of v along r is the knee's alone, what is across fixes the hip's rotation but
for that about r; what is left of omega divides between r and the two ankle axes.

A leg of other axes is solved with all six columns of its Jacobian. With the knee's column replaced by a
motion of the sole along r, the row of the inverse that belongs to it is n', the wrench that no other joint
feels, and c = n' J_knee the velocity along it per rate of the knee: the same c as above where the axes meet.

A knee that can go beyond straight counts as bent as much there: c keeps the sign that it has where the knee
is bent. With its true sign a leg that shall become shorter presses its knee into the stop.
"""

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

import math
from typing import NamedTuple

from numba.np.numpy_support import carray

from ..compiled.kernels import njit
from ..compiled.stack_array import stack_floats
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
from .kinematics import LEG_JOINT, MEETING_AXES, Array, Physics


class LegInverses(NamedTuple):
    """J^-1 of both legs: rate of joint i = velocity[leg, i] . v + omega[leg, i] . omega."""

    velocity: Array  # (2, 6, 3) [1/m]
    omega: Array  # (2, 6, 3)


YAW_ROLL_PITCH_AXES = (
    (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0),
)  # of a leg's joints in the reference posture, from hip to sole  # fmt: skip
SMALLEST = 1e-6  # pivot
YAW, ROLL, PITCH, KNEE, ANKLE_PITCH, ANKLE_ROLL = range(6)  # joints of a leg


@njit(cache=True, forceinline=True)
def _knee_rate(phys: Physics, leg: int, stretch: float, damping: float) -> float:
    """Rate of a knee per velocity along the leg, 1 / c with c = `stretch`, bounded near a straight one [1/m].

    A knee that can go beyond straight has the c of one that is bent.
    """
    bend = phys.knee_bend[leg]
    c = stretch if bend == 0.0 else -bend * abs(stretch)
    return c / (c * c + damping)


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
    if phys.leg_form[0] == MEETING_AXES:
        write_inverse_of_meeting_axes(phys, k, leg, sole, damping, inverses)
    else:
        write_inverse_of_any_axes(phys, k, leg, sole, damping, inverses)


@njit(cache=True, forceinline=True)
def write_inverse_of_meeting_axes(
    phys: Physics, k: int, leg: int, sole: Vector, damping: float, inverses: LegInverses
) -> None:
    """`write_leg_inverse` in closed form."""
    first = LEG_JOINT[leg]
    hip, shank = vector_at(phys.xanchor, k, first), vector_at(phys.xanchor, k, first + KNEE)
    ankle = vector_at(phys.xanchor, k, first + ANKLE_PITCH)
    yaw, roll = vector_at(phys.xaxis, k, first + YAW), vector_at(phys.xaxis, k, first + ROLL)
    pitch, foot = vector_at(phys.xaxis, k, first + PITCH), vector_at(phys.xaxis, k, first + ANKLE_ROLL)
    r, s, offset = subtract(ankle, hip), cross(pitch, subtract(ankle, shank)), subtract(sole, ankle)
    length = math.sqrt(dot(r, r))
    along = scaled(r, 1.0 / length)
    stretch = dot(along, s)
    knee = scaled(along, _knee_rate(phys, leg, stretch, damping))
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


@njit(cache=True)
def write_inverse_of_any_axes(
    phys: Physics, k: int, leg: int, sole: Vector, damping: float, inverses: LegInverses
) -> None:
    """`write_leg_inverse` from the leg's whole Jacobian."""
    first = LEG_JOINT[leg]
    J, inverse = carray(stack_floats(36), (6, 6)), carray(stack_floats(36), (6, 6))
    for j in range(6):
        axis = vector_at(phys.xaxis, k, first + j)
        linear = cross(axis, subtract(sole, vector_at(phys.xanchor, k, first + j)))
        for i in range(3):
            J[i, j], J[3 + i, j] = linear[i], axis[i]
    knee_v, knee_omega = (J[0, KNEE], J[1, KNEE], J[2, KNEE]), (J[3, KNEE], J[4, KNEE], J[5, KNEE])
    hip, ankle = vector_at(phys.xanchor, k, first), vector_at(phys.xanchor, k, first + ANKLE_PITCH)
    r = subtract(ankle, hip)
    along = scaled(r, 1.0 / math.sqrt(dot(r, r)))
    for i in range(3):
        J[i, KNEE], J[3 + i, KNEE] = along[i], 0.0
    invert_6(J, inverse)
    n_v, n_omega = vector_of(inverse[KNEE], 0), vector_of(inverse[KNEE], 3)
    stretch = dot(n_v, knee_v) + dot(n_omega, knee_omega)
    gain = _knee_rate(phys, leg, stretch, damping)
    for j in range(6):
        v, omega = vector_of(inverse[j], 0), vector_of(inverse[j], 3)
        share = gain if j == KNEE else -gain * (dot(v, knee_v) + dot(omega, knee_omega))
        kept = 0.0 if j == KNEE else 1.0
        for i in range(3):
            inverses.velocity[leg, j, i] = kept * v[i] + share * n_v[i]
            inverses.omega[leg, j, i] = kept * omega[i] + share * n_omega[i]


@njit(cache=True)
def invert_6(A: Array, inverse: Array) -> None:
    """Write the inverse of A (6, 6), which is used up: Gauss-Jordan elimination, pivots by columns.

    A pivot below SMALLEST counts as SMALLEST: rates stay finite in a posture where the leg is singular.
    """
    for i in range(6):
        for j in range(6):
            inverse[i, j] = 1.0 if i == j else 0.0
    for c in range(6):
        best = c
        for i in range(c + 1, 6):
            if abs(A[i, c]) > abs(A[best, c]):
                best = i
        for j in range(6):
            A[c, j], A[best, j] = A[best, j], A[c, j]
            inverse[c, j], inverse[best, j] = inverse[best, j], inverse[c, j]
        pivot = A[c, c] if abs(A[c, c]) > SMALLEST else math.copysign(SMALLEST, A[c, c])
        for j in range(6):
            A[c, j] /= pivot
            inverse[c, j] /= pivot
        for i in range(6):
            if i != c:
                factor = A[i, c]
                for j in range(6):
                    A[i, j] -= factor * A[c, j]
                    inverse[i, j] -= factor * inverse[c, j]


@njit(cache=True, forceinline=True)
def subtract_leg_torques(phys: Physics, k: int, leg: int, sole: Vector, wrench: Array, torque: Array) -> None:
    """Subtract J' w from the torques (14,) for the wrench (6,) on a sole."""
    force, moment, at = vector_of(wrench, 0), vector_of(wrench, 3), 2 + 6 * leg
    for j in range(6):
        arm = subtract(sole, vector_at(phys.xanchor, k, LEG_JOINT[leg] + j))
        torque[at + j] -= dot(vector_at(phys.xaxis, k, LEG_JOINT[leg] + j), add(moment, cross(arm, force)))
