"""Write one episode as a film, a contact sheet, a page in 3D, arrays or a figure."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym

from ...controllers.errors import UnknownNameError
from ...controllers.files import write_atomically
from ...controllers.policies.interface import Policy
from ...envs.scenario.scenario import Scenario
from ..film.camera import Camera
from ..film.captions import Shot
from ..film.encode import require_imageio
from ..film.film import episode_film
from ..film.strip import strip
from ..output.place import require_place
from ..output.progress import progress_bars
from ..output.work import Work, about
from ..record.files import LOG_FORMATS, write_log
from ..record.plot import PLOT_FORMATS, write_plot
from ..record.record import record_episode
from ..record.words import describe
from ..rollout.loop import Watch
from ..rollout.one import GymRobot, planning_period, rollout
from ..rollout.policy_source import acting_in

FILMED, WATCHED = 20.0, 5.0  # seconds that an episode takes, about
FORMATS = (".mp4", ".gif", ".png", ".html")


class Written(NamedTuple):
    """The files that an episode is written to, each where it is asked for."""

    out: Path | None = None  # film, contact sheet or page
    log: Path | None = None  # time histories
    plot: Path | None = None  # their figure

    def check(self) -> str:
        """Refuse other formats and places that can't be written to; returns the suffix of `out`.

        Raises:
            UnknownNameError: a suffix is no known format.
            InvalidValueError: a file can't be written.
            MissingExtraError: what writes a film or a page is not installed.
        """
        suffix = "" if self.out is None else output_suffix(self.out, FORMATS)
        for path, valid in ((self.log, LOG_FORMATS), (self.plot, PLOT_FORMATS)):
            if path is not None:
                output_suffix(path, valid)
        if suffix == ".mp4":
            require_imageio()
        elif suffix == ".html":
            from ..play.browser.open import require_play

            require_play()
        for path in filter(None, self):
            require_place(path)
        return suffix


class _Spectator:
    """Watches an episode for its last info; another one may look with it."""

    def __init__(self, beside: Watch | None):
        self.info: dict[str, Any] = {}
        self._beside = beside

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
        self.info = robot.info
        if self._beside is not None:
            self._beside(robot)


def show_episode(env_id: str, policy: str, scenario: Scenario, written: Written) -> str:
    """Run a scenario and write what has been asked for; returns the push and its outcome in words.

    Raises:
        PushRecoveryError: as `Written.check`, before the episode begins.
    """
    suffix = written.check()
    drawn = None if suffix in {"", ".html"} else "rgb_array"
    with acting_in(env_id, policy, render_mode=drawn) as (env, acting, _):
        work = Work(f"one episode of {policy}", about(WATCHED if written.out is None else FILMED))
        with progress_bars([policy], 1, work) as bars:
            spectator = _write(env, acting, policy, scenario, written, suffix)
            bars.set(policy, 1)
    return describe(spectator.info)


def _write(
    env: gym.Env, acting: Policy, name: str, scenario: Scenario, written: Written, suffix: str
) -> _Spectator:
    """Run a scenario and write what has been asked for; returns who has watched it."""
    watch, finish = _eye(suffix, name, env)
    spectator = _Spectator(watch)
    if written.log is None and written.plot is None:
        rollout(env, acting, scenario, name, spectator)
    else:
        found = record_episode(env, acting, scenario, name, spectator)
        if written.log is not None:
            write_log(found, written.log)
        if written.plot is not None:
            write_plot(found, written.plot)
    if written.out is not None:
        write_atomically(written.out, finish())
    return spectator


def _eye(suffix: str, policy: str, env: gym.Env) -> tuple[Watch | None, Callable[[], bytes]]:
    """Who looks for a file of a format, and what makes its content in the end."""
    if not suffix:
        return None, bytes
    if suffix == ".html":
        from ..play.browser.replay import Replay

        replay = Replay(env, policy)
        return replay, replay.page
    camera = Camera(planning_period(env))
    if suffix == ".png":
        return camera, lambda: strip(Shot(policy, camera))
    return camera, lambda: episode_film(Shot(policy, camera), suffix)


def output_suffix(path: Path, valid: tuple[str, ...]) -> str:
    """The suffix of an output file; raises UnknownNameError listing the valid ones."""
    suffix = path.suffix.lower()
    if suffix not in valid:
        raise UnknownNameError("output format", suffix or str(path), valid)
    return suffix
