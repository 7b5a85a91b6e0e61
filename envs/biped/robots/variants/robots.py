"""Three variants of the biped, each at odds with an assumption that a closed form makes.

They share the biped's preset. `robot="push_recovery.envs.biped.robots.variants.robots:ANKLE_ROLL_FIRST"` puts
one into an environment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco

from ..biped.robot import BIPED, PLAN, spec
from ..description import RobotDescription

SIDES = ("left", "right")
HIP_PLACES = {
    "hip_pitch": (0.0, 0.0, 0.03),
    "hip_roll": (-0.02, 0.0, 0.0),
    "hip_yaw": (0.015, 0.0, -0.05),
}  # [m]


def exchange(first: mujoco.MjsJoint, second: mujoco.MjsJoint) -> None:
    """Let two joints of a body change places in its chain, with their names, axes and ranges."""
    first_has = first.name, first.axis.copy(), first.range.copy()
    second_has = second.name, second.axis.copy(), second.range.copy()
    second.name = ""
    first.name, first.axis, first.range = second_has
    second.name, second.axis, second.range = first_has


def exchange_in_legs(model: mujoco.MjSpec, first: str, second: str) -> None:
    """`exchange` in both legs, and the largest torques and speeds with them, which motors have by joint."""
    for side in SIDES:
        exchange(model.joint(f"{side}_{first}"), model.joint(f"{side}_{second}"))


def pitch_roll_yaw_hips() -> mujoco.MjSpec:
    """Hips that pitch first and yaw last, about axes that do not meet."""
    model = spec()
    exchange_in_legs(model, "hip_yaw", "hip_pitch")
    for side in SIDES:
        for joint, place in HIP_PLACES.items():
            model.joint(f"{side}_{joint}").pos = place
    return model


def ankle_roll_first() -> mujoco.MjSpec:
    """Ankles that roll before they pitch."""
    model = spec()
    exchange_in_legs(model, "ankle_pitch", "ankle_roll")
    return model


def no_waist_roll() -> mujoco.MjSpec:
    """A waist that only pitches."""
    model = spec()
    model.delete(model.actuator("waist_roll"))
    model.delete(model.joint("waist_roll"))
    return model


def legs(joints: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of both legs' joints."""
    return tuple(f"left_{joint}" for joint in joints), tuple(f"right_{joint}" for joint in joints)


HIPS_PITCH_ROLL_YAW = RobotDescription(
    "hips pitch-roll-yaw, axes apart",
    pitch_roll_yaw_hips,
    replace(
        PLAN,
        legs=legs(("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")),
        bend=(-0.3, 0.0, 0.0, 0.6, -0.3, 0.0),
    ),
    BIPED.com_height,
)
ANKLE_ROLL_FIRST = RobotDescription(
    "ankle roll before pitch",
    ankle_roll_first,
    replace(
        PLAN,
        legs=legs(("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_roll", "ankle_pitch")),
        bend=(0.0, 0.0, -0.3, 0.6, 0.0, -0.3),
    ),
    BIPED.com_height,
)
NO_WAIST_ROLL = RobotDescription(
    "no waist roll", no_waist_roll, replace(PLAN, waist=("waist_pitch", None)), BIPED.com_height
)
VARIANTS = (HIPS_PITCH_ROLL_YAW, ANKLE_ROLL_FIRST, NO_WAIST_ROLL)
