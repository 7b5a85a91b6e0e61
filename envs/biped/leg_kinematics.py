"""Closed-form inverse kinematics of a six-joint leg (hip yaw-roll-pitch, knee, ankle pitch-roll).

The three hip axes meet in one point and the two ankle axes in another, so the position of the hip seen from
the foot fixes knee, ankle pitch and ankle roll, and the rest of the rotation the three hip joints
(Kajita et al., Introduction to Humanoid Robotics, section 2.5.2).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.compiled.kernels import njit
from ...controllers.whole_body.leg_inverse import YAW_ROLL_PITCH_AXES
from .robots.indices import Indices

SAME = 1e-12  # largest difference of lengths or axes that count as equal [m]


class LegGeometry(NamedTuple):
    """Lengths of such a leg [m], the left one as the right one."""

    thigh: float  # hip to knee
    shank: float  # knee to ankle
    ankle_height: float  # ankle above the sole
    hip_drop: float  # hip below the pelvis' origin
    hip_offset: float  # hip beside it


def leg_geometry(model: mujoco.MjModel, indices: Indices) -> LegGeometry | None:
    """The lengths of a robot's legs; None where the closed form does not hold for them.

    In the reference posture hip, knee, ankle and sole of such a leg are plumb below one another.
    """
    data, found = mujoco.MjData(model), []
    data.qpos[list(indices.qpos[:7])] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    mujoco.mj_kinematics(model, data)
    for side, joints, sole in zip((1.0, -1.0), indices.legs, indices.soles, strict=True):
        anchors, axes = data.xanchor[list(joints)], data.xaxis[list(joints)]
        hip, knee, ankle, end = anchors[0], anchors[3], anchors[4], data.site_xpos[sole]
        plumb = (knee - hip)[:2], (ankle - knee)[:2], (end - ankle)[:2]
        beside = *(anchors[1:3] - hip).ravel(), *(anchors[5] - ankle), *np.ravel(plumb), hip[0]
        turned = np.abs(axes - YAW_ROLL_PITCH_AXES).max()
        first = model.jnt_qposadr[joints[0]]
        in_a_row = [int(model.jnt_qposadr[joint]) for joint in joints] == list(range(first, first + 6))
        if max(np.abs(beside).max(), turned) > SAME or not in_a_row:
            return None
        found.append((hip[2] - knee[2], knee[2] - ankle[2], ankle[2] - end[2], -hip[2], side * hip[1]))
    if np.abs(np.subtract(*found)).max() > SAME:
        return None
    return LegGeometry(*np.round(found[0], 12).tolist())


def leg_joints(
    hip: NDArray[np.float64],
    pelvis: NDArray[np.float64],
    sole: NDArray[np.float64],
    foot: NDArray[np.float64],
    leg: LegGeometry,
) -> NDArray[np.float64]:
    """Joint angles that put the sole at a pose.

    Args:
        hip: hip centre in the world, (3,) [m].
        pelvis: rotation of the pelvis, (3, 3).
        sole: centre of the sole in the world, (3,) [m].
        foot: rotation of the foot, (3, 3).
        leg: its lengths.

    Returns:
        Hip yaw, roll, pitch, knee, ankle pitch, ankle roll, (6,) [rad]; out of reach, a straight leg.
    """
    x, y, z = foot.T @ (hip - sole - foot[:, 2] * leg.ankle_height)
    knee, pitch, roll = ankle_joints(x, y, z, leg)
    # foot = pelvis Rz(yaw) Rx(roll) Ry(pitch + knee + ankle_pitch) Rx(ankle_roll)
    hips = pelvis.T @ foot @ _rot_x(-roll) @ _rot_y(-knee - pitch)
    hip_roll = math.asin(max(-1.0, min(1.0, hips[2, 1])))
    yaw, hip_pitch = math.atan2(-hips[0, 1], hips[1, 1]), math.atan2(-hips[2, 0], hips[2, 2])
    return np.array([yaw, hip_roll, hip_pitch, knee, pitch, roll])


@njit(cache=True)
def ankle_joints(x, y, z, leg):  # pragma: no cover
    """Knee, ankle pitch and ankle roll [rad] that put the hip at (x, y, z) [m], seen from foot and ankle."""
    distance = min(math.sqrt(x * x + y * y + z * z), leg.thigh + leg.shank)
    cosine = (leg.thigh**2 + leg.shank**2 - distance**2) / (2 * leg.thigh * leg.shank)
    knee = math.pi - math.acos(max(-1.0, min(1.0, cosine)))
    lean = math.atan2(x, math.hypot(y, z))
    thigh_share = math.asin(max(-1.0, min(1.0, leg.thigh * math.sin(knee) / distance)))
    return knee, -lean - thigh_share, math.atan2(y, z)


@njit(cache=True)
def level_leg(pelvis, side, sole, leg, out):  # pragma: no cover
    """Write `leg_joints` (6,) of a level foot at heading 0 under an upright pelvis; hips need no yaw then.

    Args:
        pelvis: origin of the pelvis, (3,) [m].
        side: 1 for the left leg, -1 for the right one.
        sole: centre of the sole, (3,) [m].
        leg: its lengths.
        out: written.
    """
    knee, pitch, roll = ankle_joints(
        pelvis[0] - sole[0],
        pelvis[1] + side * leg.hip_offset - sole[1],
        pelvis[2] - leg.hip_drop - sole[2] - leg.ankle_height,
        leg,
    )
    out[0], out[1], out[2] = 0.0, -roll, -knee - pitch
    out[3], out[4], out[5] = knee, pitch, roll


def _rot_x(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _rot_y(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
