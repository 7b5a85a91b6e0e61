"""Guesses about a model that nobody has described: its legs, its waist, its other joints, and its soles.

They are to be looked through. The joints are those of a skeleton, the model without shapes as it stands with
all joints at 0; a sole is the rectangle under the shapes of a foot's body.
"""

from collections.abc import Iterable
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

    def names(self, joints: Iterable[int]) -> list[str]:
        """Names of joints."""
        return [str(self.model.joint(joint).name) for joint in joints]

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

    def children(self, body: int) -> list[int]:
        """Bodies that hang from a body."""
        return (np.flatnonzero(self.model.body_parentid[1:] == body) + 1).tolist()


def read_skeleton(model: str) -> Skeleton:
    """The skeleton of a model, MJCF or URDF; one without a robot in it is refused."""
    spec = read_model(model)
    torques, posture = largest_torques(spec), first_keyframe(spec)
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


def first_keyframe(spec: mujoco.MjSpec) -> dict[str, float]:
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


def guess_plan(skeleton: Skeleton) -> tuple[BodyPlan, Angles]:
    """Legs, waist and held joints of a robot; and the joints that are fixed, which its model has no more."""
    left, right = find_legs(skeleton)
    waist, trunk = find_waist(skeleton, {*left, *right})
    roles, held, fixed = {*left, *right, *waist}, [], []
    model, masses = skeleton.model, skeleton.model.body_subtreemass
    for joint, name in zip(skeleton.hinges, skeleton.names(skeleton.hinges), strict=True):
        if joint not in roles:
            angle = skeleton.posture.get(name, 0.0)
            if model.jnt_limited[joint]:
                angle = min(max(angle, float(model.jnt_range[joint, 0])), float(model.jnt_range[joint, 1]))
            light = masses[model.jnt_bodyid[joint]] < LIGHT * masses[skeleton.root]
            (fixed if light else held).append((name, round(angle, 6)))
    plan = make_plan(
        str(model.body(skeleton.root).name),
        str(model.body(trunk).name),
        [skeleton.names(leg) for leg in (left, right)],
        tuple(None if joint is None else str(model.joint(joint).name) for joint in waist),
        _bend(skeleton, left),
        held,
    )
    return plan, tuple(fixed)


def find_legs(skeleton: Skeleton) -> tuple[Chain, Chain]:
    """Hinges of the left and the right leg: the two chains that reach lowest, less what they share."""
    model, anchors = skeleton.model, skeleton.data.xanchor
    ends = [joint for joint in skeleton.hinges if model.jnt_dofadr[joint] not in model.dof_parentid]
    chains = [skeleton.chain(joint) for joint in sorted(ends, key=lambda joint: anchors[joint, 2])[:2]]
    if len(chains) == 2:
        shared = {*chains[0]} & {*chains[1]}
        chains = [tuple(joint for joint in chain if joint not in shared) for chain in chains]
    sizes = [len(chain) for chain in chains]
    if sizes != [LEG_JOINTS] * 2:
        raise InvalidValueError(
            f"two legs of {LEG_JOINTS} joints each are needed; the lowest chains of {skeleton.name!r} have "
            f"{[skeleton.names(chain) for chain in chains]}"
        )
    chains.sort(key=lambda chain: -anchors[chain[-1], 1])
    if not anchors[chains[0][-1], 1] > 0.0 > anchors[chains[1][-1], 1]:
        raise InvalidValueError(
            f"the legs of {skeleton.name!r} must lie left (y > 0) and right of its middle"
        )
    return chains[0], chains[1]


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
    axes = skeleton.data.xaxis
    pitch, roll = (next((joint for joint in passed if axes[joint, axis] > ALONG), None) for axis in (1, 0))
    return (pitch, roll), body


def _bears(skeleton: Skeleton, body: int, parts: set[int]) -> bool:
    """Whether any of some bodies hangs from a body, or is it."""
    return body in parts or any(_bears(skeleton, part, parts) for part in skeleton.children(body))


def _bend(skeleton: Skeleton, leg: Chain) -> tuple[float, ...]:
    """Angles of a leg with a bent knee, hip and ankle half as much the other way."""
    model, axes, knee = skeleton.model, skeleton.data.xaxis, leg[3]
    low, high = model.jnt_range[knee] if model.jnt_limited[knee] else (0.0, 1.0)
    bent = BENT if high + low >= 0.0 else -BENT
    angles = np.zeros(LEG_JOINTS)
    angles[3] = bent
    for part in (leg[:3], leg[4:]):
        pitch = max(part, key=lambda joint: abs(axes[joint] @ axes[knee]))
        angles[leg.index(pitch)] = -0.5 * bent * np.sign(axes[pitch] @ axes[knee])
    return tuple(angles.tolist())


LOW = 0.012  # points up to this high over the lowest one belong to the sole [m]
LEVEL = 1e-6  # a foot that leans by less has its sole's axes [rad]
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
Array = NDArray[np.float64]


def guess_soles(model_place: str, joints: tuple[str, str]) -> tuple[Sole, Sole]:
    """Soles of the bodies that two joints move, level in the reference posture."""
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
    fixed = model.body_weldid == model.body_weldid[foot]
    found = np.flatnonzero(fixed[model.geom_bodyid]).tolist()
    touching = model.geom_contype + model.geom_conaffinity
    paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
    touches = [geom for geom in found if touching[geom] or geom in paired]
    solid = touches or [geom for geom in found if model.geom_group[geom] in COLLISION_GROUPS]
    return solid or found


def _points(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """Points of a shape in the world that its lowest ones are among, (n, 3) [m]."""
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
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
