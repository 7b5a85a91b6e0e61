"""Watchers of bipeds in an episode loop, who look at them after every action or command them."""

from __future__ import annotations

from contextlib import closing
from typing import Any, Protocol

from ...controllers.errors import InvalidValueError
from ...envs.biped.core import BipedCore
from ...envs.biped.env import BipedEpisodes
from ...envs.robots.compiled_robot import CompiledRobot
from ...envs.scenario.scenario import Scenario
from ..rollout.environments import make_env
from ..rollout.episodes import Ints, Observer
from ..rollout.outcome import Outcome

Found = dict[str, Any]


class Watcher(Protocol):
    """Looks at robots of a core; one robot at a time."""

    def begin(self, core: BipedCore, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario."""
        ...

    def look(self, core: BipedCore, k: int) -> None:
        """Robot k has acted, or has just begun."""
        ...

    def found(self, core: BipedCore, k: int, outcome: Outcome) -> Found:
        """Entries of the row of the episode that has ended, besides its outcome's."""
        ...


def biped_of(env_id: str) -> CompiledRobot:
    """The robot of an environment.

    Raises:
        InvalidValueError: it is of another kind.
    """
    with closing(make_env(env_id)) as env:
        return _checked(getattr(env.unwrapped, "episodes", None)).core.body


def _checked(episodes: Any) -> BipedEpisodes:
    if not isinstance(episodes, BipedEpisodes):
        raise InvalidValueError("protocols of other groups are for the biped's environments")
    return episodes


class Watched(Observer):
    """A watcher in an episode loop; `found` has its entries of rows by scenario id."""

    def __init__(self, watcher: Watcher):
        self.found: dict[str, Found] = {}
        self._watcher = watcher

    def begin(self, robots: Any, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario.

        Raises:
            InvalidValueError: it is no biped.
        """
        core = _checked(robots.episodes).core
        self._watcher.begin(core, k, scenario)
        self._watcher.look(core, k)

    def after_step(self, robots: Any, rows: Ints) -> None:
        """The robots `rows` have acted."""
        for k in rows.tolist():
            self._watcher.look(robots.episodes.core, k)

    def end(self, robots: Any, k: int, outcome: Outcome) -> None:
        """The episode of robot k has ended."""
        self.found[outcome.scenario_id] = self._watcher.found(robots.episodes.core, k, outcome)
