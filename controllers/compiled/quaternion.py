"""Unit quaternions (w, x, y, z), MuJoCo's order, as tuples in compiled code."""

from __future__ import annotations

import math

from .kernels import njit
from .vector_3 import Vector

Quaternion = tuple[float, float, float, float]
SMALL = 1e-8  # rotation below which sin(a / 2) / a is taken for 1 / 2 [rad]


@njit(cache=True, forceinline=True)
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Rotation b, then a, both in fixed axes."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@njit(cache=True, forceinline=True)
def of_rotation(r: Vector) -> Quaternion:
    """Quaternion of a rotation vector [rad]."""
    angle = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    share = 0.5 if angle < SMALL else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), share * r[0], share * r[1], share * r[2]


@njit(cache=True, forceinline=True)
def rotation_of(q: Quaternion) -> Vector:
    """Rotation vector of a unit quaternion with w >= 0 [rad]."""
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    share = 2.0 if sine < SMALL else 2.0 * math.atan2(sine, q[0]) / sine
    return share * q[1], share * q[2], share * q[3]


@njit(cache=True, forceinline=True)
def normalised(q: Quaternion) -> Quaternion:
    """The unit quaternion along q, which must not be zero."""
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


@njit(cache=True, forceinline=True)
def rotated(q: Quaternion, a: Vector) -> Vector:
    """R(q) a = a + 2 w (u x a) + 2 u x (u x a), u the vector part."""
    x = q[2] * a[2] - q[3] * a[1]
    y = q[3] * a[0] - q[1] * a[2]
    z = q[1] * a[1] - q[2] * a[0]
    return (
        a[0] + 2.0 * (q[0] * x + q[2] * z - q[3] * y),
        a[1] + 2.0 * (q[0] * y + q[3] * x - q[1] * z),
        a[2] + 2.0 * (q[0] * z + q[1] * y - q[2] * x),
    )


@njit(cache=True, forceinline=True)
def conjugate(q: Quaternion) -> Quaternion:
    """The rotation back."""
    return q[0], -q[1], -q[2], -q[3]
