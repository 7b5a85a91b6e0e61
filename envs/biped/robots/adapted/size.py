"""How large a robot is beside the biped, and the biped's settings for it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .....controllers.settings.presets import PresetFile, named_preset
from .....controllers.settings.scaled_preset import Scale, scaled_preset
from ..biped.robot import biped
from ..compiled_robot import CompiledRobot

BASE = "biped"  # the preset that is scaled
GAP, STRIDE = (
    0.011,
    0.42,
)  # of the biped: between the soles of its narrowest step, and its widest less l_p [m]


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
        leg=leg_length(body) / leg_length(biped()), lean=lean, **waist,
    )  # fmt: skip


def scaled_settings(
    body: CompiledRobot, changes: Mapping[str, Mapping[str, Any]] | None = None
) -> PresetFile:
    """The biped's preset scaled to a robot, its steps as wide as its hips are, with some fields changed.

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
    for section, values in (changes or {}).items():
        own[section] = {**own.get(section, {}), **values}
    return scaled_preset(named_preset(BASE), scale, own)
