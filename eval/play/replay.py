"""An episode as one page that needs nothing else: turn about it, stop it, play it again."""

import contextlib
import io

import gymnasium as gym

from ...controllers.errors import InvalidValueError
from ...envs.biped.env import BipedEpisodes
from ..record.record import gait_episodes
from ..record.words import describe
from ..rollout.episodes import GymRobot, planning_period
from .gate import Gate, open_server
from .scene import COLOURS, SEEN, Ground, RobotView

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
        self._episodes, self._policy = episodes, policy
        self._server = open_server(Gate("127.0.0.1"), 0)
        self._ground = Ground(self._server)
        self.robot = RobotView(self._server, "robot", episodes.core.body)
        self._film = self._server.get_scene_serializer()
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
        words = f"{self._policy}: {describe(robot.info)}" if robot.ended else self._policy
        pelvis = self.robot.draw(self._episodes, words, dict.fromkeys(COLOURS, True))
        self._ground.follow(pelvis)
        push, arrow = robot.info.get("push") or {}, self._ground.given
        start = push.get("start")
        if start is not None and 0.0 <= robot.info["time"] - start <= SEEN:
            arrow.show_at(pelvis, push["impulse"][:2], self._episodes.robot.mass)
        elif arrow.text:
            arrow.hide()
