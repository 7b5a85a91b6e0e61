"""How large a robot is beside the biped, and the biped's settings for it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from .....controllers.settings.presets import PresetFile, named_preset
from .....controllers.settings.scaled_preset import SWING_TIME, Scale, scaled_preset
from ..biped.robot import biped
from ..compiled_robot import CompiledRobot
from ..control_fields import entry

BASE = "biped"  # the preset that is scaled
GAP, STRIDE = (
    0.011,
    0.42,
)  # of the biped: between the soles of its narrowest step, and its widest less l_p [m]
HIP_MOTORS = slice(2, 5)  # of the left leg, in the order of control
UPRIGHT = 0.7  # upward part of an axis, from where it counts as that of yaw
ROOM = 1.2  # least ratio of the longest to the shortest step time


def leg_length(body: CompiledRobot) -> float:
    """Of the left leg in the reference posture, from its first hip axis to the ankle [m]."""
    anchors = body.in_reference_posture().xanchor[list(body.indices.legs[0])]
    return float(np.linalg.norm(anchors[4] - anchors[0]))


def leaning_inertia(body: CompiledRobot) -> float:
    """Inertia of all but the legs about the axis through both hips, in the reference posture [kg m^2]."""
    model, data = body.model, body.in_reference_posture()
    hips = data.xanchor[[leg[0] for leg in body.indices.legs]].mean(axis=0)
    legs = {int(model.jnt_bodyid[leg[0]]) for leg in body.indices.legs}
    total = 0.0
    for part in range(1, model.nbody):
        above = part
        while above != 0 and above not in legs:
            above = int(model.body_parentid[above])
        if above == 0:
            across, arm = data.ximat[part].reshape(3, 3)[1], data.xipos[part] - hips
            total += float(model.body_inertia[part] @ across**2)
            total += float(model.body_mass[part] * (arm[0] ** 2 + arm[2] ** 2))
    return total


def sole_acceleration(body: CompiledRobot) -> float:
    """What the weaker of hip pitch and roll can give the sole of the left leg, held straight [m/s^2].

    tau l / i, with the height l of the hip over the sole and the inertia i of the leg and the motor about the
    joint's axis, which is its entry on the diagonal of the mass matrix.
    """
    model, data = body.model, body.in_reference_posture()
    mujoco.mj_forward(model, data)
    found = []
    for joint, torque in zip(body.indices.legs[0][:3], body.motors[0, HIP_MOTORS], strict=True):
        if abs(data.xaxis[joint, 2]) > UPRIGHT:  # it turns the leg about itself
            continue
        height = data.xanchor[joint, 2] - data.site_xpos[body.indices.soles[0], 2]
        dof = int(model.jnt_dofadr[joint])
        found.append(torque * height / data.M[entry(model, dof, dof)])
    return float(min(found))


def scale_of(body: CompiledRobot) -> Scale:
    """How many times as large a robot is as the biped; 1 for a waist that it does not have."""
    one, other = body.robot, biped().robot
    lean = leaning_inertia(body) / one.weight / one.com_height
    lean /= leaning_inertia(biped()) / other.weight / other.com_height
    waist = {}
    if one.trunk_pitch or one.trunk_roll:
        torque, inertia = (
            one.trunk_torque_max / other.trunk_torque_max,
            one.trunk_inertia / other.trunk_inertia,
        )
        height = one.com_height / other.com_height
        waist = {
            "trunk_acceleration": torque / inertia,
            "trunk_angle": one.trunk_angle_max / other.trunk_angle_max,
            "waist": inertia / (one.mass / other.mass * height),
        }
    return Scale(
        length=one.com_height / other.com_height, mass=one.mass / other.mass,
        foot_length=one.foot_length / other.foot_length, foot_width=one.foot_width / other.foot_width,
        leg=leg_length(body) / leg_length(biped()), lean=lean,
        swing=sole_acceleration(body) / sole_acceleration(biped()), **waist,
    )  # fmt: skip


def scaled_settings(
    body: CompiledRobot, changes: Mapping[str, Mapping[str, Any]] | None = None
) -> PresetFile:
    """The biped's preset scaled to a robot, its steps as wide as its hips are, with some fields changed.

    Slower legs make the shortest step longer, but not the nominal one.

    `changes` are section -> field -> value, of "planner" and of the sections of a robot.
    """
    robot, scale = body.robot, scale_of(body)
    own: dict[str, dict[str, Any]] = {
        "limits": {
            "width_min": round(robot.foot_width + GAP * scale.length, 4),
            "width_max": round(robot.pelvis_width + STRIDE * scale.length, 4),
            "cop_x_max": robot.foot_length / 2.0, "cop_y_max": robot.foot_width / 2.0,
            "trunk_acceleration_max": round(robot.trunk_torque_max / robot.trunk_inertia, 3),
        }
    }  # fmt: skip
    preset = named_preset(BASE)
    box = preset.robot()["limits"]
    shortest = box["duration_min"] * scale.factor(SWING_TIME)
    longest = (box["duration_min"] + box["duration_max"]) * scale.time - shortest  # the same nominal step
    own["limits"]["duration_max"] = round(max(longest, ROOM * shortest), 4)
    for section, values in (changes or {}).items():
        own[section] = {**own.get(section, {}), **values}
    return scaled_preset(preset, scale, own)
