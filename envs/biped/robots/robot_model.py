"""What the planner knows of a robot, read from its compiled model."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from ....controllers.model.robot import SMALLEST, RobotModel
from .indices import MISSING, Indices


def robot_model(data: mujoco.MjData, indices: Indices, com_height: float) -> RobotModel:
    """Mass, trunk, feet and pelvis width of a robot whose `data` is in its reference posture.

    The trunk's inertia j is that of all that the waist carries, about the pitch axis of the waist; torque and
    angle are the least of the waist's axes. Without a waist they do not count.
    """
    model = data.model
    soles = data.site_xpos[list(indices.soles)]
    length, width, _ = 2.0 * model.geom_size[indices.sole_boxes[0]]
    inertia, torque, angle = SMALLEST, SMALLEST, SMALLEST
    pitch, roll = (joint != MISSING for joint in indices.joints[1:3])
    waist = [(joint, motor) for joint, motor in zip(indices.joints[1:3], indices.motors[:2], strict=True)
             if joint != MISSING]  # fmt: skip
    if waist:
        inertia = trunk_inertia(data, indices)
        torque = min(float(model.actuator_forcerange[motor, 1]) for _, motor in waist)
        ranges = [np.abs(model.jnt_range[joint]).min() for joint, _ in waist if model.jnt_limited[joint]]
        angle = float(min([*ranges, math.pi / 2.0]))
    return RobotModel(
        mass=float(model.body_subtreemass[indices.pelvis]),
        com_height=com_height,
        trunk_inertia=inertia,
        trunk_torque_max=torque,
        trunk_angle_max=angle,
        foot_length=float(length),
        foot_width=float(width),
        pelvis_width=float(abs(soles[0, 1] - soles[1, 1])),
        trunk_pitch=pitch,
        trunk_roll=roll,
    )


def trunk_inertia(data: mujoco.MjData, indices: Indices) -> float:
    """Inertia of all that the waist carries about its first axis [kg m^2], of a placed `data`."""
    model = data.model
    joint = next(joint for joint in indices.joints[1:3] if joint != MISSING)
    axis, anchor, total = data.xaxis[joint], data.xanchor[joint], 0.0
    for body in range(model.nbody):
        above = body
        while above not in {0, indices.trunk}:
            above = int(model.body_parentid[above])
        if above == 0:
            continue
        arm = data.xipos[body] - anchor
        own = data.ximat[body].reshape(3, 3).T @ axis
        total += float(model.body_inertia[body] @ own**2)
        total += float(model.body_mass[body] * (arm @ arm - (arm @ axis) ** 2))
    return total
