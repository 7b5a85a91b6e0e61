"""Which joints of a model are legs, waist and the rest, and the rectangles under its feet: guesses to review.

The joints of a model that nobody has described, and where they are in its reference posture.

Which joints of a skeleton are legs, waist and the rest: a guess to be looked through.

The rectangle under a foot, from the shapes of the foot's body in the model.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.model.robot import LEG_JOINTS, BodyPlan
from ...envs.robots.adapt import COLLISION_GROUPS, add_root, drop_shapes, largest_torques, read_model
from ...envs.robots.robot_file import Angles, Sole, make_plan

Chain = tuple[int, ...]


@dataclass(frozen=True)
class Skeleton:
    """A model without shapes, upright with all joints at 0."""

    name: str  # where the model lies
    model: mujoco.MjModel
    data: mujoco.MjData
    torques: dict[str, float]  # joint -> largest torque [N m]
    posture: dict[str, float]  # joint -> angle in the model's first keyframe [rad]

    @cached_property
    def root(self) -> int:
        """Body with the free joint."""
        return int(self.model.jnt_bodyid[self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE][0])

    @cached_property
    def hinges(self) -> list[int]:
        """Numbers of all hinges."""
        return np.flatnonzero(self.model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE).tolist()

    def joint_name(self, joint: int) -> str:
        """Name of a joint."""
        return str(self.model.joint(joint).name)

    def body_name(self, body: int) -> str:
        """Name of a body."""
        return str(self.model.body(body).name)

    def axis(self, joint: int) -> NDArray[np.float64]:
        """Of a hinge, in the world, (3,)."""
        return self.data.xaxis[joint]

    def chain(self, joint: int) -> Chain:
        """Hinges from the root to a joint, itself included."""
        model, found = self.model, []
        dof = int(model.jnt_dofadr[joint])
        while dof >= 0:
            owner = int(model.dof_jntid[dof])
            if model.jnt_type[owner] == mujoco.mjtJoint.mjJNT_HINGE:
                found.append(owner)
            dof = int(model.dof_parentid[dof])
        return tuple(reversed(found))

    def children(self, body: int) -> Iterator[int]:
        """Bodies that hang from a body."""
        return (
            other
            for other in range(1, self.model.nbody)
            if self.model.body_parentid[other] == body and other != body
        )

    def moved_mass(self, joint: int) -> float:
        """Mass that a joint carries [kg]."""
        return float(self.model.body_subtreemass[self.model.jnt_bodyid[joint]])


def read_skeleton(model: str) -> Skeleton:
    """The skeleton of a model, MJCF or URDF.

    Raises:
        InvalidValueError: no such model, one that MuJoCo cannot read, or one without a robot in it.
    """
    spec = read_model(model)
    torques, posture = largest_torques(spec), _keyframe(spec)
    followers = [joint.name for joint in spec.joints]  # joints that follow others are none of the legs
    drop_shapes(spec, fixed=followers)
    roots = [body for body in spec.worldbody.bodies if list(body.bodies)]
    if not roots:
        raise InvalidValueError(
            f"there is no robot in the model {model!r}: no body has others hanging from it"
        )
    add_root(spec, roots[0].name)
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qpos[3] = 0.0, 1.0
    mujoco.mj_kinematics(compiled, data)
    mujoco.mj_comPos(compiled, data)
    return Skeleton(model, compiled, data, torques, posture)


def _keyframe(spec: mujoco.MjSpec) -> dict[str, float]:
    """Angles of the first keyframe of a model; none where it has no keyframe."""
    keys = list(spec.keys)
    if not keys:
        return {}
    angles, place, found = np.array(keys[0].qpos), 0, {}
    for joint in spec.joints:
        free = joint.type == mujoco.mjtJoint.mjJNT_FREE
        if not free and place < len(angles):
            found[joint.name] = float(angles[place])
        place += 7 if free else 1
    return found


BENT = 0.7  # of the knee, half of it at hip and ankle the other way [rad]
ALONG = 1.0 - 1e-6  # least component of an axis along x, y or z that counts as that axis
HEAVY = 0.4  # share of the upper body's mass from which a branch has the trunk
LIGHT = 0.015  # share of the robot's mass below which a joint moves too little to be one


@dataclass(frozen=True)
class Guess:
    """The plan, and the joints that are none here."""

    plan: BodyPlan
    fixed: Angles


def guess_plan(skeleton: Skeleton) -> Guess:
    """Legs, waist, held and fixed joints of a robot.

    Raises:
        InvalidValueError: no two legs of six joints each were found.
    """
    left, right = find_legs(skeleton)
    waist, trunk = find_waist(skeleton, {*left, *right})
    roles = {*left, *right, *(joint for joint in waist if joint is not None)}
    held, fixed = [], []
    total = float(skeleton.model.body_subtreemass[skeleton.root])
    for joint in skeleton.hinges:
        if joint not in roles:
            few = fixed if skeleton.moved_mass(joint) < LIGHT * total else held
            few.append((skeleton.joint_name(joint), _kept_angle(skeleton, joint)))
    plan = make_plan(
        skeleton.body_name(skeleton.root),
        skeleton.body_name(trunk),
        [[skeleton.joint_name(joint) for joint in leg] for leg in (left, right)],
        tuple(None if joint is None else skeleton.joint_name(joint) for joint in waist),
        _bend(skeleton, left),
        held,
    )
    return Guess(plan, tuple(fixed))


def find_legs(skeleton: Skeleton) -> tuple[Chain, Chain]:
    """Hinges of the left and the right leg: the two chains that reach lowest, less what they share.

    Raises:
        InvalidValueError: they have not six joints each, or do not lie left and right.
    """
    depth = {joint: skeleton.data.xanchor[joint, 2] for joint in skeleton.hinges}
    ends = [joint for joint in skeleton.hinges if not _goes_on(skeleton, joint)]
    lowest = sorted(ends, key=lambda joint: depth[joint])[:2]
    chains = [skeleton.chain(joint) for joint in lowest]
    if len(chains) == 2:
        shared = {*chains[0]} & {*chains[1]}
        chains = [tuple(joint for joint in chain if joint not in shared) for chain in chains]
    sizes = [len(chain) for chain in chains]
    if sizes != [LEG_JOINTS] * 2:
        names = [[skeleton.joint_name(joint) for joint in chain] for chain in chains]
        raise InvalidValueError(
            f"two legs of {LEG_JOINTS} joints each are needed; the lowest chains of {skeleton.name!r} have "
            f"{names}"
        )
    chains.sort(key=lambda chain: -skeleton.data.xanchor[chain[-1], 1])
    if not skeleton.data.xanchor[chains[0][-1], 1] > 0.0 > skeleton.data.xanchor[chains[1][-1], 1]:
        raise InvalidValueError(
            f"the legs of {skeleton.name!r} must lie left (y > 0) and right of its middle"
        )
    return chains[0], chains[1]


def _goes_on(skeleton: Skeleton, joint: int) -> bool:
    """Whether another hinge hangs from a joint."""
    dof = int(skeleton.model.jnt_dofadr[joint])
    return bool((skeleton.model.dof_parentid == dof).any())


def find_waist(skeleton: Skeleton, legs: set[int]) -> tuple[tuple[int | None, int | None], int]:
    """Pitch and roll of the waist, None for what is missing, and the trunk's body.

    The trunk is where the upper body branches: from the pelvis up, as long as one branch has a good part of
    its mass.
    """
    model, body = skeleton.model, skeleton.root
    below = {int(model.jnt_bodyid[joint]) for joint in legs}
    upper = float(model.body_subtreemass[body]) - sum(
        float(model.body_subtreemass[part]) for part in below if int(model.body_parentid[part]) not in below
    )
    passed: list[int] = []
    while True:
        branches = [part for part in skeleton.children(body) if not _bears(skeleton, part, below)]
        heaviest = max(branches, key=lambda part: model.body_subtreemass[part], default=None)
        if heaviest is None or model.body_subtreemass[heaviest] < HEAVY * upper:
            break
        body = heaviest
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        passed += range(first, first + count)
    pitch, roll = (_along(skeleton, passed, axis) for axis in (1, 0))
    return (pitch, roll), body


def _bears(skeleton: Skeleton, body: int, parts: set[int]) -> bool:
    """Whether any of some bodies hangs from a body, or is it."""
    return body in parts or any(_bears(skeleton, part, parts) for part in skeleton.children(body))


def _along(skeleton: Skeleton, joints: list[int], axis: int) -> int | None:
    """The first joint about an axis of the world, in its positive sense."""
    return next((joint for joint in joints if skeleton.axis(joint)[axis] > ALONG), None)


def _bend(skeleton: Skeleton, leg: Chain) -> tuple[float, ...]:
    """Angles of a leg with a bent knee, hip and ankle half as much the other way."""
    model, knee = skeleton.model, leg[3]
    low, high = model.jnt_range[knee] if model.jnt_limited[knee] else (0.0, 1.0)
    bent = BENT if high + low >= 0.0 else -BENT
    angles = np.zeros(LEG_JOINTS)
    angles[3] = bent
    for part in (leg[:3], leg[4:]):
        pitch = max(part, key=lambda joint: abs(skeleton.axis(joint) @ skeleton.axis(knee)))
        angles[leg.index(pitch)] = -0.5 * bent * np.sign(skeleton.axis(pitch) @ skeleton.axis(knee))
    return tuple(angles.tolist())


def _kept_angle(skeleton: Skeleton, joint: int) -> float:
    """That of the model's first keyframe, or 0, within the joint's range."""
    angle = skeleton.posture.get(skeleton.joint_name(joint), 0.0)
    if skeleton.model.jnt_limited[joint]:
        low, high = skeleton.model.jnt_range[joint]
        angle = min(max(angle, float(low)), float(high))
    return round(angle, 6)


LOW = 0.012  # points up to this high over the lowest one belong to the sole [m]
LEVEL = 1e-6  # a foot that leans by less has its sole's axes [rad]
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
Array = NDArray[np.float64]


def guess_soles(model_place: str, joints: tuple[str, str]) -> tuple[Sole, Sole]:
    """Soles of the bodies that two joints move, level in the reference posture.

    Raises:
        InvalidValueError: a foot without shapes, or whose meshes cannot be read.
    """
    try:
        model = read_model(model_place).compile()
    except ValueError as error:
        raise InvalidValueError(f"MuJoCo cannot compile the model {model_place!r}: {error}") from error
    data = mujoco.MjData(model)
    if model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        data.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    data.qpos[7 if model.nq != model.nv else 0 :] = 0.0
    mujoco.mj_kinematics(model, data)
    left, right = (_sole(model, data, int(model.jnt_bodyid[model.joint(name).id])) for name in joints)
    return left, right


def _sole(model: mujoco.MjModel, data: mujoco.MjData, foot: int) -> Sole:
    """The sole of a foot's body."""
    points = np.concatenate(
        [np.empty((0, 3)), *(_points(model, data, geom) for geom in _shapes(model, foot))]
    )
    if not len(points):
        raise InvalidValueError(f"foot {model.body(foot).name!r} has no shapes to take its sole from")
    lowest = points[:, 2].min()
    low = points[points[:, 2] < lowest + LOW]
    least, most = low.min(axis=0), low.max(axis=0)
    centre = np.array([*(0.5 * (least + most))[:2], lowest])
    turned = data.xmat[foot].reshape(3, 3)
    inside, turn = turned.T @ (centre - data.xpos[foot]), data.xquat[foot] * [1.0, -1.0, -1.0, -1.0]
    if np.linalg.norm(turn[1:]) < LEVEL:
        turn = np.array([1.0, 0.0, 0.0, 0.0])
    size = np.round((most - least)[:2], 4)
    return Sole(tuple(np.round(inside, 6).tolist()), tuple(size.tolist()), tuple(turn.tolist()))


def _shapes(model: mujoco.MjModel, foot: int) -> list[int]:
    """Shapes of a foot: those that are for collisions where there are any, with what is fixed to the foot."""
    bodies = {foot}
    for body in range(foot + 1, model.nbody):
        if model.body_parentid[body] in bodies and model.body_jntnum[body] == 0:
            bodies.add(body)
    found = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] in bodies]
    touching = model.geom_contype + model.geom_conaffinity
    paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
    touches = [geom for geom in found if touching[geom] or geom in paired]
    solid = touches or [geom for geom in found if model.geom_group[geom] in COLLISION_GROUPS]
    return solid or found


def _points(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """Points of a shape in the world that its lowest ones are among, (n, 3) [m]."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    place, axes = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return place[None] - [0.0, 0.0, size[0]]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        return place + model.mesh_vert[first : first + count] @ axes.T
    half = size
    if kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE):
        cap = size[0] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        half = np.array([size[0], size[0], size[1] + cap])
    return place + (CORNERS * half) @ axes.T
