"""Somebody else's model as MuJoCo compiles it, and the robot of it written down anew.

A file may say one thing in many words: Euler angles in any order, axes, frames, full inertias, shapes that
give inertias, default classes, degrees. None of them is read here. MuJoCo compiles the model, and the
robot is written into an empty model from what was compiled, so that nothing of the file's defaults reaches
what is added later. It has bodies, joints and, where asked for, shapes: neither damping, friction and springs
of the joints nor compensated weight, sensors, pairs, keyframes and actuators. Where a joint's coordinate has
a reference, its body is turned so that the same coordinate is the same posture. A mesh is named by the file
that the model names; other shapes are as MuJoCo has compiled them.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from ...controllers.errors import InvalidValueError
from ...controllers.files import is_file
from .model_files import file_digest, in_a_line, model_file, named_files, read_model, unwarned

FREE, HINGE = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE
SLIDE, BALL = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_BALL
KINDS = {FREE: "free", HINGE: "hinge", SLIDE: "slide", BALL: "ball"}
MESH, SPHERE = mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SPHERE
GROUND = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD  # shapes of a floor
STRAIGHT = (1.0, 0.0, 0.0, 0.0)
LEANS = 0.7  # upward part of the root's z axis, below which its axes are not those of a robot that stands
SOME = 0.01  # radius of a ball in the place of a mesh [m]
MASS_MIN = 1e-12  # of a body whose inertia counts [kg]
NONE, VISUAL, SOLID = "none", "visual", "solid"  # shapes that are left: those for the eye, or that collide
HULL = 32  # corners of the convex hull that a mesh collides with, at most
VISUAL_GROUP = 1  # of the shapes that are drawn
COLLISION_GROUPS = (3, 4, 5)  # of the shapes that models draw on demand only
READABLE = ".obj", ".stl", ".msh"  # meshes that MuJoCo reads
THEIRS = "model "  # begins the names of what a model's shapes are made of
CONTACT = "condim", "priority", "friction", "solmix", "solimp", "margin", "gap"  # of a shape that collides
FINITE = {  # that numbers of these parts must be; ends of a range may be infinite
    "body": ("pos", "quat", "mass", "ipos", "iquat", "inertia"),
    "joint": ("pos", "axis", "armature", "qpos0", "range"),
    "actuator": ("gear", "ctrlrange", "forcerange"),
}
FOLDER = {"mesh": "meshdir", "texture": "texturedir"}  # field of the compiler
UNCOPIED = {"id", "info", "name", "classname", "compiler", "plugin", "signature", "material"}
# A shape without weight that touches nothing but what pairs name
INERT: dict[str, Any] = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": VISUAL_GROUP}


@dataclass(frozen=True)
class Coupling:
    """What ties joints or bodies to one another, besides the tree of bodies."""

    what: str
    joints: frozenset[str] = frozenset()  # that alone are tied; none where anything else is


@dataclass(frozen=True, eq=False)
class SourceModel:
    """A compiled model with one robot in it."""

    place: str
    model: mujoco.MjModel  # of the whole file, bodies not merged
    fuses: bool  # whether bodies without joints are to be merged with their parents

    @cached_property
    def root(self) -> int:
        """Body of the robot that no other one of it carries."""
        return self.bodies[0]

    @cached_property
    def bodies(self) -> list[int]:
        """Bodies of the robot, the one tree that moves, or the largest where none does."""
        roots = self.model.body_rootid
        trees = [np.flatnonzero(roots == root) for root in np.unique(roots[1:])]
        moving = roots[self.model.jnt_bodyid]
        return max(trees, key=lambda tree: (tree[0] in moving, len(tree))).tolist()

    @cached_property
    def joints(self) -> list[int]:
        """Joints of the robot but the free one of its root."""
        model = self.model
        return [joint for joint in range(model.njnt) if model.jnt_type[joint] != FREE]

    def name(self, joint: int) -> str:
        """Name of a joint."""
        return str(self.model.joint(joint).name)

    @cached_property
    def upright(self) -> np.ndarray:
        """Attitude of the root's axes where the robot stands, as a quaternion.

        They are x forward and z up; a root whose axes are others stands as the file has it.
        """
        quat = self.model.body_quat[self.root]
        return quat.copy() if turned((0.0, 0.0, 1.0), quat)[2] < LEANS else np.array(STRAIGHT)

    @cached_property
    def posture(self) -> dict[str, float]:
        """Coordinate of every hinge and slide in the first keyframe [rad], [m]; none without a keyframe."""
        model = self.model
        if not model.nkey:
            return {}
        return {
            self.name(joint): float(model.key_qpos[0, model.jnt_qposadr[joint]])
            for joint in self.joints if model.jnt_type[joint] != BALL
        }  # fmt: skip

    @cached_property
    def torques(self) -> dict[str, float]:
        """Largest torque of each joint that has one, both ways: its own bound and its actuators' [N m].

        An infinite one is no bound.
        """
        model, found = self.model, {}
        for joint in self.joints:
            bounds = []
            if model.jnt_actfrclimited[joint]:
                bounds.append(model.jnt_actfrcrange[joint])
            if (driven := self._driven(joint)) is not None:
                bounds.append(driven)
            largest = min((min(-low, high) for low, high in bounds), default=0.0)
            if 0.0 < largest < np.inf:
                found[self.name(joint)] = float(largest)
        return found

    def _driven(self, joint: int) -> np.ndarray | None:
        """Least and largest torque of all actuators of a joint [N m]; None where one has no bound."""
        model, total = self.model, None
        for actuator in self._actuators(joint):
            bounds = []
            if model.actuator_forcelimited[actuator]:
                bounds.append(model.actuator_forcerange[actuator])
            if self._is_motor(actuator) and model.actuator_ctrllimited[actuator]:
                control = model.actuator_gainprm[actuator, 0] * model.actuator_ctrlrange[actuator]
                bounds.append(np.sort(control))
            if not bounds:
                return None
            force = np.array([max(low for low, _ in bounds), min(high for _, high in bounds)])
            own = np.sort(model.actuator_gear[actuator, 0] * force)
            total = own if total is None else total + own
        return total

    def _actuators(self, joint: int) -> list[int]:
        """Actuators of a joint."""
        model = self.model
        kinds = (mujoco.mjtTrn.mjTRN_JOINT.value, mujoco.mjtTrn.mjTRN_JOINTINPARENT.value)
        own = np.isin(model.actuator_trntype, kinds) & (model.actuator_trnid[:, 0] == joint)
        return np.flatnonzero(own).tolist()

    def _is_motor(self, actuator: int) -> bool:
        """Whether an actuator's force is its control times a constant."""
        model = self.model
        fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        return bool(fixed and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE)

    @cached_property
    def couplings(self) -> list[Coupling]:
        """Equality constraints that act, and tendons."""
        model, found = self.model, []
        for number in range(model.neq):
            if not model.eq_active0[number]:
                continue
            kind = mujoco.mjtEq(int(model.eq_type[number]))
            what = f"equality constraint ({kind.name.removeprefix('mjEQ_').lower()})"
            joints = frozenset[str]()
            if kind == mujoco.mjtEq.mjEQ_JOINT:
                pair = model.eq_obj1id[number], model.eq_obj2id[number]
                joints = frozenset(self.name(int(joint)) for joint in pair if joint >= 0)
            found.append(Coupling(_called(what, model.equality(number).name), joints))
        for number in range(model.ntendon):
            first, count = int(model.tendon_adr[number]), int(model.tendon_num[number])
            parts = range(first, first + count)
            of_joints = all(model.wrap_type[part] == mujoco.mjtWrap.mjWRAP_JOINT for part in parts)
            joints = (self.name(int(model.wrap_objid[part])) for part in parts)
            what = _called("tendon", model.tendon(number).name)
            found.append(Coupling(what, frozenset(joints if of_joints else ())))
        return found

    def refuse_couplings(self, fixed: Collection[str]) -> None:
        """Raise InvalidValueError where more than `fixed` joints are tied to one another."""
        for coupling in self.couplings:
            if not (coupling.joints and coupling.joints <= set(fixed)):
                tied = f" of {', '.join(sorted(coupling.joints))}" if coupling.joints else ""
                raise InvalidValueError(
                    f"a robot with equality constraints or tendons cannot be adapted, and {self.place!r} has "
                    f"the {coupling.what}{tied}: control knows chains of joints; joints that follow others "
                    "may be named in 'fixed' with them"
                )

    def rewritten(self) -> mujoco.MjSpec:
        """The robot's bodies and joints in a model of their own, a free joint on its root."""
        spec, made = mujoco.MjSpec(), {}
        spec.compiler.degree, spec.compiler.fusestatic = False, self.fuses
        for number in self.bodies:
            parent = spec.worldbody if number == self.root else made[int(self.model.body_parentid[number])]
            made[number] = self._body(parent, number)
        return spec

    def stand_up(self, spec: mujoco.MjSpec) -> None:
        """Turn the axes of the root of a spec to x forward and z up where they are others."""
        turn_body(spec.worldbody.bodies[0], conjugate(self.upright))

    def _body(self, parent: mujoco.MjsBody, number: int) -> mujoco.MjsBody:
        """Add a body with its joints to its parent."""
        model = self.model
        body = parent.add_body(
            name=model.body(number).name, pos=model.body_pos[number], quat=model.body_quat[number]
        )
        if model.body_mass[number] > MASS_MIN:
            body.mass, body.inertia = model.body_mass[number], model.body_inertia[number]
            body.ipos, body.iquat = model.body_ipos[number], model.body_iquat[number]
            body.explicitinertial = True
        if number == self.root:
            body.add_freejoint()
        first = int(model.body_jntadr[number])
        for joint in range(first, first + int(model.body_jntnum[number])):
            kind = mujoco.mjtJoint(int(model.jnt_type[joint]))
            if kind == FREE:
                continue
            limited = bool(model.jnt_limited[joint] and np.isfinite(model.jnt_range[joint]).any())
            driven = self._actuators(joint)
            rotors = model.actuator_gear[driven, 0] ** 2 @ model.actuator_armature[driven]
            added = body.add_joint(
                name=self.name(joint), type=kind, pos=model.jnt_pos[joint], axis=model.jnt_axis[joint],
                range=np.nan_to_num(model.jnt_range[joint]) * limited, limited=limited,
                armature=model.dof_armature[model.jnt_dofadr[joint]] + rotors,
            )  # fmt: skip
            if kind != BALL and (ref := float(model.qpos0[model.jnt_qposadr[joint]])):
                move_joint(added, -ref)
        return body


def _called(what: str, name: str) -> str:
    return f"{what} {name!r}" if name else what


def read_source(place: str, feet: Collection[str] = ()) -> SourceModel:
    """The model of a file, MJCF or URDF, compiled, without shapes but for those that give inertias.

    Args:
        place: its file, or PACKAGE/PATH.
        feet: joints; where given, the bodies that these move have all of their shapes, the others balls in
            the place of meshes, and inertias are not the robot's.

    Raises:
        MissingExtraError: its package is not installed.
        InvalidValueError: MuJoCo cannot read or compile it, it does not hold one robot with named parts, or a
            number of a body, a joint or an actuator is not finite.
    """
    spec = read_model(place)
    check_robot(spec, place)
    fuses, spec.compiler.fusestatic = spec.compiler.fusestatic, False
    take_out((*spec.sensors, *spec.pairs, *spec.excludes, *spec.tuples, *spec.skins), spec)
    if feet:
        moved = [spec.joint(name).parent for name in feet]
        kept = {part.name for body in moved for part in (body, *descendants(body))}
        shown = {geom.meshname for geom in spec.geoms if geom.parent.name in kept or not take_mesh(geom)}
        take_out((mesh for mesh in spec.meshes if mesh.name not in shown), spec)
    elif not (list(spec.tendons) or _shapes_weigh(spec)):
        for part in (*spec.sites, *spec.flexes):
            part.material = ""
        for light in spec.lights:
            light.texture = ""
        take_out((*spec.geoms, *spec.meshes, *spec.hfields, *spec.materials, *spec.textures), spec)
    model = compiled(spec, place)
    _check_finite(model, place)
    return SourceModel(place, model, bool(fuses))


def _check_finite(model: mujoco.MjModel, place: str) -> None:
    """Raise InvalidValueError for a number of a body, a joint or an actuator that is not finite."""
    counts = {"body": model.nbody, "joint": model.njnt, "actuator": model.nu}
    parts = ((kind, getattr(model, kind)(number)) for kind, n in counts.items() for number in range(n))
    for (kind, part), field in ((one, field) for one in parts for field in FINITE[one[0]]):
        values = getattr(part, field)
        if np.isnan(values).any() or (not field.endswith("range") and np.isinf(values).any()):
            raise InvalidValueError(
                f"{field} of {kind} {part.name or part.id!r} in the model {place!r} must be finite, got "
                f"{' '.join(f'{value:g}' for value in values)}"
            )


def take_mesh(geom: mujoco.MjsGeom) -> str:
    """Put a ball in the place of a mesh, which is compiled in axes of its own; name of the mesh, if any."""
    if geom.type != MESH:
        return ""
    name = geom.meshname
    geom.type, geom.meshname, geom.size = SPHERE, "", [SOME, 0.0, 0.0]
    return name


def compiled(spec: mujoco.MjSpec, place: str) -> mujoco.MjModel:
    """The model of a spec.

    Raises:
        InvalidValueError: MuJoCo cannot compile it.
    """
    spec.compiler.discardvisual = False  # as it is for a URDF, whose shapes would go
    try:
        with unwarned():
            return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise InvalidValueError(f"MuJoCo cannot compile the model {place!r}: {in_a_line(error)}") from error


def take_out(parts: Iterable[Any], spec: mujoco.MjSpec) -> None:
    """Delete parts of a spec."""
    for part in list(parts):
        spec.delete(part)


def _shapes_weigh(spec: mujoco.MjSpec) -> bool:
    """Whether a body takes its inertia from its shapes."""
    rules = mujoco.mjtInertiaFromGeom
    weighing = {rules.mjINERTIAFROMGEOM_TRUE: (True, False), rules.mjINERTIAFROMGEOM_AUTO: (False,)}
    return any(
        body.explicitinertial in weighing.get(body.compiler.inertiafromgeom, ())  # an attached one's own rule
        for body in spec.bodies if body.name != "world" and list(body.geoms)
    )  # fmt: skip


def solid(geom: mujoco.MjsGeom, paired: Collection[str]) -> bool:
    """Whether a shape collides, by its bits or by a pair."""
    return bool(geom.contype or geom.conaffinity) or geom.name in paired


def paired_shapes(spec: mujoco.MjSpec) -> set[str]:
    """Names of shapes that collide by pairs."""
    return {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2) if name}


def check_robot(spec: mujoco.MjSpec, place: str) -> None:
    """Raise InvalidValueError where a model is not one robot, with a free root or a fixed one, and a floor.

    Bodies that neither move nor collide, and floors, may stand beside it.
    """
    paired, robots = paired_shapes(spec), []
    for root in spec.worldbody.bodies:
        parts = [root, *descendants(root)]
        walls = (geom for part in parts for geom in part.geoms if geom.type not in GROUND)
        moves = any(list(part.joints) for part in parts)
        if moves or any(solid(geom, paired) for geom in walls):
            robots.append((root, parts))
    if not any(len(parts) > 1 for _, parts in robots):
        raise InvalidValueError(
            f"there is no robot in the model {place!r}: no body that moves has others hanging from it"
        )
    if len(robots) > 1:
        names = ", ".join(repr(root.name) for root, _ in robots)
        raise InvalidValueError(
            f"the model {place!r} holds {names} side by side: it must hold one robot and nothing else that "
            "moves or collides but a floor"
        )
    _check_names(place, *robots[0])


def descendants(body: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    """Bodies that hang from a body, from the inside out."""
    waiting = list(reversed(body.bodies))
    while waiting:
        yield (child := waiting.pop())
        waiting += reversed(child.bodies)


def _check_names(place: str, root: mujoco.MjsBody, parts: list[mujoco.MjsBody]) -> None:
    """Raise InvalidValueError for a root that is neither free nor fixed, or a part without a name."""
    for part in parts:
        if not part.name:
            where = (
                f"the body that hangs from {part.parent.name!r}" if part is not root else "the robot's root"
            )
            raise InvalidValueError(f"{where} in the model {place!r} has no name: give all bodies names")
    own = [joint for joint in root.joints if joint.type != FREE]
    if own:
        moves = ", ".join(f"{joint.name!r} ({KINDS[joint.type]})" for joint in own)
        raise InvalidValueError(
            f"the robot's root {root.name!r} in the model {place!r} moves by {moves}: it must have a free "
            "joint alone, or none"
        )
    for part in parts:
        for joint in part.joints:
            if not joint.name and joint.type != FREE:
                raise InvalidValueError(
                    f"a joint of body {part.name!r} in the model {place!r} has no name: give all joints names"
                )


def move_joint(joint: mujoco.MjsJoint, change: float) -> None:
    """Move a body as a joint of its own does [rad], [m]; the joints before that one stay where they are."""
    body, axis, own = (
        joint.parent,
        np.array(joint.axis) / np.linalg.norm(joint.axis),
        np.array(joint.parent.quat),
    )
    before = []
    for other in body.joints:
        if other.name == joint.name:
            break
        before.append(other)
    if joint.type == SLIDE:
        body.pos = np.array(body.pos) + turned(change * axis, own)
        for other in before:
            other.pos = np.array(other.pos) - change * axis
        return
    turn, anchor = np.empty(4), np.array(joint.pos)
    mujoco.mju_axisAngle2Quat(turn, axis, change)
    back = conjugate(turn)
    body.pos = np.array(body.pos) + turned(anchor - turned(anchor, turn), own)
    body.quat = product(own, turn)
    for other in before:
        other.axis = turned(np.array(other.axis), back)
        other.pos = anchor + turned(np.array(other.pos) - anchor, back)


def turn_body(body: mujoco.MjsBody, turn: ArrayLike) -> None:
    """Turn the axes of a body by a quaternion, in place; all that it holds stays where it is."""
    if tuple(np.asarray(turn).tolist()) == STRAIGHT:
        return
    quat = np.array(turn) / np.linalg.norm(turn)
    back = conjugate(quat)
    body.quat = product(np.array(body.quat), quat)
    body.ipos, body.iquat = turned(body.ipos, back), product(back, np.array(body.iquat))
    for joint in body.joints:
        joint.pos, joint.axis = turned(joint.pos, back), turned(joint.axis, back)
    for part in (*body.geoms, *body.sites, *body.bodies):
        part.pos, part.quat = turned(part.pos, back), product(back, np.array(part.quat))


def turned(vector: ArrayLike, quat: np.ndarray) -> np.ndarray:
    """A vector turned by a quaternion."""
    result = np.empty(3)
    mujoco.mju_rotVecQuat(result, np.array(vector, np.float64), quat)
    return result


def product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The quaternion that turns by the second one, then by the first."""
    result = np.empty(4)
    mujoco.mju_mulQuat(result, first, second)
    return result


def conjugate(quat: np.ndarray) -> np.ndarray:
    """The quaternion that turns back."""
    return quat * [1.0, -1.0, -1.0, -1.0]


def add_shapes(spec: mujoco.MjSpec, source: SourceModel, kind: str) -> bool:
    """Put shapes of a kind onto a rewritten robot, where nothing touches them and they weigh nothing.

    Returns:
        Whether the model has shapes, all of which MuJoCo can read; otherwise there are none.
    """
    theirs = read_model(source.place)
    files = [mesh.file.lower() for mesh in theirs.meshes if mesh.file]  # others have corners of their own
    if not list(theirs.geoms) or not all(file.endswith(READABLE) for file in files):
        return False
    paired, robot = paired_shapes(theirs), {str(source.model.body(body).name) for body in source.bodies}
    take_out((*theirs.sensors, *theirs.pairs, *theirs.excludes, *theirs.tuples, *theirs.skins), theirs)
    theirs.compiler.fusestatic = False
    shapes = [(geom, take_mesh(geom)) for geom in theirs.geoms]
    model = compiled(theirs, source.place)
    for geom, mesh in shapes:
        wanted = solid(geom, paired) if kind == SOLID else geom.group not in COLLISION_GROUPS
        if wanted and geom.parent.name in robot:
            _add_shape(spec, theirs, model, geom, mesh, source.place)
    if kind == SOLID:
        for mesh in spec.meshes:
            mesh.maxhullvert = HULL
    return True


def _add_shape(
    spec: mujoco.MjSpec, theirs: mujoco.MjSpec, model: mujoco.MjModel,
    geom: mujoco.MjsGeom, mesh: str, place: str,
) -> None:  # fmt: skip
    """Put a shape of the model of a file, where it is when compiled, onto the same body of another one."""
    number, body = geom.id, spec.body(geom.parent.name)
    added = body.add_geom(
        name=geom.name, type=MESH if mesh else geom_type(model, number), pos=model.geom_pos[number],
        quat=model.geom_quat[number], rgba=geom.rgba, **INERT,
    )  # fmt: skip
    if mesh:
        added.meshname = _copied(spec, theirs.mesh(mesh), place)
    else:
        added.size = model.geom_size[number]
    if geom.material:
        added.material = _copied(spec, theirs.material(geom.material), place)
        material, used = spec.material(added.material), theirs.material(geom.material).textures
        material.textures = [name and _copied(spec, theirs.texture(name), place) for name in used]
    for field in CONTACT:
        setattr(added, field, getattr(model, f"geom_{field}")[number])


def geom_type(model: mujoco.MjModel, geom: int) -> mujoco.mjtGeom:
    """Type of a compiled shape. An entry of `geom_type` alone is never found in a tuple of types."""
    return mujoco.mjtGeom(int(model.geom_type[geom]))


def _copied(spec: mujoco.MjSpec, part: Any, place: str) -> str:
    """Name of a copy of a mesh, a material or a texture of a file's model in another spec, one at most."""
    kind = type(part).__name__.removeprefix("Mjs").lower()
    name = THEIRS + part.name
    if getattr(spec, kind)(name) is not None:
        return name
    copy = getattr(spec, f"add_{kind}")(name=name)
    for field in dir(part):
        value = getattr(part, field)
        if field[0] != "_" and field not in UNCOPIED and not callable(value):
            setattr(copy, field, value)
    if getattr(part, "file", ""):
        copy.file = _found(place, getattr(part.compiler, FOLDER[kind]), part.file)
    return name


def _found(model: str, inside: str, file: str) -> str:
    """Path of a file as MuJoCo finds it: in the compiler's folder, or beside the model, maybe by its name.

    One that a model names which is attached lies in that one's folder; none where two such files differ.
    """
    path, names = model_file(model), (file, Path(file).name)
    for place in (path.parent / own / name for name in names for own in (inside, "")):
        if is_file(place):
            return str(place.absolute())
    called = {os.path.join(inside, name) for name in names}
    attached = [place for (name, _), place in named_files(path).items() if name in called]
    alike = len({file_digest(place) for place in attached}) == 1
    return str(attached[0].absolute()) if alike else file
