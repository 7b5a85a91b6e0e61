"""The biped as a MuJoCo scene: its posture, and pushes, planned foothold, CoP and DCM as markers."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.model.frame import canonical_frame, point_in_world
from ...controllers.model.gait_box import STEP
from ...controllers.model.observation import WORLD_COP, WORLD_DCM
from ...controllers.whole_body.kinematics import sole_position
from .core import BipedCore

Array = NDArray[np.float64]

ARROW = 1.0 / 400.0  # length of a push's arrow [m/N]
FADE = 0.3  # a push stays visible this long after it has ended [s]
CLEARANCE = 0.17  # from the tip of the arrow to the point of attack [m]
THICKNESS = 0.002  # half that of the planned foothold's box [m]
DCM_RADIUS, COP_RADIUS = 0.03, 0.018  # [m]
AXES = np.eye(3).ravel()

PUSH_COLOUR = (0.88, 0.12, 0.10)
FOOTHOLD_COLOUR = (0.05, 0.60, 0.45, 0.55)
DCM_COLOUR = (0.80, 0.10, 0.55, 1.0)
COP_COLOUR = (0.10, 0.35, 0.90, 1.0)


def set_posture(model: mujoco.MjModel, data: mujoco.MjData, core: BipedCore) -> None:
    """Copy robot 0's joints into `data` and place bodies and lights; the simulation is not touched."""
    data.time = core.gait.time[0]
    data.qpos[:] = core.simulations.data[0].qpos
    data.qvel[:] = core.simulations.data[0].qvel
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


def push_opacity(time: float, start: float, duration: float) -> float:
    """1 while a push acts, falling to 0 within FADE [s] after it, 0 otherwise."""
    if not start <= time:
        return 0.0
    return float(np.clip(1.0 - (time - start - duration) / FADE, 0.0, 1.0))


def to_world(core: BipedCore, x: float, y: float) -> Array:
    """A point of robot 0's canonical frame on the floor of the world, (3,) [m]."""
    stance, heading = int(core.gait.stance[0]), float(core.gait.heading[0])
    sole = sole_position(core.true_state(0), 0, stance)
    x, y = point_in_world(canonical_frame(heading, stance), sole[0], sole[1], x, y)
    return np.array([x, y, 0.0])


def add_markers(scene: mujoco.MjvScene, data: mujoco.MjData, core: BipedCore) -> None:
    """Append robot 0's markers to a scene; geoms that no longer fit are left out."""
    plan = core.gait.plan[0]
    heading = float(core.gait.heading[0])
    yaw = np.array(
        [[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1.0]]
    )
    foothold = to_world(core, plan[STEP], plan[STEP + 1]) + [0, 0, THICKNESS]
    _add(
        scene,
        mujoco.mjtGeom.mjGEOM_BOX,
        (*core.body.half_sole, THICKNESS),
        foothold,
        FOOTHOLD_COLOUR,
        yaw.ravel(),
    )
    world = core.world[0]
    dcm, cop = world[WORLD_DCM : WORLD_DCM + 2], world[WORLD_COP : WORLD_COP + 2]
    _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, (DCM_RADIUS, 0, 0), np.array([*dcm, 0.02]), DCM_COLOUR)
    if core.gait.wrench[0, 2] > 1.0:  # a torque has been computed
        _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, (COP_RADIUS, 0, 0), np.array([*cop, 0.0]), COP_COLOUR)
    pushes, time = core.pushes, float(core.gait.time[0])
    for i in range(pushes.start.shape[1]):
        opacity = push_opacity(time, pushes.start[0, i], pushes.duration[0, i])
        if opacity > 0.0 and np.any(pushes.force[0, i]):
            body = core.body.indices.pushed[pushes.body[0, i]]
            point = data.xipos[body] + data.xmat[body].reshape(3, 3) @ pushes.offset[0, i]
            _add_arrow(scene, point, pushes.force[0, i], opacity)


def _add(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    size: tuple[float, float, float],
    position: Array,
    colour: tuple[float, float, float, float],
    axes: Array = AXES,
) -> mujoco.MjvGeom | None:
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind.value, np.array(size), position, axes, np.array(colour, np.float32))
    scene.ngeom += 1
    return geom


def _add_arrow(scene: mujoco.MjvScene, point: Array, force: Array, opacity: float) -> None:
    """An arrow of length |F| ARROW that points at the point of attack."""
    size = float(np.linalg.norm(force))
    tip = point - CLEARANCE * force / size
    geom = _add(scene, mujoco.mjtGeom.mjGEOM_ARROW, (1, 1, 1), tip, (*PUSH_COLOUR, opacity))
    if geom is not None:
        arrow = mujoco.mjtGeom.mjGEOM_ARROW.value
        tail = tip - ARROW * force
        mujoco.mjv_connector(
            geom, arrow, 0.028, tail, 2.0 * tip - tail
        )  # MuJoCo draws half of an arrow's length
