"""One robot in the scene: a mesh for each body, placed as the simulation has it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from ....controllers.errors import MissingExtraError
from ....envs.biped.core import BipedCore
from ....envs.biped.robots.compiled_robot import CompiledRobot
from ....envs.biped.scene import set_posture
from ...record.sampler import Array

SEEN_GROUPS = 3  # of geoms, counted from 0: MuJoCo shows these by default
Grab = Callable[[Any, str], None]  # of viser's event and "pelvis" or "trunk"


class RobotMeshes:
    """The bodies of one robot.

    Args:
        server: of viser.
        root: name of the frame that the robot stands in.
        robot: whose shape it has.
        grab: called with every event of a drag on a body; None: it can't be dragged.
    """

    def __init__(self, server: Any, root: str, robot: CompiledRobot, grab: Grab | None = None):
        self._model, self._data = robot.model, mujoco.MjData(robot.model)
        self._pelvis = robot.indices.pelvis
        self._handles: list[tuple[int, Any]] = []
        for body, meshes in body_meshes(robot.model).items():
            part = "trunk" if body == robot.indices.trunk else "pelvis"
            for i, mesh in enumerate(meshes):
                name = f"{root}/{robot.model.body(body).name}/{i}"
                handle = server.scene.add_mesh_trimesh(name, mesh)
                if grab is not None:
                    handle.on_drag("left")(_telling(grab, part))
                self._handles.append((body, handle))

    def draw(self, core: BipedCore) -> Array:
        """Place all bodies as robot 0 has them; returns where the pelvis is, (3,) [m]."""
        set_posture(self._model, self._data, core)
        for body, handle in self._handles:
            handle.position, handle.wxyz = self._data.xpos[body], self._data.xquat[body]
        return self._data.xpos[self._pelvis].copy()

    def remove(self) -> None:
        """Take it out of the scene."""
        for _, handle in self._handles:
            handle.remove()


def body_meshes(model: mujoco.MjModel) -> dict[int, list[Any]]:
    """Meshes of trimesh by moving body, in the body's own axes.

    Raises:
        MissingExtraError: mjviser is not installed.
    """
    try:
        from mjviser.conversions import group_geoms_by_visual_compat, merge_geoms
    except ImportError as error:
        raise MissingExtraError("mjviser", "play") from error
    shown = (model.geom_group < SEEN_GROUPS) & (model.geom_rgba[:, 3] > 0.0) & (model.geom_bodyid > 0)
    geoms: dict[int, list[int]] = {}
    for geom in np.flatnonzero(shown).tolist():
        geoms.setdefault(int(model.geom_bodyid[geom]), []).append(geom)
    return {
        body: [merge_geoms(model, alike) for alike in group_geoms_by_visual_compat(model, own)]
        for body, own in geoms.items()
    }


def _telling(grab: Grab, part: str) -> Any:
    """A callback that viser runs in the order of its events, which it does for coroutines alone."""

    async def tell(event: Any) -> None:
        grab(event, part)

    return tell
