"""Pictures of the biped: offscreen images, or a window."""

from __future__ import annotations

import time
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..physics.offscreen import Canvas, window_opens
from .core import BipedCore
from .robots.compiled_robot import CompiledRobot
from .scene import add_markers, set_posture

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

        self._model, self._pelvis = robot.picture, robot.indices.pelvis
        self._data = mujoco.MjData(self._model)
        self._viewer = viewer.launch_passive(self._model, self._data, show_left_ui=False, show_right_ui=False)
        _aim(self._viewer.cam)
        self._lead = -np.inf  # simulated time less the clock [s]

    def draw(self, core: BipedCore) -> None:
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
        self._viewer.close()


def _aim(camera: mujoco.MjvCamera) -> None:
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.distance, camera.azimuth, camera.elevation = DISTANCE, AZIMUTH, ELEVATION
    camera.lookat[:] = (0.0, 0.0, LOOK_HEIGHT)
