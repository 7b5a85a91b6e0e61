"""An episode as one page that needs nothing else: turn about it, stop it, play it again."""

from __future__ import annotations

import contextlib
import io

import gymnasium as gym
import numpy as np

from ...controllers.errors import InvalidValueError
from ...envs.biped.env import BipedEpisodes
from ..record.record import gait_episodes
from ..record.words import describe
from ..rollout.episodes import GymRobot, planning_period
from .browser import CAMERA, CLEAR, GIVEN, LOOK_AT, SEEN, WALK, add_floor
from .gate import Gate, open_server
from .scene import COLOURS, LENGTH, FloorMarks, PushArrow, RobotMeshes, overlays_of

RATE = 30.0  # pictures per simulated second
ABOVE = 0.75  # from the pelvis to the words over the robot [m]


class Replay:
    """Watches an episode of a biped, and keeps its scene.

    The scene is viser's: it is built on a server that nobody is told of, and what it would have sent to a
    browser is what the page holds.

    Args:
        env: that the episode is run in.
        policy: that acts, as it stands over the robot.

    Raises:
        InvalidValueError: no biped.
        MissingExtraError: viser is not installed.
    """

    def __init__(self, env: gym.Env, policy: str):
        episodes = gait_episodes(env)
        if not isinstance(episodes, BipedEpisodes):
            raise InvalidValueError(f"only bipeds are replayed in 3D, got {episodes.name}")
        self._episodes, self._policy = episodes, policy
        self._server = server = open_server(Gate("127.0.0.1"), 0)
        server.initial_camera.position, server.initial_camera.look_at = CAMERA, LOOK_AT
        self._walk = server.scene.add_frame(WALK, show_axes=False)
        add_floor(server, f"{WALK}/floor")
        self._meshes = RobotMeshes(server, f"{WALK}/robot", episodes.core.body)
        self._marks = FloorMarks(server, f"{WALK}/robot")
        self._label = server.scene.add_label(f"{WALK}/words", policy, anchor="bottom-center")
        self._arrow = PushArrow(server, f"{WALK}/push", GIVEN)
        self._film = server.get_scene_serializer()
        self._every = max(1, round(1.0 / (RATE * planning_period(env))))
        self._pause, self._count = self._every * planning_period(env), 0

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
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
        pelvis = self._meshes.draw(self._episodes.core)
        self._marks.draw(overlays_of(self._episodes), dict.fromkeys(COLOURS, True))
        self._walk.position = (*(-pelvis[:2]).tolist(), 0.0)
        self._label.position = (*pelvis[:2].tolist(), pelvis[2] + ABOVE)
        if robot.ended:
            self._label.text = f"{self._policy}: {describe(robot.info)}"
        push = robot.info.get("push") or {}
        start = push.get("start")
        if start is not None and 0.0 <= robot.info["time"] - start <= SEEN:
            impulse = np.array(push["impulse"][:2])
            tip = pelvis[:2] - CLEAR * impulse / max(float(np.hypot(*impulse)), 1e-9)
            self._arrow.show((*(tip - LENGTH * impulse), pelvis[2] + 0.1), impulse, self._episodes.robot.mass)
        elif self._arrow.text:
            self._arrow.hide()
