"""Browser scene of a robot: meshes, marks on the floor, arrows, strip charts, and an episode as one page."""

import contextlib
import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from ...controllers.errors import InvalidValueError, MissingExtraError
from ...controllers.model import observation
from ...controllers.model.capturability import recoverable_offset
from ...controllers.model.gait_box import STEP
from ...controllers.whole_body.kinematics import FOOT_BODY, sole_position
from ...envs.biped.core import BipedCore
from ...envs.biped.env import BipedEpisodes
from ...envs.biped.view import set_posture
from ...envs.episode.period_end import LOADED
from ...envs.robots.compiled_robot import CompiledRobot
from ..record.record import Array, gait_episodes
from ..record.words import EpisodeWords
from ..rollout.episodes import GymRobot, planning_period
from .gate import Gate, open_server
from .session import Lane

POINTS = {  # name -> colour, radius [m], columns of the core's `world`
    "DCM": ((194, 23, 138), 0.030, observation.WORLD_DCM),
    "CoP": ((26, 90, 230), 0.022, observation.WORLD_COP),
    "CMP": ((122, 81, 149), 0.018, observation.WORLD_CMP),
}
REGIONS = {  # name -> colour, height over the floor [m]
    "capture region": ((194, 23, 138), 0.004), "box of steps": ((13, 153, 115), 0.005),
    "support polygon": ((26, 90, 230), 0.006),
}  # fmt: skip
FOOTHOLD, FOOTHOLD_COLOUR, FOOTHOLD_HEIGHT = "planned step", (13, 153, 115), 0.007
COLOURS = {name: about[0] for name, about in {**POINTS, **REGIONS}.items()} | {FOOTHOLD: FOOTHOLD_COLOUR}
THICKNESS = 0.008  # of a line [m]
SEGMENTS = 12  # of every region: the hull of two soles has up to 8 corners, and that with the trunk's box 12
LEGS, NOWHERE = (0, 1), np.empty((0, 2))
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def overlays_of(episodes: BipedEpisodes) -> dict[str, Array]:
    """Places of robot 0 on the floor by name, world axes [m]; polygons go round either way, not closed.

    Points (2,): the DCM, the CoP and the CMP. Rectangles (4, 2): the "planned step" is the swing foot's sole
    where it will be set down, the "box of steps" limits the centre of that sole, and in the "capture region"
    of the DCM the planner's limits still allow recovery. The "support polygon" (k, 2) is the hull of the
    soles that carry load; k is 0 in the air.

    While the robot stands, no step is planned, so that both are (0, 2), and the "capture region" (k, 2) is
    where the DCM can be caught without one: the hull of both soles, widened by what the trunk's swing gives.
    """
    core, truth = episodes.core, episodes.core.truth[0]
    limits = episodes.limits
    lean, rate = truth[observation.TRUNK_ANGLE], truth[observation.TRUNK_RATE]
    elapsed = float(truth[observation.ELAPSED])
    offset = recoverable_offset(episodes.robot, limits, max(elapsed, 0.0), lean, rate)
    low = np.array([limits.length_min, limits.width_min])
    high = np.array([limits.length_max, limits.width_max])
    planned, half = core.gait.plan[0, STEP : STEP + 2], np.array(core.body.half_sole)
    points = {name: core.world[0, place : place + 2].copy() for name, (_, _, place) in POINTS.items()}
    if elapsed < 0.0:
        alone = recoverable_offset(episodes.robot, limits, 0.0, lean, rate, flywheel=False)
        trunk = _rectangle(episodes, offset.low - alone.low, offset.high - alone.high)
        trunk -= _rectangle(episodes, np.zeros(2), np.zeros(2))  # from the stance sole
        corners = (_hull_of_soles(episodes, LEGS)[:, None] + trunk).reshape(-1, 2)
        return {
            **points,
            FOOTHOLD: NOWHERE,
            "box of steps": NOWHERE,
            "capture region": corners[ConvexHull(corners).vertices],
            "support polygon": support_polygon(episodes),
        }
    return {
        **points,
        FOOTHOLD: _rectangle(episodes, planned - half, planned + half),
        "box of steps": _rectangle(episodes, low, high),
        "capture region": _rectangle(episodes, offset.low, offset.high),
        "support polygon": support_polygon(episodes),
    }


def _rectangle(episodes: BipedEpisodes, low: Array, high: Array) -> Array:
    """Corners in the world, (4, 2), of a box in the canonical frame."""
    gait = episodes.core.gait
    stance = int(gait.stance[0])
    sole = sole_position(episodes.core.true_state(0), 0, stance)
    frame = observation.canonical_frame(float(gait.heading[0]), stance)
    middle, half = (low + high) / 2, (high - low) / 2
    corners = middle + CORNERS * half
    return np.array([observation.point_in_world(frame, *sole[:2], float(x), float(y)) for x, y in corners])


def support_polygon(episodes: BipedEpisodes) -> Array:
    """Hull (k, 2) of the corners of the soles that carry load, as they lie."""
    return _hull_of_soles(episodes, np.flatnonzero(episodes.info_rows()[0][LOADED] > 0.0).tolist())


def _hull_of_soles(episodes: BipedEpisodes, legs: Sequence[int]) -> Array:
    core, points = episodes.core, []
    state, half = core.true_state(0), np.array(core.body.half_sole)
    for leg in legs:
        axes = state.xmat[0, FOOT_BODY[leg]].reshape(3, 3)[:2, :2]
        points.append(np.array(sole_position(state, 0, leg)[:2]) + (CORNERS * half) @ axes.T)
    if not points:
        return NOWHERE
    corners = np.concatenate(points)
    return corners[ConvexHull(corners).vertices]


class FloorMarks:
    """Handles of the overlays of one robot, in its frame of the scene."""

    def __init__(self, server: Any, root: str):
        scene, nothing = server.scene, np.zeros((SEGMENTS, 2, 3), np.float32)
        self._points = {
            name: scene.add_icosphere(f"{root}/{name}", radius=radius, color=colour, cast_shadow=False)
            for name, (colour, radius, _) in POINTS.items()
        }
        self._regions = {
            name: scene.add_line_segments(f"{root}/{name}", nothing, colour, thickness=THICKNESS)
            for name, (colour, _) in REGIONS.items()
        }
        self._foothold = scene.add_mesh_simple(
            f"{root}/{FOOTHOLD}", np.zeros((4, 3), np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
            color=FOOTHOLD_COLOUR, opacity=0.6, side="double", cast_shadow=False,
        )  # fmt: skip

    def draw(self, overlays: Mapping[str, Array], visible: Mapping[str, bool]) -> None:
        """Put all of them where they are now."""
        stands = len(overlays["support polygon"]) > 0
        for name, handle in self._points.items():
            handle.position = (*overlays[name].tolist(), 0.02)
            handle.visible = visible[name] and (stands or name == "DCM")
        for name, handle in self._regions.items():
            handle.visible = visible[name] and len(overlays[name]) > 0
            if handle.visible:
                handle.points = closed_line(overlays[name], REGIONS[name][1])
        self._foothold.visible = visible[FOOTHOLD] and len(overlays[FOOTHOLD]) > 0
        if self._foothold.visible:
            self._foothold.vertices = at_height(overlays[FOOTHOLD], FOOTHOLD_HEIGHT)


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
CLEAR = 0.2  # from the arrow of a push that was given to the pelvis [m]
SEEN = 0.8  # how long a push that was given is shown [s]


class PushArrow:
    """An arrow of a colour (red, green, blue in 0-255), which is hidden until it is shown."""

    def __init__(self, server: Any, name: str, colour: tuple[int, int, int]):
        nothing = np.zeros((1, 2, 3), np.float32)
        self._arrow = server.scene.add_arrows(
            name, nothing, colour, shaft_radius=0.012, head_radius=0.035, head_length=0.07, visible=False
        )
        self._label = server.scene.add_label(f"{name} label", "", visible=False, anchor="bottom-center")
        self.text = ""  # what stands beside it now

    def show(self, tail: ArrayLike, impulse: ArrayLike, mass: float) -> None:
        """Draw an impulse (2,) [N s] from a point (3,) [m] on."""
        start, size = np.asarray(tail, np.float64), float(np.hypot(*np.asarray(impulse, np.float64)))
        tip: Array = start + np.array([*(LENGTH * np.asarray(impulse, np.float64)), 0.0])
        self._arrow.points = np.array([[start, tip]], np.float32)
        self.text = self._label.text = f"{size:.1f} N s  ({size / mass:.2f} N s/kg)"
        self._label.position = tuple(((start + tip) / 2 + (0.0, 0.0, ABOVE)).tolist())
        self._arrow.visible = self._label.visible = True

    def show_at(self, pelvis: Array, impulse: ArrayLike, mass: float) -> None:
        """Draw an impulse (2,) [N s] that points at a robot's pelvis (3,) [m]."""
        along = np.asarray(impulse, np.float64)
        before = LENGTH * along + CLEAR * along / max(float(np.hypot(*along)), 1e-9)
        self.show(pelvis + (*(-before), 0.1), along, mass)

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
    """Charts of one robot in the panel."""

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
        bounds = lane.recorder.torques.items()
        largest = [max(abs(row[name]) / bound for name, bound in bounds) for row in rows]
        self._handles[TORQUES].data = (time, np.array(largest))


CELL = 0.005  # of the grid on which vertices of a mesh are joined [m]
SEEN_GROUPS = 3  # of geoms, counted from 0: MuJoCo shows these by default
MESHES = "meshes for a browser"  # key by which a robot keeps them
Grab = Callable[[Any, str], None]  # of viser's event and "pelvis" or "trunk"


class RobotMeshes:
    """The bodies of one robot, placed as the simulation has them.

    They look as in films: where the physics of a robot has no more than soles, its own meshes are shown.
    Those were made for other ends than a browser (a Unitree G1 has 400 000 triangles), so they are coarsened.
    `grab` is called with every event of a drag on a body.
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
                    handle.on_drag("left")(_in_order(grab, part))
                self._handles.append((body, handle))

    def draw(self, core: BipedCore) -> Array:
        """Place all bodies as robot 0 has them; returns where the pelvis is, (3,) [m]."""
        set_posture(self._model, self._data, core)
        for body, handle in self._handles:
            handle.position, handle.wxyz = self._data.xpos[body], self._data.xquat[body]
        return self._data.xpos[self._pelvis].copy()


def body_meshes(robot: CompiledRobot) -> dict[int, list[Any]]:
    """Meshes of trimesh by moving body, in the body's own axes; made once for a robot."""
    if MESHES in robot.found:
        return robot.found[MESHES]
    model = robot.picture
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
    robot.found[MESHES] = {
        body: [merged(same_look) for same_look in group_geoms_by_visual_compat(model, own)]
        for body, own in geoms.items()
    }
    return robot.found[MESHES]


def coarse(mesh: Any, cell: float = CELL) -> Any:
    """A mesh of trimesh with one vertex of each colour for each cell [m] of a grid, the mean of those in it.

    Triangles that have lost a side are left out, and so are those that have come twice. A mesh with a texture
    stays as it is.
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


def _in_order(grab: Grab, part: str) -> Any:
    """A callback that viser runs in the order of its events, which it does for coroutines alone."""

    async def called(event: Any) -> None:
        grab(event, part)

    return called


GROUND, LABEL = "/walk", 0.75  # frame that moves so that a robot stays in view; its name over the pelvis [m]
CAMERA, LOOK_AT = (-2.2, -2.0, 1.4), (0.0, 0.0, 0.7)  # [m]
GIVEN = (225, 30, 25)  # colour of the arrow of a push


class Ground:
    """The floor, a grid of half metres without end, in a frame that follows a robot."""

    def __init__(self, server: Any):
        server.initial_camera.position, server.initial_camera.look_at = CAMERA, LOOK_AT
        self.frame = server.scene.add_frame(GROUND, show_axes=False)
        server.scene.add_grid(
            f"{GROUND}/floor", infinite_grid=True, fade_distance=20.0,
            cell_size=0.5, cell_color=(232, 232, 232), section_size=1.0, section_color=(205, 205, 205),
        )  # fmt: skip
        self.given = PushArrow(server, f"{GROUND}/given", GIVEN)

    def follow(self, pelvis: Array) -> None:
        """Keep a pelvis (3,) [m] above the middle of the scene."""
        self.frame.position = (*(-pelvis[:2]).tolist(), 0.0)


class RobotView:
    """One robot in the scene, `aside` [m] to the left of the first: meshes, marks, and words over it."""

    def __init__(
        self, server: Any, name: str, robot: CompiledRobot, aside: float = 0.0, grab: Grab | None = None
    ):
        root = f"{GROUND}/{name}"
        self._frame = server.scene.add_frame(root, show_axes=False, position=(0.0, aside, 0.0))
        self.meshes = RobotMeshes(server, root, robot, grab)
        self._marks = FloorMarks(server, root)
        self._label = server.scene.add_label(f"{root}/name", "", anchor="bottom-center")

    def draw(self, episodes: BipedEpisodes, words: str, visible: Mapping[str, bool]) -> Array:
        """Bring it up to date; returns where the pelvis is, (3,) [m]."""
        pelvis = self.meshes.draw(episodes.core)
        self._marks.draw(overlays_of(episodes), visible)
        self._label.text, self._label.position = words, (*pelvis[:2].tolist(), pelvis[2] + LABEL)
        return pelvis

    def remove(self) -> None:
        """Take it out of the scene, with all that is in its frame."""
        self._frame.remove()


RATE = 30.0  # pictures per simulated second


class Replay:
    """Watches an episode of a biped, and keeps its scene.

    The scene is viser's: it is built on a server whose address nobody gets, and what it would have sent to a
    browser is what the page holds.
    """

    def __init__(self, env: gym.Env, policy: str):
        episodes = gait_episodes(env)
        if not isinstance(episodes, BipedEpisodes):
            raise InvalidValueError(f"only bipeds are replayed in 3D, got {episodes.name}")
        self._episodes, self._policy, self._told = episodes, policy, EpisodeWords()
        self._server = open_server(Gate("127.0.0.1"), 0)
        self._ground = Ground(self._server)
        self.robot = RobotView(self._server, "robot", episodes.core.body)
        self._film = self._server.get_scene_serializer()
        self._every = max(1, round(1.0 / (RATE * planning_period(env))))
        self._pause, self._count = self._every * planning_period(env), 0

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
        self._told.look(robot.info)
        if self._count % self._every == 0 or robot.ended:
            with self._server.atomic():
                self._draw(robot)
            self._film.insert_sleep(self._pause)
        self._count += 1

    def page(self) -> bytes:
        """The page, about 2.5 MB; nothing can be looked at after it."""
        try:
            return self._film.as_html().encode()
        finally:
            with contextlib.redirect_stdout(io.StringIO()):  # it says that it stops
                self._server.stop()

    def _draw(self, robot: GymRobot) -> None:
        words = f"{self._policy}: {self._told}" if robot.ended else self._policy
        pelvis = self.robot.draw(self._episodes, words, dict.fromkeys(COLOURS, True))
        self._ground.follow(pelvis)
        push, arrow = robot.info.get("push") or {}, self._ground.given
        start = push.get("start")
        if start is not None and 0.0 <= robot.info["time"] - start <= SEEN:
            arrow.show_at(pelvis, push["impulse"][:2], self._episodes.robot.mass)
        elif arrow.text:
            arrow.hide()
