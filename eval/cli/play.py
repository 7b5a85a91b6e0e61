"""`push-recovery play`."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from ...controllers.errors import UnknownNameError
from ...envs.scenario.push import polar_push
from ...envs.scenario.scenario import Scenario
from . import options
from .options import Count, EnvOptions, NameOrFile, PolicyName, PushOptions, Real, within


@dataclass(frozen=True, kw_only=True)
class Play(EnvOptions, PushOptions):
    """Play with a walking robot, or write one push to files."""

    policy: PolicyName = "two-stage"
    """Policy that acts: name (see list), policy file, or MODULE:ATTRIBUTE."""
    force: Real = field(default=200.0, metadata=within(0, 10_000))
    """Force of the push [N]; times the duration it is the impulse [N s]."""
    psi: Real = field(default=0.0, metadata=within(-360, 360))
    """Direction of the push [deg]: 0 is forward, 90 to the left, 180 backward, 270 to the right."""
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
        from .show import Written, show_episode

        written = Written(*(None if name is None else Path(name) for name in (self.out, self.log, self.plot)))
        if not any(written):
            self._play(scenario)
            return
        words = show_episode(self.env_id, self.policy, scenario, written)
        paths = "".join(f"; {path}" for path in written if path is not None)
        print(f"{self.policy}: {words}{paths}")

    def _play(self, scenario: Scenario) -> None:
        """A robot that walks as a scenario says, and gets its first push at the press of a key."""
        print("plays until Ctrl-C; the robot is loaded first, a few seconds", flush=True)
        from ..play import browser, desktop, gate
        from ..play.session import Session
        from ..rollout.load_policy import policy_names

        pushes = scenario.pushes or (polar_push(0.0, 0.0, self.duration, 0.0),)
        impulse = pushes[0].impulse_magnitude, math.degrees(pushes[0].direction)
        if self.viewer == "mujoco":
            desktop.play_in_window(lambda: Session(self.env_id, self.policy, self.beside, scenario), impulse)
            return
        browser.require_play()
        session = Session(self.env_id, self.policy, self.beside, scenario)
        names = dict.fromkeys([self.policy, *filter(None, [self.beside]), *policy_names()])
        browser.play(session, list(names), gate.Gate(self.host, self.token), self.port, impulse)

    def _scenario(self) -> Scenario:
        """The scenario named, or the frontier's push with the options' force and direction."""
        if self.suite is not None or self.scenario is not None:
            suite = options.pushes_of(self)
            found = {scenario.id: scenario for scenario in suite.scenarios}
            if self.scenario is None:
                return suite.scenarios[0]
            if self.scenario not in found:
                some = [*list(found)[:3], f"... {len(found)} in all"]
                raise UnknownNameError(f"scenario of suite {suite.name}", self.scenario, some)
            return found[self.scenario]
        scenario = self.scanned(self.env_id).scenario(self.psi, self.force)
        return replace(scenario, id=f"push-{self.force:g}N-{self.psi:g}deg")
