"""The biped of `PushRecovery/Biped-v0`."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

import mujoco

from ...controllers.model.robot import REFERENCE, BodyPlan
from .compiled_robot import CompiledRobot, compiled_robot
from .description import RobotDescription

LEG = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")


def legs(joints: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of both legs' joints."""
    return tuple(f"left_{joint}" for joint in joints), tuple(f"right_{joint}" for joint in joints)


PLAN = BodyPlan(
    pelvis="pelvis",
    trunk="trunk",
    legs=legs(LEG),
    soles=("left_sole", "right_sole"),
    loads=("left_load", "right_load"),
    sole_boxes=("left_foot", "right_foot"),
    waist=("waist_pitch", "waist_roll"),
    bend=(0.0, 0.0, -0.3, 0.6, -0.3, 0.0),
)
BIPED = REFERENCE  # Table II; the model has it but for the trunk's inertia, 7.97 of its 8 kg m^2


def mjcf() -> str:
    """The model as its file has it."""
    return files("push_recovery.envs.robots").joinpath("biped.xml").read_text(encoding="utf-8")


def spec() -> mujoco.MjSpec:
    """The model, to be compiled or changed."""
    return mujoco.MjSpec.from_string(mjcf())


ROBOT = RobotDescription("biped", spec, PLAN, BIPED.com_height, model=BIPED)


def biped() -> CompiledRobot:
    """The biped, compiled; one copy per process."""
    return compiled_robot(ROBOT)


def biped_model() -> mujoco.MjModel:
    """Its model, never modified."""
    return biped().model
