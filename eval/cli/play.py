"""`push-recovery play`: a robot in the browser, or one episode as a film, a page, arrays or a figure."""

import math
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from tyro.conf import arg

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.files import write_atomically
from ...envs.scenario.push import polar_push
from ...envs.scenario.scenario import Scenario
from ..output.progress import Work, about, progress_bars
from . import options
from .options import (
    Count,
    CountOrNone,
    EnvOptions,
    NameOrFile,
    PolicyName,
    PushOptions,
    Real,
    RealOrNone,
    within,
)

FORCE = 200.0  # of a push of which nothing is said [N]


@dataclass(frozen=True, kw_only=True)
class Play(EnvOptions, PushOptions):
    """Play with a walking robot, or write one push to files."""

    policy: PolicyName = "two-stage"
    """Policy that acts: name (see list), policy file, or MODULE:ATTRIBUTE."""
    force: RealOrNone = field(default=None, metadata=within(0, 10_000))
    """Force of the push [N]; times the duration it is the impulse [N s] (default: 200)."""
    impulse: RealOrNone = field(default=None, metadata=within(0, 10_000))
    """Impulse of the push [N s], in place of its force."""
    impulse_per_kg: RealOrNone = field(default=None, metadata=within(0, 100))
    """Impulse of the push by the robot's mass [N s/kg], in place of its force."""
    psi: Real = field(default=0.0, metadata=within(-360, 360))
    """Direction of the push [deg]: 0 is forward, 90 to the left, 180 backward, 270 to the right."""
    replica: CountOrNone = field(default=None, metadata=within(0))
    """Number of a replica of the push, as `frontier` runs them (by default the nominal trajectory)."""
    suite: NameOrFile = None
    """Take the push from this suite instead."""
    scenario: Annotated[str | None, arg(metavar="ID", help_behavior_hint="")] = None
    """Id of the scenario in the suite (by default the first one)."""
    out: options.FileName = None
    """Write one push as a film (mp4 or gif), as six moments (png) or as a page in 3D (html)."""
    log: options.FileName = None
    """Write the episode of one push as arrays (npz) or text (csv): DCM, CoP, CMP, trunk, steps, torques,
    limits met."""
    plot: options.FileName = None
    """Draw the episode of one push over time (png or svg)."""
    viewer: Literal["browser", "mujoco"] = "browser"
    """Where you play with the robot: on a page in the browser, or in MuJoCo's own window."""
    beside: NameOrFile = None
    """Policy of a second robot that gets the same pushes."""
    host: Annotated[str, arg(metavar="ADDRESS")] = "127.0.0.1"
    """Address that the page is served on; with any but this computer's own it asks for a token."""
    token: Annotated[str, arg(metavar="WORD", help_behavior_hint="(made up where one is needed)")] = ""
    """Token that the page's address must hold."""
    port: Count = field(default=8080, metadata=within(0, 65535))
    """Port of the page; if it is taken, the next free one is used."""

    def run(self) -> None:
        """Play until Ctrl-C, or render one episode and say what became of it."""
        scenario = self._scenario()
        written = Written(*(None if name is None else Path(name) for name in (self.out, self.log, self.plot)))
        if not any(written):
            with suppress(KeyboardInterrupt):  # the way to end it, and no error
                self._play(scenario)
            return
        words = show_episode(self.env_id, self.policy, scenario, written)
        paths = "".join(f"; {path}" for path in written if path is not None)
        print(f"{self.policy}: {words}{paths}")

    def _play(self, scenario: Scenario) -> None:
        """A robot that walks as a scenario says, and gets its first push at the press of a key."""
        print("plays until Ctrl-C; the robot is loaded first, a few seconds", flush=True)
        from ..play import browser, desktop, gate
        from ..play.session import FirstPush, Session
        from ..rollout.environments import policy_names_for

        push, *_ = scenario.pushes or (polar_push(0.0, 0.0, self.duration, 0.0, self.body),)
        # only these two are pushed by hand
        body: Literal["trunk", "pelvis"] = "trunk" if push.body == "trunk" else "pelvis"
        first = FirstPush(push.impulse_magnitude, math.degrees(push.direction), body)
        if self.viewer == "mujoco":
            desktop.play_in_window(lambda: Session(self.env_id, self.policy, self.beside, scenario), first)
            return
        browser.require_play()
        session = Session(self.env_id, self.policy, self.beside, scenario)
        names = dict.fromkeys(
            [self.policy, *filter(None, [self.beside]), *policy_names_for(session.first.env)]
        )
        browser.play(session, list(names), gate.Gate(self.host, self.token), self.port, first)

    def _scenario(self) -> Scenario:
        """The scenario named, or the frontier's push with the options' force and direction."""
        if self.suite is not None or self.scenario is not None:
            suite = options.pushes_of(self, self.suite, self.profile)
            found = {scenario.id: scenario for scenario in suite.scenarios}
            if self.scenario is None:
                return suite.scenarios[0]
            if self.scenario not in found:
                some = [*list(found)[:3], f"... {len(found)} in all"]
                raise UnknownNameError(f"scenario of suite {suite.name}", self.scenario, some)
            return found[self.scenario]
        force = self._force()
        settings, name = self.scanned(self.env_id), f"push-{force:g}N-{self.psi:g}deg"
        if self.replica is None:
            return replace(settings.scenario(self.psi, force), id=name)
        return replace(settings.replicated(self.psi, force, self.replica), id=f"{name}-{self.replica}")

    def _force(self) -> float:
        """The force of the push [N], by whichever of the three options says how hard it is."""
        given = [value for value in (self.force, self.impulse, self.impulse_per_kg) if value is not None]
        if len(given) > 1:
            raise InvalidValueError("of --force, --impulse and --impulse-per-kg only one can be given")
        if self.impulse_per_kg is not None:
            from ..rollout.environments import make_env

            with closing(make_env(self.env_id)) as env:
                robot: Any = env.unwrapped
                return self.impulse_per_kg * robot.robot.mass / self.duration
        if self.impulse is not None:
            return self.impulse / self.duration
        return FORCE if self.force is None else self.force


FILMED, WATCHED = 20.0, 5.0  # seconds that an episode takes, about
FORMATS = (".mp4", ".gif", ".png", ".html")


class Written(NamedTuple):
    """The files that an episode is written to, each where it is asked for."""

    out: Path | None = None  # film, contact sheet or page
    log: Path | None = None  # time histories
    plot: Path | None = None  # their figure

    def check(self) -> str:
        """Refuse other formats, and what can't be written here; returns the suffix of `out`."""
        from ..output.rows import require_place
        from ..play import browser
        from ..record import film, plot, record

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
    from ..record import plot, record
    from ..record.words import EpisodeWords
    from ..rollout.episodes import rollout
    from ..rollout.policy_source import acting_in

    suffix, told = written.check(), EpisodeWords()
    drawn = None if suffix in {"", ".html"} else "rgb_array"
    with acting_in(env_id, policy, render_mode=drawn) as (env, acting, _):
        watch, content = _observer(suffix, policy, env)

        def look(robot: Any) -> None:
            told.look(robot.info)
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
    return str(told)


def _observer(suffix: str, policy: str, env: Any) -> tuple[Any, Callable[[], bytes]]:
    """Who looks at an episode for a file of a format, and what makes its content in the end."""
    from ..play.scene import Replay
    from ..record import film
    from ..rollout.episodes import planning_period

    if not suffix:
        return None, bytes
    if suffix == ".html":
        watch = Replay(env, policy)
        return watch, watch.page
    shot = film.Shot(policy, planning_period(env))
    if suffix == ".png":
        return shot, lambda: film.strip(shot)
    return shot, lambda: film.episode_film(shot, suffix)
