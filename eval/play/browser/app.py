"""A session in a browser: the scene, the panel, and the loop that keeps both in step with the clock."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ....controllers.errors import PushRecoveryError
from ...record.sampler import Array
from ..drag import dragged_impulse
from ..overlays import overlays_of
from ..session import Session
from .arrow import LENGTH, PushArrow
from .charts import StripCharts
from .floor_marks import FloorMarks
from .panel import Panel
from .robot_meshes import RobotMeshes

FRAME = 1.0 / 30.0  # [s]
CHARTS_EVERY = 6  # frames
APART = 1.5  # of two robots [m]
LEAST = 0.5  # of an impulse by drag; less is a click [N s]
CLEAR = 0.2  # from the arrow of a push that was given to the pelvis [m]
SEEN = 0.8  # how long a push that was given is shown [s]
CAMERA, LOOK_AT = (-2.2, -2.0, 1.4), (0.0, 0.0, 0.7)  # [m]
PHONE = 0.7  # width over height of a window, below which viser's panel covers the lower 60 % of it
PHONE_CAMERA, PHONE_LOOK_AT = (-3.6, -3.3, 1.5), (0.0, 0.0, -1.4)  # the robot above that panel [m]
AIMED, GIVEN = (245, 95, 85), (225, 30, 25)  # colours of arrows; the pointer has an orange one of viser
WALK = "/walk"  # the frame that moves so that the first robot stays in view


class App:
    """One session and everybody who looks at it.

    Args:
        session: that is played.
        server: of viser, behind its gate.
        policies: to choose from.
        impulse: of the push button at first, size [N s] and direction [deg].
    """

    def __init__(self, session: Session, server: Any, policies: Sequence[str], impulse: tuple[float, float]):
        self.session, self.server = session, server
        self._actions: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self.ended = threading.Event()
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.set_panel_label("push-recovery play")
        server.initial_camera.position, server.initial_camera.look_at = CAMERA, LOOK_AT
        server.on_client_connect(look_above_the_panel)
        self._walk = server.scene.add_frame(WALK, show_axes=False)
        add_floor(server, f"{WALK}/floor")
        self._robots: list[tuple[Any, RobotMeshes, FloorMarks, Any]] = []
        self.aimed = PushArrow(server, f"{WALK}/aimed", AIMED)
        self.given = PushArrow(server, f"{WALK}/given", GIVEN)
        self.panel = Panel(server, session, policies, self.do, impulse)
        with server.gui.add_folder("Charts of the first robot"):
            self.charts = StripCharts(server)
        self._frames, self._pelvis = 0, np.zeros(3)
        self._aim: tuple[Any, Array] = None, np.zeros(2)  # pointer on the screen, impulse shown for it
        self.draw()

    def do(self, action: Callable[[], object]) -> None:
        """Have something done between two planning periods."""
        self._actions.put(action)

    def run(self) -> None:
        """Play until `ended` is set."""
        before = time.monotonic()
        while not self.ended.is_set():
            now = time.monotonic()
            self.frame(now - before)
            before = now
            self.ended.wait(max(0.0, FRAME - (time.monotonic() - now)))

    def frame(self, seconds: float) -> None:
        """What has been asked for, the time that has gone by, and a picture."""
        while not self._actions.empty():
            action = self._actions.get()
            try:
                action()
            except PushRecoveryError as error:
                self._complain(str(error))
        self.session.advance(seconds)
        self.draw()

    def draw(self) -> None:
        """Bring the scene up to date."""
        self._match_robots()
        with self.server.atomic():
            for i, (lane, (_, meshes, marks, label)) in enumerate(
                zip(self.session.lanes, self._robots, strict=True)
            ):
                pelvis = meshes.draw(lane.episodes.core)
                marks.draw(overlays_of(lane.episodes), self.panel.visible)
                label.text, label.position = lane.name, (*pelvis[:2].tolist(), pelvis[2] + 0.75)
                if i == 0:
                    self._pelvis = pelvis
                    self._walk.position = (*(-pelvis[:2]).tolist(), 0.0)
            self._draw_given()
            self.panel.draw()
        if self._frames % CHARTS_EVERY == 0:
            self.charts.draw(self.session.first)
        self._frames += 1

    def grab(self, event: Any, part: str) -> None:
        """A drag on a body has gone on: aim, and where it is let go push with the impulse that is shown."""
        if event.end_screen_pos != self._aim[0] or event.phase == "start":  # else only the robot has moved
            way = np.subtract(event.end_position, event.start_position)
            impulse = dragged_impulse(way, camera_axes(event.client.camera.wxyz))
            self._aim = event.end_screen_pos, impulse
        impulse = self._aim[1]
        if event.phase == "end":
            self.do(lambda: self._let_go(impulse, part))
        else:
            tail = np.asarray(event.start_position) - np.asarray(self._walk.position)
            self.do(lambda: self.aimed.show(tail, impulse, self.session.first.mass))

    def _let_go(self, impulse: Array, part: str) -> None:
        self.aimed.hide()
        if np.hypot(*impulse) >= LEAST:
            self.session.push(impulse, "trunk" if part == "trunk" else "pelvis")

    def _draw_given(self) -> None:
        """The latest push while it acts and shortly after."""
        lane = self.session.first
        push = lane.scenario.pushes[-1] if lane.scenario.pushes else None
        since = np.inf if push is None else lane.time - float(push.start)  # type: ignore[arg-type]
        if push is None or since > SEEN:
            if self.given.text:
                self.given.hide()
            return
        impulse = np.array(push.impulse[:2])
        before = LENGTH * impulse + CLEAR * impulse / max(float(np.hypot(*impulse)), 1e-9)
        self.given.show(self._pelvis + (*(-before), 0.1), impulse, lane.mass)  # it points at the robot

    def _match_robots(self) -> None:
        """As many robots in the scene as in the session, of the same shape."""
        while len(self._robots) > len(self.session.lanes):
            frame, meshes, marks, label = self._robots.pop()
            for part in (meshes, marks, label, frame):
                part.remove()
        while len(self._robots) < len(self.session.lanes):
            i = len(self._robots)
            root, lane = f"{WALK}/robot {i}", self.session.lanes[i]
            frame = self.server.scene.add_frame(root, show_axes=False, position=(0.0, i * APART, 0.0))
            meshes = RobotMeshes(self.server, root, lane.episodes.core.body, self.grab)
            marks = FloorMarks(self.server, root)
            label = self.server.scene.add_label(f"{root}/name", lane.name, anchor="bottom-center")
            self._robots.append((frame, meshes, marks, label))

    def _complain(self, reason: str) -> None:
        """Tell everybody who looks why something was not done."""
        self.panel.agree()
        for client in self.server.get_clients().values():
            client.add_notification("Not done", reason, auto_close_seconds=6.0)


def add_floor(server: Any, name: str) -> None:
    """A grid of half metres, without end."""
    server.scene.add_grid(
        name, infinite_grid=True, fade_distance=20.0,
        cell_size=0.5, cell_color=(232, 232, 232), section_size=1.0, section_color=(205, 205, 205),
    )  # fmt: skip


def look_above_the_panel(client: Any) -> None:
    """Move the camera of a phone so that the panel covers nothing of the robot."""
    if client.camera.aspect < PHONE:
        with client.atomic():
            client.camera.position, client.camera.look_at = PHONE_CAMERA, PHONE_LOOK_AT


def camera_axes(wxyz: Any) -> Array:
    """Axes right, down and view of a camera in the world, (3, 3), from its orientation."""
    import viser.transforms

    turn = viser.transforms.SO3(np.asarray(wxyz, np.float64))
    return np.asarray(turn.as_matrix(), np.float64)
