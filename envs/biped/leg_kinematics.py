"""Closed-form inverse kinematics of a six-joint leg (hip yaw-roll-pitch, knee, ankle pitch-roll).

The three hip axes meet in one point and the two ankle axes in another, so the position of the hip seen from
the foot fixes knee, ankle pitch and ankle roll, and the rest of the rotation the three hip joints
(Kajita et al., Introduction to Humanoid Robotics, section 2.5.2).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.kernels import njit

THIGH = 0.36  # hip to knee [m]
SHANK = 0.36  # knee to ankle [m]
ANKLE_HEIGHT = 0.06  # ankle above the sole [m]
HIP_DROP = 0.05  # hip below the pelvis origin [m]
HIP_OFFSET = 0.10  # hip beside the pelvis origin [m]


def leg_joints(
    hip: NDArray[np.float64],
    pelvis: NDArray[np.float64],
    sole: NDArray[np.float64],
    foot: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Joint angles that put the sole at a pose.

    Args:
        hip: hip centre in the world, (3,) [m].
        pelvis: rotation of the pelvis, (3, 3).
        sole: centre of the sole in the world, (3,) [m].
        foot: rotation of the foot, (3, 3).

    Returns:
        Hip yaw, roll, pitch, knee, ankle pitch, ankle roll, (6,) [rad]; out of reach, a straight leg.
    """
    x, y, z = foot.T @ (hip - sole - foot[:, 2] * ANKLE_HEIGHT)
    knee, pitch, roll = ankle_joints(x, y, z)
    # foot = pelvis Rz(yaw) Rx(roll) Ry(pitch + knee + ankle_pitch) Rx(ankle_roll)
    hips = pelvis.T @ foot @ _rot_x(-roll) @ _rot_y(-knee - pitch)
    hip_roll = math.asin(max(-1.0, min(1.0, hips[2, 1])))
    yaw, hip_pitch = math.atan2(-hips[0, 1], hips[1, 1]), math.atan2(-hips[2, 0], hips[2, 2])
    return np.array([yaw, hip_roll, hip_pitch, knee, pitch, roll])


@njit(cache=True)
def ankle_joints(x, y, z):  # pragma: no cover
    """Knee, ankle pitch and ankle roll [rad] that put the hip at (x, y, z) [m], seen from foot and ankle."""
    distance = min(math.sqrt(x * x + y * y + z * z), THIGH + SHANK)
    cosine = (THIGH**2 + SHANK**2 - distance**2) / (2 * THIGH * SHANK)
    knee = math.pi - math.acos(max(-1.0, min(1.0, cosine)))
    lean = math.atan2(x, math.hypot(y, z))
    thigh_share = math.asin(max(-1.0, min(1.0, THIGH * math.sin(knee) / distance)))
    return knee, -lean - thigh_share, math.atan2(y, z)


@njit(cache=True)
def level_leg(pelvis, side, sole, out):  # pragma: no cover
    """Write `leg_joints` (6,) of a level foot at heading 0 under an upright pelvis; hips need no yaw then.

    Args:
        pelvis: origin of the pelvis, (3,) [m].
        side: 1 for the left leg, -1 for the right one.
        sole: centre of the sole, (3,) [m].
        out: written.
    """
    knee, pitch, roll = ankle_joints(
        pelvis[0] - sole[0],
        pelvis[1] + side * HIP_OFFSET - sole[1],
        pelvis[2] - HIP_DROP - sole[2] - ANKLE_HEIGHT,
    )
    out[0], out[1], out[2] = 0.0, -roll, -knee - pitch
    out[3], out[4], out[5] = knee, pitch, roll


def _rot_x(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _rot_y(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
