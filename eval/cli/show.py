"""Write one episode as a film, a contact sheet, a page in 3D, arrays or a figure."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import gymnasium as gym

from ...controllers.errors import UnknownNameError
from ...controllers.files import write_atomically
from ...envs.scenario.scenario import Scenario
from ..output.progress import Work, about, progress_bars
from ..output.rows import require_place
from ..play import browser, replay
from ..record import film, plot, record
from ..record.words import describe
from ..rollout.episodes import GymRobot, Watch, planning_period, rollout
from ..rollout.policy_source import acting_in

FILMED, WATCHED = 20.0, 5.0  # seconds that an episode takes, about
FORMATS = (".mp4", ".gif", ".png", ".html")


class Written(NamedTuple):
    """The files that an episode is written to, each where it is asked for."""

    out: Path | None = None  # film, contact sheet or page
    log: Path | None = None  # time histories
    plot: Path | None = None  # their figure

    def check(self) -> str:
        """Refuse other formats, and what can't be written here; returns the suffix of `out`."""
        for path, valid in zip(self, (FORMATS, record.LOG_FORMATS, plot.PLOT_FORMATS), strict=True):
            if path is not None and path.suffix.lower() not in valid:
                raise UnknownNameError("output format", path.suffix.lower() or str(path), valid)
        suffix = "" if self.out is None else self.out.suffix.lower()
        if suffix == ".mp4":
            film.require_imageio()
        elif suffix == ".html":
            browser.require_play()
        for path in filter(None, self):
            require_place(path)
        return suffix


def show_episode(env_id: str, policy: str, scenario: Scenario, written: Written) -> str:
    """Run a scenario and write what has been asked for; returns the push and its outcome in words."""
    suffix, last = written.check(), {}
    drawn = None if suffix in {"", ".html"} else "rgb_array"
    with acting_in(env_id, policy, render_mode=drawn) as (env, acting, _):
        watch, content = _observer(suffix, policy, env)

        def look(robot: GymRobot) -> None:
            last.update(info=robot.info)
            if watch is not None:
                watch(robot)

        work = Work(f"one episode of {policy}", about(WATCHED if written.out is None else FILMED))
        with progress_bars([policy], 1, work) as bars:
            if written.log is None and written.plot is None:
                rollout(env, acting, scenario, policy, look)
            else:
                found = record.record_episode(env, acting, scenario, policy, look)
                if written.log is not None:
                    record.write_log(found, written.log)
                if written.plot is not None:
                    plot.write_plot(found, written.plot)
            if written.out is not None:
                write_atomically(written.out, content())
            bars.set(policy, 1)
    return describe(last["info"])


def _observer(suffix: str, policy: str, env: gym.Env) -> tuple[Watch | None, Callable[[], bytes]]:
    """Who looks at an episode for a file of a format, and what makes its content in the end."""
    if not suffix:
        return None, bytes
    if suffix == ".html":
        watch = replay.Replay(env, policy)
        return watch, watch.page
    shot = film.Shot(policy, planning_period(env))
    if suffix == ".png":
        return shot, lambda: film.strip(shot)
    return shot, lambda: film.episode_film(shot, suffix)
