"""What the browser shows of a robot: meshes, marks on the floor, arrows and strip charts.

What is drawn on the floor under a robot: points, regions and polygons in the world.

The overlays of one robot in the scene: points, regions and the planned sole.

A push in the scene: an arrow with its impulse beside it.

Strip charts: the latest seconds of the first robot, and of the second one where there is one.

One robot in the scene: meshes for each body, placed as the simulation has it.

It looks as in films: where the physics of a robot has no more than soles, the robot's own meshes are shown.
Those were made for other ends than a browser (a Unitree G1 has 400 000 triangles), so they are made coarse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from ...controllers.errors import MissingExtraError
from ...controllers.model.capturability import recoverable_offset
from ...controllers.model.gait_box import STEP
from ...controllers.model.observation import (
    ELAPSED,
    TRUNK_ANGLE,
    TRUNK_RATE,
    WORLD_CMP,
    WORLD_COP,
    WORLD_DCM,
    canonical_frame,
    point_in_world,
)
from ...controllers.whole_body.kinematics import FOOT_BODY, Array, sole_position
from ...envs.biped.core import BipedCore
from ...envs.biped.env import BipedEpisodes
from ...envs.biped.view import set_posture
from ...envs.episode.period_end import LOADED
from ...envs.robots.compiled_robot import CompiledRobot
from ..record.record import TORQUE
from .session import Lane

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Overlays:
    """Places on the floor, world axes [m]; polygons go round counter-clockwise or clockwise, not closed."""

    dcm: Array  # (2,)
    cop: Array  # (2,)
    cmp: Array  # (2,)
    foothold: Array  # (4, 2) the sole that the swing foot will set down
    step_box: Array  # (4, 2) where the centre of that sole may be
    capture_region: Array  # (4, 2) where the DCM may be so that the planner's limits still allow recovery
    support: Array  # (k, 2) hull of the soles that carry load; k is 0 in the air


def overlays_of(episodes: BipedEpisodes) -> Overlays:
    """The overlays of robot 0."""
    core, limits = episodes.core, episodes.limits
    world, truth = core.world[0], core.truth[0]
    offset = recoverable_offset(
        episodes.robot, limits, float(truth[ELAPSED]), truth[TRUNK_ANGLE], truth[TRUNK_RATE]
    )
    low = np.array([limits.length_min, limits.width_min])
    high = np.array([limits.length_max, limits.width_max])
    planned, half = core.gait.plan[0, STEP : STEP + 2], np.array(core.body.half_sole)
    return Overlays(
        dcm=world[WORLD_DCM : WORLD_DCM + 2].copy(),
        cop=world[WORLD_COP : WORLD_COP + 2].copy(),
        cmp=world[WORLD_CMP : WORLD_CMP + 2].copy(),
        foothold=_rectangle(episodes, planned - half, planned + half),
        step_box=_rectangle(episodes, low, high),
        capture_region=_rectangle(episodes, offset.low, offset.high),
        support=support_polygon(episodes),
    )


def _rectangle(episodes: BipedEpisodes, low: Array, high: Array) -> Array:
    """Corners in the world, (4, 2), of a box in the canonical frame."""
    gait = episodes.core.gait
    stance = int(gait.stance[0])
    sole = sole_position(episodes.core.true_state(0), 0, stance)
    frame = canonical_frame(float(gait.heading[0]), stance)
    middle, half = (low + high) / 2, (high - low) / 2
    corners = middle + CORNERS * half
    return np.array([point_in_world(frame, sole[0], sole[1], float(x), float(y)) for x, y in corners])


def support_polygon(episodes: BipedEpisodes) -> Array:
    """Hull (k, 2) of the corners of the soles that carry load, as they lie."""
    core, points = episodes.core, []
    state, half = core.true_state(0), np.array(core.body.half_sole)
    for leg, loaded in enumerate(episodes.info_rows()[0][LOADED] > 0.0):
        if loaded:
            axes = state.xmat[0, FOOT_BODY[leg]].reshape(3, 3)[:2, :2]
            points.append(np.array(sole_position(state, 0, leg)[:2]) + (CORNERS * half) @ axes.T)
    if not points:
        return np.empty((0, 2))
    corners = np.concatenate(points)
    return corners[ConvexHull(corners).vertices]


POINTS = {  # what it is called -> colour, radius [m]
    "DCM": ((194, 23, 138), 0.030), "CoP": ((26, 90, 230), 0.022), "CMP": ((122, 81, 149), 0.018),
}  # fmt: skip
REGIONS = {  # what it is called -> colour, height over the floor [m]
    "capture region": ((194, 23, 138), 0.004), "box of steps": ((13, 153, 115), 0.005),
    "support polygon": ((26, 90, 230), 0.006),
}  # fmt: skip
FOOTHOLD, FOOTHOLD_COLOUR, FOOTHOLD_HEIGHT = "planned step", (13, 153, 115), 0.007
COLOURS = {name: about[0] for name, about in {**POINTS, **REGIONS}.items()} | {FOOTHOLD: FOOTHOLD_COLOUR}
THICKNESS = 0.008  # of a line [m]
SEGMENTS = 8  # of every region: the hull of two soles has no more corners


class FloorMarks:
    """Handles of the overlays of one robot.

    Args:
        server: of viser.
        root: name of the frame that the robot stands in.
    """

    def __init__(self, server: Any, root: str):
        scene, nothing = server.scene, np.zeros((SEGMENTS, 2, 3), np.float32)
        self._points = {
            name: scene.add_icosphere(f"{root}/{name}", radius=radius, color=colour, cast_shadow=False)
            for name, (colour, radius) in POINTS.items()
        }
        self._regions = {
            name: scene.add_line_segments(f"{root}/{name}", nothing, colour, thickness=THICKNESS)
            for name, (colour, _) in REGIONS.items()
        }
        self._foothold = scene.add_mesh_simple(
            f"{root}/{FOOTHOLD}", np.zeros((4, 3), np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
            color=FOOTHOLD_COLOUR, opacity=0.6, side="double", cast_shadow=False,
        )  # fmt: skip

    def draw(self, overlays: Overlays, visible: dict[str, bool]) -> None:
        """Put all of them where they are now."""
        stands = len(overlays.support) > 0
        places = {"DCM": overlays.dcm, "CoP": overlays.cop, "CMP": overlays.cmp}
        for name, handle in self._points.items():
            handle.position = (*places[name].tolist(), 0.02)
            handle.visible = visible[name] and (stands or name == "DCM")
        polygons = overlays.capture_region, overlays.step_box, overlays.support
        for (name, handle), polygon in zip(self._regions.items(), polygons, strict=True):
            handle.visible = visible[name] and len(polygon) > 0
            if handle.visible:
                handle.points = closed_line(polygon, REGIONS[name][1])
        self._foothold.visible = visible[FOOTHOLD]
        self._foothold.vertices = at_height(overlays.foothold, FOOTHOLD_HEIGHT)

    def remove(self) -> None:
        """Take them out of the scene."""
        for handle in (*self._points.values(), *self._regions.values(), self._foothold):
            handle.remove()


def at_height(points: Array, height: float) -> np.ndarray:
    """Points (k, 2) at a height [m], (k, 3) as the browser takes them."""
    return np.column_stack([points, np.full(len(points), height)]).astype(np.float32)


def closed_line(polygon: Array, height: float) -> np.ndarray:
    """The edges of a polygon (k, 2) at a height [m], as segments (SEGMENTS, 2, 3), the last one repeated."""
    points = at_height(polygon, height)
    edges = np.stack([points, np.roll(points, -1, axis=0)], axis=1)
    return edges[np.minimum(np.arange(SEGMENTS), len(edges) - 1)]


LENGTH = 0.01  # of the arrow for an impulse [m per N s]
ABOVE = 0.1  # from the arrow to its text [m]


def impulse_text(impulse: ArrayLike, mass: float) -> str:
    """An impulse (2,) [N s] as it stands beside its arrow."""
    size = float(np.hypot(*np.asarray(impulse, np.float64)))
    return f"{size:.1f} N s  ({size / mass:.2f} N s/kg)"


class PushArrow:
    """An arrow that is hidden until it is shown.

    Args:
        server: of viser.
        name: of the arrow in the scene; places are in the frame above it.
        colour: red, green, blue in 0-255.
    """

    def __init__(self, server: Any, name: str, colour: tuple[int, int, int]):
        nothing = np.zeros((1, 2, 3), np.float32)
        self._arrow = server.scene.add_arrows(
            name, nothing, colour, shaft_radius=0.012, head_radius=0.035, head_length=0.07, visible=False
        )
        self._label = server.scene.add_label(f"{name} label", "", visible=False, anchor="bottom-center")
        self.text = ""  # what stands beside it now

    def show(self, tail: ArrayLike, impulse: ArrayLike, mass: float) -> None:
        """Draw an impulse (2,) [N s] from a point (3,) [m] on."""
        start, along = np.asarray(tail, np.float64), LENGTH * np.asarray(impulse, np.float64)
        tip: Array = start + np.array([*along, 0.0])
        self._arrow.points = np.array([[start, tip]], np.float32)
        self.text = self._label.text = impulse_text(impulse, mass)
        self._label.position = tuple(((start + tip) / 2 + (0.0, 0.0, ABOVE)).tolist())
        self._arrow.visible = self._label.visible = True

    def hide(self) -> None:
        """Show nothing."""
        self.text = ""
        self._arrow.visible = self._label.visible = False


SPAN = 5.0  # of time shown [s]
CHART_POINTS = 200  # of a chart
CHART_COLOURS = ("#c2178a", "#222222", "#0b7a55", "#7a5195")
CHARTS = {  # title -> columns of a sample
    "to the left: DCM, CoM, CoP, CMP [m]": ("dcm_y", "com_y", "cop_y", "cmp_y"),
    "forward: DCM, CoM, CoP, CMP [m]": ("dcm_x", "com_x", "cop_x", "cmp_x"),
    "trunk: roll, pitch [rad]": ("trunk_roll", "trunk_pitch"),
    "capture margin [m]": ("capture_margin",),
}
TORQUES = "largest torque, share of the motor's"


class StripCharts:
    """Charts of one robot in the panel.

    Args:
        server: of viser.
    """

    def __init__(self, server: Any):
        from viser import uplot

        self._handles = {}
        for title, columns in {**CHARTS, TORQUES: ("torque",)}.items():
            series = [uplot.Series(label="t")]
            series += [
                uplot.Series(label=column, stroke=colour, width=1.5)
                for column, colour in zip(columns, CHART_COLOURS, strict=False)
            ]
            nothing = tuple(np.zeros(2) for _ in series)
            scales = {"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)}
            self._handles[title] = server.gui.add_uplot(
                nothing, tuple(series), title=title, scales=scales, height=130,
                legend=uplot.Legend(show=False),
            )  # fmt: skip

    def draw(self, lane: Lane) -> None:
        """Show what a robot has been through."""
        rows = list(lane.rows)[-round(SPAN / lane.period) :]
        rows = rows[:: max(1, len(rows) // CHART_POINTS)]
        if len(rows) < 2:
            return
        time = np.array([row["time"] for row in rows])
        for title, columns in CHARTS.items():
            values = [np.array([row[column] for row in rows]) for column in columns]
            self._handles[title].data = (time, *values)
        self._handles[TORQUES].data = (time, largest_torque(lane, rows))


def largest_torque(lane: Lane, rows: list[dict[str, float]]) -> np.ndarray:
    """The largest torque of all motors against its bound, by sample."""
    bounds = {name: bound for name, bound in lane.bounds.items() if name.startswith(TORQUE)}
    return np.array([max(abs(row[name]) / bound for name, bound in bounds.items()) for row in rows])


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
