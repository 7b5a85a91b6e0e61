"""The rectangle under a foot, from the shapes of the foot's body in the model."""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...envs.biped.robots.adapted.bare import COLLISION_GROUPS
from ...envs.biped.robots.adapted.model_place import read_model
from ...envs.biped.robots.adapted.robot_file import Sole

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
