"""A robot file and its preset from a model: guessed, scaled from the biped, written, and summarised.

How high a robot stands and how far it steps follows from postures within the ranges of its joints; its preset
is the biped's, scaled by the ratios of sizes, masses and inertias.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.model.capturability import max_recoverable_force
from ...controllers.model.robot import RobotModel
from ...controllers.settings import SWING_TIME, PresetFile, Scale, named_preset, scaled_preset
from ...envs.biped.core import BipedSettings
from ...envs.biped.posture import posture
from ...envs.robots.adapt import description_of
from ...envs.robots.biped import biped
from ...envs.robots.compiled_robot import CompiledRobot, compiled_robot
from ...envs.robots.description import RobotDescription
from ...envs.robots.indices import entry
from ...envs.robots.model_files import PACKAGES
from ...envs.robots.robot_file import Motor, RobotFile, write_robot_file
from ...envs.robots.source_model import VISUAL, SourceModel, add_shapes
from ..output.rows import require_place
from .guess import guess_plan, guess_soles, read_skeleton

BASE = "biped"  # the preset that is scaled
GAP, STRIDE = 0.011, 0.42  # of the biped: between soles at the narrowest step; the widest less l_p [m]
HIP_MOTORS = slice(2, 5)  # of the left leg, in the order of control
UPRIGHT = 0.7  # upward part of an axis, from where it counts as that of yaw
LEAST_RATIO = 1.2  # of the longest to the shortest step time
BENT = 0.875  # length of a standing leg over that of a straight one, the biped's
LOWERED = 0.24  # of its height the CoM may sink for a long step, the biped's
FINE = 0.005  # of a height and of a step that are searched [m]
TALLEST = 10.0  # height of a CoM over the soles of straight legs [m]
FARTHEST = 1.0  # step that is looked for [m]
DIGITS = 13  # that are told of a number
PUSH = 0.1  # of F* [s]
DIRECTIONS = 8
PROVISIONAL = 1.0  # CoM height before it is known [m]


def leg_length(body: CompiledRobot, data: mujoco.MjData | None = None) -> float:
    """Length of the left leg from first hip axis to ankle, by default in the reference posture [m]."""
    anchors = (data or body.in_reference_posture()).xanchor[list(body.indices.legs[0])]
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
    """Acceleration of the sole of the left leg, held straight, by the weaker of hip pitch and roll [m/s^2].

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
    """Ratios of a robot's sizes to the biped's; 1 for a waist that it does not have."""
    one, other = body.robot, biped().robot
    lean = leaning_inertia(body) / one.weight / one.com_height
    lean /= leaning_inertia(biped()) / other.weight / other.com_height

    def ratio(name: str) -> float:
        return getattr(one, name) / getattr(other, name)

    waist = {}
    if one.trunk_pitch or one.trunk_roll:
        inertia = ratio("trunk_inertia")
        waist = {
            "trunk_acceleration": ratio("trunk_torque_max") / inertia,
            "trunk_angle": ratio("trunk_angle_max"),
            "waist": inertia / (ratio("mass") * ratio("com_height")),
        }
    return Scale(
        length=ratio("com_height"), mass=ratio("mass"),
        foot_length=ratio("foot_length"), foot_width=ratio("foot_width"),
        leg=leg_length(body) / leg_length(biped()), lean=lean,
        swing=sole_acceleration(body) / sole_acceleration(biped()), **waist,
    )  # fmt: skip


def scaled_settings(
    body: CompiledRobot, changes: Mapping[str, Mapping[str, Any]] | None = None
) -> PresetFile:
    """The biped's preset scaled to a robot, its steps as wide as its hips are, with some fields changed.

    Slower legs make the shortest step longer, but not the nominal one. `changes` are section -> field ->
    value, of "planner" and of the sections of a robot.
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
    own["limits"]["duration_max"] = round(max(longest, LEAST_RATIO * shortest), 4)
    for section, values in (changes or {}).items():
        own[section] = {**own.get(section, {}), **values}
    return scaled_preset(preset, scale, own)


def standing_height(description: RobotDescription) -> float:
    """CoM height over level soles at which the legs are bent as the biped's are [m].

    Where the ranges of its joints end before, it is half-way between the heights at which it stands.
    """
    body = compiled_robot(description)
    data, posed = body.in_reference_posture(), mujoco.MjData(body.model)
    leg, stood = leg_length(body), list[float]()
    mujoco.mj_comPos(body.model, data)
    straight = data.subtree_com[0, 2] - data.site_xpos[body.indices.soles[0], 2]
    if straight > TALLEST:
        raise InvalidValueError(
            f"the CoM of robot {description.name!r} is {straight:.3g} m over its soles, it must be at most "
            f"{TALLEST:g} m: is its model in millimetres?"
        )
    for height in np.arange(straight, 0.6 * straight, -FINE):
        coordinates = _stands(body, height, (0.0, body.robot.pelvis_width))
        if coordinates is None and stood:
            break
        if coordinates is None:
            continue
        stood.append(float(height))
        posed.qpos[:] = coordinates
        mujoco.mj_kinematics(body.model, posed)
        if leg_length(body, posed) / leg <= BENT:
            return round(float(height), 3)
    if stood:
        return round(0.5 * (stood[0] + stood[-1]), 3)
    raise InvalidValueError(
        f"robot {description.name!r} does not stand with its CoM over its soles, {0.6 * straight:.2f} to "
        f"{straight:.2f} m high, within the ranges of its joints"
    )


def _stands(body: CompiledRobot, height: float, step: tuple[float, float]) -> np.ndarray | None:
    """Coordinates of a robot half-way between its soles, the left one a step before and beside the right.

    None where the joints of its legs leave their ranges.
    """
    x, y = step
    soles = np.array([[x, y, 0.0], [0.0, 0.0, 0.0]])
    try:
        coordinates = posture(body, np.array([0.5 * x, 0.5 * y, height]), np.zeros(3), soles)[0]
    except InvalidValueError:
        return None
    model, joints = body.model, np.array([*body.indices.legs[0], *body.indices.legs[1]])
    angles, limited = coordinates[model.jnt_qposadr[joints]], model.jnt_limited[joints].astype(bool)
    low, high = model.jnt_range[joints].T
    within = np.all(~limited | ((low <= angles) & (angles <= high)))
    return coordinates if within else None


def reachable_steps(description: RobotDescription, height: float) -> dict[str, float]:
    """Longest steps forward and back, and the widest, that a robot can stand in: fields of GaitLimits [m].

    The CoM is half-way between the soles and as high as it walks, or lower by up to what the biped sinks.
    """
    body = compiled_robot(replace(description, com_height=height))
    width = body.robot.pelvis_width

    def farthest(step: Callable[[float], tuple[float, float]]) -> float:
        """Largest length [m] up to which every step of FINE exists at some height."""
        reached = 0.0
        for length in np.arange(FINE, FARTHEST, 4.0 * FINE):
            heights = height * (1.0 - np.linspace(0.0, LOWERED, 5))
            if all(_stands(body, low, step(length)) is None for low in heights):
                break
            reached = float(length)
        return round(reached, 3)

    return {
        "length_max": farthest(lambda length: (length, width)),
        "length_min": -farthest(lambda length: (-length, width)),
        "width_max": round(width + farthest(lambda length: (0.0, width + length)), 3),
    }


@dataclass(frozen=True)
class NewRobot:
    """A robot of a model."""

    file: RobotFile
    preset: PresetFile
    body: CompiledRobot

    @property
    def limits(self) -> list[float]:
        """F* of its own box of steps by direction, counter-clockwise from forward [N]."""
        box = BipedSettings().changed(self.preset.robot()).of_robot(self.body.robot).limits
        angles = [2.0 * math.pi * k / DIRECTIONS for k in range(DIRECTIONS)]
        return [max_recoverable_force(self.body.robot, psi, PUSH, limits=box) for psi in angles]


def new_robot(model: str, name: str) -> NewRobot:
    """The robot of a model, MJCF or URDF.

    Args:
        model: its file, or PACKAGE/PATH.
        name: of the robot.

    Raises:
        InvalidValueError: no two legs, no feet, or no posture to stand in; joints without a largest torque;
            meshes or textures that are not there.
    """
    model = model if model.partition("/")[0] in PACKAGES else str(Path(model).absolute())
    skeleton = read_skeleton(model)
    plan, fixed = guess_plan(skeleton)
    soles = guess_soles(model, (plan.legs[0][-1], plan.legs[1][-1]))
    add_shapes(skeleton.source.rewritten(), skeleton.source, VISUAL)  # it reads meshes and textures
    file = RobotFile(
        name, model, plan, soles, _motors(skeleton.source, [joint for joint, _ in fixed]), fixed,
        PROVISIONAL, "biped", "guessed by push-recovery robot new; no motor has a speed without load",
    )  # fmt: skip
    height = standing_height(description_of(file))
    file = replace(file, com_height=height)
    body = compiled_robot(description_of(file))
    scaled = scaled_settings(body).robot()["limits"]
    reach = reachable_steps(description_of(file), height)
    box = {
        name: min(scaled[name], reach[name], key=abs) for name in ("length_min", "length_max", "width_max")
    }
    preset = scaled_settings(body, {"limits": box})
    return NewRobot(
        file, replace(preset, found={"by": "push-recovery robot new", "robot": told(body.robot)}), body
    )


def _motors(source: SourceModel, fixed: list[str]) -> tuple[tuple[str, Motor], ...]:
    """Largest torques of all joints but the fixed ones."""
    torques = source.torques
    joints = [name for name in map(source.name, source.joints) if name not in fixed]
    if unknown := [name for name in joints if name not in torques]:
        raise InvalidValueError(
            f"the model {source.place!r} does not tell the largest torque of {', '.join(unknown)}: give its "
            "joints an actuatorfrcrange, or its actuators a forcerange"
        )
    return tuple((name, Motor(torque=torques[name])) for name in joints)


def told(robot: RobotModel) -> dict[str, Any]:
    """The constants of a robot without the rounding of the words that its model was said in."""
    return {name: float(f"{one:.{DIGITS}g}") if isinstance(one, float) else one
            for name, one in asdict(robot).items()}  # fmt: skip


def save(robot: NewRobot, out: Path) -> tuple[Path, Path]:
    """Write NAME.robot.json and NAME.preset.json into a folder; returns both.

    Raises:
        InvalidValueError: one of them cannot be written there.
    """
    paths = out / f"{robot.file.name}.robot.json", out / f"{robot.file.name}.preset.json"
    for path in paths:
        require_place(path)
    robot.preset.save(paths[1])
    write_robot_file(paths[0], robot.file, paths[1].name)
    return paths


def summary(robot: NewRobot) -> dict[str, Any]:
    """All that was guessed and derived, in plain JSON types."""
    plan, model = robot.file.plan, robot.body.robot
    return {
        "name": robot.file.name, "pelvis": plan.pelvis, "trunk": plan.trunk, "left_leg": plan.legs[0],
        "right_leg": plan.legs[1], "waist": plan.waist, "held": dict(plan.held),
        "fixed": dict(robot.file.fixed), "soles": [asdict(sole) for sole in robot.file.soles],
        "robot": told(model), "limits": robot.preset.robot()["limits"], "limit_N": robot.limits,
    }  # fmt: skip
