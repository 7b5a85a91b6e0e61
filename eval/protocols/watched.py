"""Robots of an episode loop beside a watcher, who looks at them after every action or tells them to walk."""

from __future__ import annotations

from contextlib import closing
from typing import Any, Protocol

from ...controllers.errors import InvalidValueError
from ...envs.biped.core import BipedCore
from ...envs.biped.env import BipedEpisodes
from ...envs.robots.compiled_robot import CompiledRobot
from ...envs.scenario.scenario import Scenario
from ..rollout.environments import make_env
from ..rollout.episodes import Ints, Robots
from ..rollout.outcome import Ending

Found = dict[str, Any]


class Watcher(Protocol):
    """Looks at robots of a core; one robot at a time."""

    def begin(self, core: BipedCore, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario."""
        ...

    def look(self, core: BipedCore, k: int) -> None:
        """Robot k has acted, or has just begun."""
        ...

    def found(self, core: BipedCore, k: int, ending: Ending) -> Found:
        """What is told of the episode that has ended, besides its outcome."""
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


class Watched:
    """Robots that `run_episodes` takes, with a watcher; `found` has what it tells, by scenario id."""

    def __init__(self, robots: Robots, episodes: Any, watcher: Watcher):
        """Put a watcher beside robots whose `episodes` are those of bipeds.

        Raises:
            InvalidValueError: they are those of another kind of robot.
        """
        self.n, self.found = robots.n, {}
        self._robots, self._core, self._watcher = robots, _checked(episodes).core, watcher
        self._ids: dict[int, str] = {}

    def begin(self, k: int, scenario: Scenario) -> None:
        """Begin a scenario with robot k."""
        self._robots.begin(k, scenario)
        self._ids[k] = scenario.id
        self._watcher.begin(self._core, k, scenario)
        self._watcher.look(self._core, k)

    def rest(self, k: int) -> None:
        """Robot k is no longer needed."""
        self._robots.rest(k)

    def observe(self, rows: Ints) -> Any:
        """What the policy is to see."""
        return self._robots.observe(rows)

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """Act, then look."""
        ended = self._robots.step(rows, actions)
        for k in rows.tolist():
            self._watcher.look(self._core, k)
        return ended

    def ending(self, k: int) -> Ending:
        """How the episode of robot k has ended."""
        ending = self._robots.ending(k)
        self.found[self._ids[k]] = self._watcher.found(self._core, k, ending)
        return ending
