"""Closed-form inverse kinematics of a six-joint leg (hip yaw-roll-pitch, knee, ankle pitch-roll).

The three hip axes meet in one point and the two ankle axes in another, so the position of the hip seen from
the foot fixes knee, ankle pitch and ankle roll, and the rest of the rotation the three hip joints
(Kajita et al., Introduction to Humanoid Robotics, section 2.5.2).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

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
    ankle = sole + foot[:, 2] * ANKLE_HEIGHT
    to_hip = foot.T @ (hip - ankle)
    distance = min(float(np.linalg.norm(to_hip)), THIGH + SHANK)
    knee = math.pi - math.acos(max(-1.0, min(1.0, (THIGH**2 + SHANK**2 - distance**2) / (2 * THIGH * SHANK))))
    ankle_roll = math.atan2(to_hip[1], to_hip[2])
    lean = math.atan2(to_hip[0], math.hypot(to_hip[1], to_hip[2]))
    thigh_share = math.asin(max(-1.0, min(1.0, THIGH * math.sin(knee) / distance)))
    ankle_pitch = -lean - thigh_share
    # foot = pelvis Rz(yaw) Rx(roll) Ry(pitch + knee + ankle_pitch) Rx(ankle_roll)
    hips = pelvis.T @ foot @ _rot_x(-ankle_roll) @ _rot_y(-knee - ankle_pitch)
    yaw = math.atan2(-hips[0, 1], hips[1, 1])
    roll = math.asin(max(-1.0, min(1.0, hips[2, 1])))
    pitch = math.atan2(-hips[2, 0], hips[2, 2])
    return np.array([yaw, roll, pitch, knee, ankle_pitch, ankle_roll])


def _rot_x(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _rot_y(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
