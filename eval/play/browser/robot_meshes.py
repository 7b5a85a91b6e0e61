"""One robot in the scene: meshes for each body, placed as the simulation has it.

It looks as in films: where the physics of a robot has no more than soles, the robot's own meshes are shown.
Those were made for other ends than a browser (a Unitree G1 has 400 000 triangles), so they are made coarse.
"""

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

CELL = 0.005  # of the grid on which vertices of a mesh are joined [m]
SEEN_GROUPS = 3  # of geoms, counted from 0: MuJoCo shows these by default
MESHES = "meshes for a browser"  # by this name a robot keeps them
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
        self._model, self._data = robot.picture, mujoco.MjData(robot.picture)
        self._pelvis = robot.indices.pelvis
        self._handles: list[tuple[int, Any]] = []
        for body, meshes in body_meshes(robot).items():
            part = "trunk" if body == robot.indices.trunk else "pelvis"
            for i, mesh in enumerate(meshes):
                name = f"{root}/{self._model.body(body).name}/{i}"
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


def body_meshes(robot: CompiledRobot) -> dict[int, list[Any]]:
    """Meshes of trimesh by moving body, in the body's own axes; made once for a robot.

    Raises:
        MissingExtraError: mjviser is not installed.
    """
    if MESHES not in robot.found:
        robot.found[MESHES] = _body_meshes(robot.picture)
    return robot.found[MESHES]


def _body_meshes(model: mujoco.MjModel) -> dict[int, list[Any]]:
    try:
        from mjviser.conversions import group_geoms_by_visual_compat, merge_geoms
    except ImportError as error:
        raise MissingExtraError("mjviser", "play") from error

    def merged(geoms: list[int]) -> Any:
        mesh = merge_geoms(model, geoms)
        return coarse(mesh) if (model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_MESH).any() else mesh

    shown = (model.geom_group < SEEN_GROUPS) & (model.geom_rgba[:, 3] > 0.0) & (model.geom_bodyid > 0)
    geoms: dict[int, list[int]] = {}
    for geom in np.flatnonzero(shown).tolist():
        geoms.setdefault(int(model.geom_bodyid[geom]), []).append(geom)
    return {
        body: [merged(alike) for alike in group_geoms_by_visual_compat(model, own)]
        for body, own in geoms.items()
    }


def coarse(mesh: Any, cell: float = CELL) -> Any:
    """A mesh of trimesh with one vertex of each colour for each cell of a grid, the mean of those in it.

    Triangles that have lost a side are left out, and so are those that have come twice. A mesh with a texture
    stays as it is.

    Args:
        mesh: of trimesh, in its body's axes.
        cell: width of the grid's cells [m].
    """
    import trimesh
    from trimesh.visual import ColorVisuals

    if not isinstance(mesh.visual, ColorVisuals):
        return mesh
    colours = np.asarray(mesh.visual.vertex_colors)
    keys = np.hstack([np.round(mesh.vertices / cell).astype(np.int64), colours])
    cells, of_vertex, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    means = np.zeros((len(cells), 3))
    np.add.at(means, of_vertex, mesh.vertices)
    faces = of_vertex[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return trimesh.Trimesh(
        means / count[:, None], faces[np.sort(first)],
        vertex_colors=cells[:, 3:].astype(np.uint8), process=False,
    )  # fmt: skip


def _telling(grab: Grab, part: str) -> Any:
    """A callback that viser runs in the order of its events, which it does for coroutines alone."""

    async def tell(event: Any) -> None:
        grab(event, part)

    return tell
