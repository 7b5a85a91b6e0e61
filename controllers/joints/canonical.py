"""The joints in canonical order: waist, stance leg, swing leg, as if the robot stood on its right foot.

A robot that stands on its left foot is seen in a mirror, so left and right are one problem, as for gaits
(`model.frame`). With s the sign of the canonical y, a mirror leaves of a polar vector (x, s y, z), of an
axial one (s x, y, s z), and turns the coordinate of each joint by its own sign (`Physics.mirror`).
"""

from __future__ import annotations

from ..compiled.kernels import njit
from ..compiled.vector_3 import Vector
from ..whole_body.kinematics import NU, Array

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
