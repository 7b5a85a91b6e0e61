"""The biped as a MuJoCo scene, offscreen or in a window: posture, pushes, planned foothold, CoP and DCM."""

from __future__ import annotations

import time
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.model.gait_box import STEP
from ...controllers.model.observation import WORLD_COP, WORLD_DCM, canonical_frame, point_in_world
from ...controllers.whole_body.kinematics import sole_position
from ..rendering import Canvas, Owner, window_opens
from ..robots.compiled_robot import CompiledRobot
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
    cos, sin = np.cos(core.gait.heading[0]), np.sin(core.gait.heading[0])
    yaw, size = np.array([cos, -sin, 0, sin, cos, 0, 0, 0, 1.0]), (*core.body.half_sole, THICKNESS)
    foothold = to_world(core, plan[STEP], plan[STEP + 1]) + [0, 0, THICKNESS]
    _add(scene, mujoco.mjtGeom.mjGEOM_BOX, size, foothold, FOOTHOLD_COLOUR, yaw)
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


WIDTH, HEIGHT = 640, 480
DISTANCE, AZIMUTH, ELEVATION = 2.6, 145.0, -14.0  # of the camera: [m], [deg], [deg]
LOOK_HEIGHT = 0.72  # of the point it looks at [m]
MOST_SHAPES = 300  # in a scene, markers included


class BipedView:
    """Robot 0 of a core with its push, planned foothold, CoP and DCM; the camera follows the pelvis.

    An arrow is a push, 1 m for 400 N, fading within 0.3 s after it; the flat green box is where the swing
    foot will land, the magenta ball the DCM, the blue dot the CoP that the controller asks for.
    """

    def __init__(self, robot: CompiledRobot, window: bool = False):
        """Open the picture of a robot; a window without a display is a warning, and then nothing is drawn.

        Raises:
            RenderError: there is no OpenGL for an image.
        """
        self._view: Any = None
        if not window:
            self._view = _Image(robot)
        elif window_opens():
            self._view = _Window(robot)

    def draw(self, core: BipedCore) -> NDArray[np.uint8] | None:
        """Draw robot 0; returns the image (480, 640, 3) unless it is a window."""
        return None if self._view is None else self._view.draw(core)

    def close(self) -> None:
        """Close the window or release the canvas; may be called twice."""
        if self._view is not None:
            self._view.close()


class _Image:
    def __init__(self, robot: CompiledRobot) -> None:
        self._model, self._pelvis = robot.picture, robot.indices.pelvis
        self._data = mujoco.MjData(self._model)
        self._canvas = Canvas(self._model, WIDTH, HEIGHT)
        self._scene = mujoco.MjvScene(self._model, maxgeom=MOST_SHAPES)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag.value] = 0
        self._option = mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        _aim(self._camera)

    def draw(self, core: BipedCore) -> NDArray[np.uint8]:
        set_posture(self._model, self._data, core)
        self._camera.lookat[:] = (*self._data.xpos[self._pelvis, :2], LOOK_HEIGHT)
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, None, self._camera,
            mujoco.mjtCatBit.mjCAT_ALL.value, self._scene,
        )  # fmt: skip
        add_markers(self._scene, self._data, core)
        return self._canvas.draw(self._scene)

    def close(self) -> None:
        self._canvas.close()


class _Window:
    """MuJoCo's viewer, at the speed of the simulated time where the computer keeps up."""

    def __init__(self, robot: CompiledRobot) -> None:
        from mujoco import viewer

        self._owner = Owner()
        self._model, self._pelvis = robot.picture, robot.indices.pelvis
        self._data = mujoco.MjData(self._model)
        self._viewer = viewer.launch_passive(self._model, self._data, show_left_ui=False, show_right_ui=False)
        _aim(self._viewer.cam)
        self._lead = -np.inf  # simulated time less the clock [s]

    def draw(self, core: BipedCore) -> None:
        self._owner.check()
        if not self._viewer.is_running():
            return
        with self._viewer.lock():
            set_posture(self._model, self._data, core)
            self._viewer.cam.lookat[:] = (*self._data.xpos[self._pelvis, :2], LOOK_HEIGHT)
            self._viewer.user_scn.ngeom = 0
            add_markers(self._viewer.user_scn, self._data, core)
        self._viewer.sync()
        self._wait(float(core.gait.time[0]))

    def _wait(self, simulated: float) -> None:
        """Sleep until the clock has caught up; start over at a reset or where the computer is too slow."""
        ahead = simulated - time.monotonic() - self._lead
        if 0.0 < ahead < 0.5:
            time.sleep(ahead)
        elif abs(ahead) >= 0.1:
            self._lead = simulated - time.monotonic()

    def close(self) -> None:
        if self._owner.is_here():
            self._viewer.close()


def _aim(camera: mujoco.MjvCamera) -> None:
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.distance, camera.azimuth, camera.elevation = DISTANCE, AZIMUTH, ELEVATION
    camera.lookat[:] = (0.0, 0.0, LOOK_HEIGHT)
