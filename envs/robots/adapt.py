"""Somebody else's model made ready to walk here, after its robot file: joints, motors, feet, world, shapes.

Shapes of the model are left out of the physics: the soles become boxes that touch the floor and each other,
the shanks capsules that touch the other leg, and everything else touches nothing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import lru_cache, partial
from importlib.resources import files
from itertools import chain
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ...controllers.errors import InvalidValueError, UnknownNameError
from .description import RobotDescription
from .model_files import model_digest
from .robot_file import SIDES, Angles, Motor, RobotFile, Sole, read_robot_file
from .source_model import (
    FREE,
    HINGE,
    INERT,
    KINDS,
    NONE,
    SOLID,
    VISUAL,
    SourceModel,
    add_shapes,
    conjugate,
    move_joint,
    read_source,
    turn_body,
    turned,
)

ARMATURE = 0.01  # of a joint whose model has none [kg m^2]


def fix_joints(spec: mujoco.MjSpec, fixed: Angles) -> None:
    """Take joints out of a model; their bodies keep the angles.

    Raises:
        UnknownNameError: a joint that the model does not have.
    """
    names = [joint.name for joint in spec.joints]
    for name, angle in fixed:
        if name not in names:
            raise UnknownNameError("fixed joint", name, names)
        joint = spec.joint(name)
        if angle:
            move_joint(joint, angle)
        spec.delete(joint)


def add_motors(
    spec: mujoco.MjSpec, robot: RobotFile, torques: Mapping[str, float], names: Collection[str]
) -> None:
    """Put a torque motor on every hinge, with neither friction nor damping, of which control knows nothing.

    Args:
        spec: a robot written anew.
        robot: its file.
        torques: largest torque of joints by the model [N m].
        names: of all joints of the model, the fixed ones too.

    Raises:
        InvalidValueError: a joint that is no hinge, or without a largest torque.
    """
    spec.nuser_actuator = 1
    for joint in spec.joints:
        if joint.type == FREE:
            continue
        if joint.type != HINGE:
            raise InvalidValueError(
                f"joint {joint.name!r} is a {KINDS[joint.type]}: it must be a hinge or be named in 'fixed'"
            )
        motor = motor_of_file(robot, joint.name, names)
        torque = largest_torque(motor, joint.name, torques)
        if not torque or not torque > 0.0:
            raise InvalidValueError(f"joint {joint.name!r} has no largest torque: name it in 'motors'")
        joint.solref_limit = [0.01, 1.0]
        joint.armature = motor.armature if motor.armature is not None else joint.armature or ARMATURE
        added = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        added.forcelimited, added.forcerange, added.ctrllimited = True, [-torque, torque], False
        added.userdata = [motor.speed or 0.0]


def largest_torque(motor: Motor, joint: str, torques: Mapping[str, float]) -> float | None:
    """Largest torque of a joint, as a file says of its motor or else as the model does [N m]."""
    return motor.torque if motor.torque is not None else torques.get(joint)


def motor_of_file(robot: RobotFile, joint: str, names: Collection[str]) -> Motor:
    """What a file says of a joint's motor: under its name, or under the first pattern that fits.

    Args:
        robot: the file.
        joint: the joint.
        names: of all joints; a key that is one of them is that joint's alone, whatever brackets it has.
    """
    motors = dict(reversed(robot.motors))
    if joint in motors:
        return motors[joint]
    fits = (motor for name, motor in robot.motors if name not in names and fnmatchcase(joint, name))
    return next(fits, Motor())


OWN_SHAPES = "floor", *(f"{side}_{part}" for side in SIDES for part in ("foot_sole", "shank_capsule"))
THICKNESS = 0.02  # of the box [m]
MARGIN = 0.02  # by which the region of the load sensor is larger than the sole [m]
SHANK_RADIUS = 0.08  # of the capsule in a shank over its length
FRICTION, HARDNESS = [0.9, 0.9, 0.005, 0.0001, 0.0001], [0.01, 1.0]  # as the biped's
CAPSULE: dict[str, Any] = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "material": "pr_shell", **INERT}


def add_feet(spec: mujoco.MjSpec, robot: RobotFile) -> None:
    """Give both legs a sole that touches floor and other foot, and a shank that touches the other leg.

    The shank is a capsule from knee to ankle, eight tenths as long as the way between them.
    """
    for side, leg, sole in zip(SIDES, robot.plan.legs, robot.soles, strict=True):
        foot, knee = spec.joint(leg[5]).parent, spec.joint(leg[3])
        turn_body(foot, sole.turn)
        _add_sole(spec, foot, side, sole)
        start = np.array(knee.pos)
        way = anchor_in(spec.joint(leg[4]), knee.parent) - start
        knee.parent.add_geom(
            name=f"{side}_shank_capsule", fromto=[*(start + 0.1 * way), *(start + 0.9 * way)],
            size=[SHANK_RADIUS * np.linalg.norm(way), 0.0, 0.0], **CAPSULE,
        )  # fmt: skip
    (left, right), shanks = robot.plan.sole_boxes, [f"{side}_shank_capsule" for side in SIDES]
    touching = (
        ("floor", left), ("floor", right), (left, right), tuple(shanks), (left, shanks[1]), (shanks[0], right)
    )  # fmt: skip
    for first, second in touching:
        spec.add_pair(geomname1=first, geomname2=second, condim=3, friction=FRICTION, solref=HARDNESS)


def anchor_in(joint: mujoco.MjsJoint, body: mujoco.MjsBody) -> np.ndarray:
    """Anchor of a joint in the axes of its body or of one further in, all joints between at 0, (3,) [m].

    Raises:
        InvalidValueError: the joint does not hang from that body.
    """
    place, part = np.array(joint.pos), joint.parent
    while part.name != body.name:
        if part.name == "world":
            raise InvalidValueError(f"joint {joint.name!r} does not hang from body {body.name!r}")
        place, part = np.array(part.pos) + turned(place, np.array(part.quat)), part.parent
    return place


def _add_sole(spec: mujoco.MjSpec, foot: mujoco.MjsBody, side: str, sole: Sole) -> None:
    """The box, whose lower face is the sole, with site and sensor."""
    centre = turned(sole.centre, conjugate(np.array(sole.turn) / np.linalg.norm(sole.turn)))
    length, width = sole.size
    foot.add_geom(
        name=f"{side}_foot_sole", type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre + [0.0, 0.0, 0.5 * THICKNESS],
        size=[0.5 * length, 0.5 * width, 0.5 * THICKNESS], material=f"pr_{side}", **INERT,
    )  # fmt: skip
    foot.add_site(
        name=f"{side}_sole", type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre, group=4,
        size=[0.5 * length + MARGIN, 0.5 * width + MARGIN, THICKNESS + MARGIN],
    )  # fmt: skip
    spec.add_sensor(
        name=f"{side}_load", type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=f"{side}_sole",
    )  # fmt: skip


# Names begin with what no model has
COLOURS = {"pr_shell": (0.93, 0.94, 0.95), "pr_left": (0.95, 0.52, 0.13), "pr_right": (0.16, 0.45, 0.80)}
FLOOR, TILE = (1.0, 1.0, 1.0), (0.90, 0.92, 0.95)
SKY = (0.80, 0.87, 0.95), (0.95, 0.97, 0.99)
LIGHT = {"dir": [-0.35, 0.45, -0.85], "diffuse": [0.45, 0.45, 0.45], "specular": [0.15, 0.15, 0.15]}
PICTURE = 1280, 960  # largest [pixels]


def set_options(spec: mujoco.MjSpec) -> None:
    """Physics as the biped's: implicit integration without damping of its own, pyramidal friction cones."""
    spec.option = mujoco.MjSpec().option
    spec.option.timestep = 0.002
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_EULERDAMP.value


def add_world(spec: mujoco.MjSpec) -> None:
    """Floor, light, sky and the colours of the soles."""
    for name, rgb in COLOURS.items():
        spec.add_material(name=name, rgba=[*rgb, 1.0], specular=0.3, shininess=0.4)
    chequered, plane = mujoco.mjtTextureRole.mjTEXROLE_RGB.value, mujoco.mjtGeom.mjGEOM_PLANE
    spec.add_texture(
        name="pr_floor", type=mujoco.mjtTexture.mjTEXTURE_2D, width=128, height=128, rgb1=FLOOR, rgb2=TILE,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
    )  # fmt: skip
    material = spec.add_material(name="pr_floor", texrepeat=[2.0, 2.0], texuniform=True)
    material.textures[chequered] = "pr_floor"
    spec.add_texture(
        name="pr_sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=64, rgb1=SKY[0], rgb2=SKY[1],
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
    )  # fmt: skip
    spec.worldbody.add_geom(
        name="floor", type=plane, size=[0.0, 0.0, 1.0], contype=0, conaffinity=0, material="pr_floor"
    )
    spec.worldbody.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=False, **LIGHT)
    look = spec.visual
    look.global_.offwidth, look.global_.offheight = PICTURE
    look.quality.shadowsize = look.quality.offsamples = 0
    look.headlight.ambient, look.headlight.diffuse = [0.42] * 3, [0.28] * 3
    look.headlight.specular = [0.0] * 3


THICK = 0.16  # radius of a limb over its length
SLIM, STOUT = 0.015, 0.06  # least and largest radius [m]
SHORT = 0.03  # a shorter one is not drawn [m]


def draw_limbs(spec: mujoco.MjSpec) -> None:
    """A capsule from every body to each that hangs from it; nothing touches them and they weigh nothing."""
    for body in spec.bodies:
        if body.name == "world" or body.parent.name == "world":
            continue
        end = np.array(body.pos)
        if (length := float(np.linalg.norm(end))) >= SHORT:
            radius = min(max(THICK * length, SLIM), STOUT)
            body.parent.add_geom(fromto=[0.0, 0.0, 0.0, *end], size=[radius, 0.0, 0.0], **CAPSULE)


@dataclass(frozen=True)
class AdaptedSpec:
    """Makes the spec of a robot file, each time a fresh one, with the model's own shapes of a kind."""

    robot: RobotFile
    digest: str = ""  # of the model's files; empty: as they are when the spec is made
    shapes: str = NONE  # or VISUAL or SOLID

    def __call__(self) -> mujoco.MjSpec:
        """The spec.

        Raises:
            PushRecoveryError: its model cannot be had, is not what the file says, or has changed since.
        """
        robot = self.robot
        if self.digest and self.digest != model_digest(robot.model):
            raise InvalidValueError(
                f"the model {robot.model!r} has changed since robot {robot.name!r} was read: read it again"
            )
        source = read_source(robot.model)
        source.refuse_couplings([name for name, _ in robot.fixed])
        spec = source.rewritten()
        shown = self.shapes == NONE or add_shapes(spec, source, self.shapes)
        for shape in spec.geoms:
            if shape.name in OWN_SHAPES:
                shape.name = ""
        source.stand_up(spec)
        require_root(source, robot.plan.pelvis)
        joints = [joint.name for joint in spec.joints]
        fix_joints(spec, robot.fixed)
        names = [joint.name for joint in spec.joints if joint.name]
        if unknown := [name for name in chain(*robot.plan.legs) if name not in names]:
            raise UnknownNameError("joint of a leg", unknown[0], names)
        add_motors(spec, robot, source.torques, joints)
        set_options(spec)
        add_world(spec)
        if not shown:
            draw_limbs(spec)
        add_feet(spec, robot)
        return spec


def require_root(source: SourceModel, pelvis: str) -> None:
    """Raise PushRecoveryError where a pelvis is not the root of its robot.

    Raises:
        UnknownNameError: no such body.
        InvalidValueError: it hangs from another one.
    """
    names = [str(source.model.body(body).name) for body in source.bodies]
    if pelvis not in names:
        raise UnknownNameError("pelvis", pelvis, names)
    if pelvis != names[0]:
        raise InvalidValueError(
            f"pelvis {pelvis!r} must be the root of its robot, not a part of {names[0]!r}"
        )


def description_of(robot: RobotFile) -> RobotDescription:
    """The description of a robot file's robot, with the model as it is now."""
    return _description(robot, model_digest(robot.model))


@lru_cache(maxsize=64)
def _description(robot: RobotFile, digest: str) -> RobotDescription:
    plain, looks, solid = (AdaptedSpec(robot, digest, shapes) for shapes in (NONE, VISUAL, SOLID))
    parts = robot.plan, robot.com_height, robot.preset
    whole = partial(whole_robot, robot) if robot.fixed else None
    content = f"{digest} {replace(robot, model='', preset='')}"  # wherever they lie
    known = hashlib.sha256(content.encode()).hexdigest()
    return RobotDescription(robot.name, plain, *parts, looks=looks, solid=solid, whole=whole, files=known)


def whole_robot(robot: RobotFile) -> RobotDescription:
    """The robot of a file with its fixed joints free, but for those that no motor of its own can drive.

    Those follow others, such as fingers, are no hinges, or have no largest torque.
    """
    source = read_source(robot.model)
    names = [source.name(joint) for joint in source.joints]
    kept = set(chain.from_iterable(one.joints for one in source.couplings))
    for joint, name in zip(source.joints, names, strict=True):
        torque = largest_torque(motor_of_file(robot, name, names), name, source.torques)
        if source.model.jnt_type[joint] != HINGE or not torque:
            kept.add(name)
    return replace(description_of(robot.unfixed(kept)), whole=None)


def load_robot(path: str | Path) -> RobotDescription:
    """The description of the robot in a file; the same one as long as file and model stay as they are.

    Raises:
        InvalidValueError, UnknownNameError: no such file, or not what a robot file says.
    """
    return description_of(read_robot_file(path))


FOLDER = files("push_recovery.envs.robots").joinpath("files")  # of the robots that are shipped


def robot_of_file(robot: object) -> RobotDescription:
    """The robot of the path of a robot file, or of the name of one that is shipped.

    Raises:
        UnknownNameError: no such name.
    """
    shipped = sorted(file.name.removesuffix(".json") for file in FOLDER.iterdir())
    if robot in shipped:
        return load_robot(str(FOLDER.joinpath(f"{robot}.json")))
    if not (isinstance(robot, str) and robot.endswith(".json")):
        raise UnknownNameError("robot", robot, ["biped", *shipped, "FILE.json", "MODULE:ATTRIBUTE"])
    return load_robot(robot)
