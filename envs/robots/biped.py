"""The biped of `PushRecovery/Biped-v0`, and variants, each at odds with an assumption of a closed form.

`VARIANTS` differ in the order of their joints, `HELD_VARIANTS` have held joints, one body for pelvis and
trunk, or no waist: their trees are those of robots that exist, arms over a waist of yaw, roll and pitch, and
legs below a waist that only yaws. All share the biped's preset. An environment takes one as its robot by
`push_recovery.envs.robots.biped:NO_WAIST`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib.resources import files
from typing import Any

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


SIDES, WAIST = ("left", "right"), ("waist_pitch", "waist_roll")
HIP_PLACES = {
    "hip_pitch": (0.0, 0.0, 0.03),
    "hip_roll": (-0.02, 0.0, 0.0),
    "hip_yaw": (0.015, 0.0, -0.05),
}  # [m]


def exchange(first: mujoco.MjsJoint, second: mujoco.MjsJoint) -> None:
    """Let two joints of a body change places in its chain, with their names, axes and ranges."""
    first_has, second_has = ((one.name, one.axis.copy(), one.range.copy()) for one in (first, second))
    second.name = ""
    first.name, first.axis, first.range = second_has
    second.name, second.axis, second.range = first_has


def exchange_in_legs(first: str, second: str) -> mujoco.MjSpec:
    """The biped with two joints of each leg exchanged, and their largest torques and speeds with them."""
    model = spec()
    for side in SIDES:
        exchange(model.joint(f"{side}_{first}"), model.joint(f"{side}_{second}"))
    return model


def pitch_roll_yaw_hips() -> mujoco.MjSpec:
    """Hips that pitch first and yaw last, about axes that do not meet."""
    model = exchange_in_legs("hip_yaw", "hip_pitch")
    for side in SIDES:
        for joint, place in HIP_PLACES.items():
            model.joint(f"{side}_{joint}").pos = place
    return model


def without(made: Callable[[], mujoco.MjSpec], *joints: str) -> mujoco.MjSpec:
    """A model whose bodies are fixed where these joints were."""
    model = made()
    for joint in joints:
        model.delete(model.actuator(joint))
        model.delete(model.joint(joint))
    return model


def variant(name: str, made: Callable[[], mujoco.MjSpec], **plan: Any) -> RobotDescription:
    """A description with changes of the biped's plan."""
    return RobotDescription(name, made, replace(PLAN, **plan), BIPED.com_height)


HIPS_PITCH_ROLL_YAW = variant(
    "hips pitch-roll-yaw, axes apart",
    pitch_roll_yaw_hips,
    legs=legs(("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")),
    bend=(-0.3, 0.0, 0.0, 0.6, -0.3, 0.0),
)
ANKLE_ROLL_FIRST = variant(
    "ankle roll before pitch",
    partial(exchange_in_legs, "ankle_pitch", "ankle_roll"),
    legs=legs(("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_roll", "ankle_pitch")),
    bend=(0.0, 0.0, -0.3, 0.6, 0.0, -0.3),
)
NO_WAIST_ROLL = variant("no waist roll", partial(without, spec, "waist_roll"), waist=("waist_pitch", None))
VARIANTS = (HIPS_PITCH_ROLL_YAW, ANKLE_ROLL_FIRST, NO_WAIST_ROLL)


ARM = {"shoulder_pitch": 0.3, "shoulder_roll": 0.1, "elbow": -1.2}  # of the left arm [rad]
MIRRORED = {"shoulder_roll"}  # its angle changes sign on the right
ARM_TORQUE, YAW_TORQUE = 40.0, 100.0  # [N m]


def add_hinge(
    model: mujoco.MjSpec, body: mujoco.MjsBody, name: str, axis: Sequence[float], torque: float
) -> mujoco.MjsJoint:
    """A hinge with a torque motor of the same name."""
    joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    joint.limited, joint.range, joint.armature = True, [-150.0, 150.0], 0.01  # degrees, as in the file
    motor = model.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.forcelimited, motor.forcerange = True, [-torque, torque]
    return joint


def add_arm(model: mujoco.MjSpec, side: str) -> None:
    """An arm of 3 kg with two joints in the shoulder and one in the elbow."""
    left = 1.0 if side == "left" else -1.0
    upper = model.body("trunk").add_body(name=f"{side}_upper_arm", pos=[0.0, 0.24 * left, 0.40])
    upper.mass, upper.ipos, upper.inertia = 1.8, [0.0, 0.0, -0.13], [0.015, 0.015, 0.003]
    upper.explicitinertial = True
    add_hinge(model, upper, f"{side}_shoulder_pitch", [0.0, 1.0, 0.0], ARM_TORQUE)
    add_hinge(model, upper, f"{side}_shoulder_roll", [1.0, 0.0, 0.0], ARM_TORQUE)
    fore = upper.add_body(name=f"{side}_forearm", pos=[0.0, 0.0, -0.27])
    fore.mass, fore.ipos, fore.inertia = 1.2, [0.0, 0.0, -0.12], [0.008, 0.008, 0.001]
    fore.explicitinertial = True
    add_hinge(model, fore, f"{side}_elbow", [0.0, 1.0, 0.0], ARM_TORQUE)


def arms_over_a_waist_of_three() -> mujoco.MjSpec:
    """A waist that yaws, rolls, then pitches, and two arms, whose mass the trunk no longer has."""
    model = spec()
    trunk = model.body("trunk")
    trunk.mass = trunk.mass - 6.0
    yaw = add_hinge(model, trunk, "waist_yaw", [0.0, 0.0, 1.0], YAW_TORQUE)
    exchange(model.joint("waist_pitch"), yaw)  # yaw, roll, pitch
    for side in SIDES:
        add_arm(model, side)
    return model


def legs_below_a_yaw() -> mujoco.MjSpec:
    """Hips that yaw together below the body with the free joint, which is pelvis and trunk in one."""
    tree = ET.fromstring(mjcf())  # noqa: S314 - the package's own file
    pelvis = next(body for body in tree.iter("body") if body.get("name") == "pelvis")
    hips = ET.SubElement(pelvis, "body", name="hips")
    ET.SubElement(hips, "inertial", pos="0 0 0", mass="3", diaginertia="0.03 0.02 0.03")
    for thigh in [body for body in pelvis if str(body.get("name")).endswith("thigh")]:
        pelvis.remove(thigh)
        hips.append(thigh)
    whole = partial(mujoco.MjSpec.from_string, ET.tostring(tree, encoding="unicode"))
    model = without(whole, *WAIST)
    model.body("pelvis").mass -= 3.0
    add_hinge(model, model.body("hips"), "waist_yaw", [0.0, 0.0, 1.0], YAW_TORQUE)
    return model


def held_arms() -> tuple[tuple[str, float], ...]:
    """Names of all joints of the arms and their angles."""
    right = {name: -angle if name in MIRRORED else angle for name, angle in ARM.items()}
    angles = zip(SIDES, (ARM, right), strict=True)
    return tuple((f"{side}_{name}", angle) for side, arm in angles for name, angle in arm.items())


ARMS_HELD = variant(
    "arms and waist yaw held", arms_over_a_waist_of_three, held=(("waist_yaw", 0.0), *held_arms())
)
NO_WAIST = variant("no waist", partial(without, spec, *WAIST), waist=(None, None))
LEGS_BELOW_A_YAW = variant(
    "legs below a held yaw", legs_below_a_yaw, trunk="pelvis", waist=(None, None), held=(("waist_yaw", 0.0),)
)
HELD_VARIANTS = (ARMS_HELD, NO_WAIST, LEGS_BELOW_A_YAW)
