"""Run policies under a protocol, with a watcher beside the robots; rows survive a kill, on any processes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from ...controllers.errors import InvalidValueError
from ...controllers.model.robot import RobotModel
from ...controllers.policies.interface import Policy, as_policy
from ...envs.biped.core import BipedCore
from ...envs.biped.env import BipedEpisodes
from ...envs.robots.compiled_robot import CompiledRobot
from ...envs.scenario.scenario import Scenario
from ..output.progress import Work, about, progress_bars
from ..rollout.environments import code_digest, env_label, make_env, preset_digest
from ..rollout.episodes import GymRobot, Ints, Robots, begin_policy, run_episodes
from ..rollout.outcome import Ending
from ..rollout.policy_source import guessed_seconds, open_rows, policy_sources
from ..rollout.workers import Runner, chunk_sizes, make_chunks, parallel
from .kick import KickWatcher
from .tour import TourWatcher

FORMAT = 2  # of the rows
KEY = ("policy", "scenario_id")  # of a row
SCORED = ("recovered", "survived", "failure_reason", "end_time")

Row = dict[str, Any]
Job = tuple[str, str, tuple[Scenario, ...]]  # protocol, label of a policy, scenarios


class Watcher(Protocol):
    """Looks at robots of a core, one at a time, and may write their commands."""

    def begin(self, core: BipedCore, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario."""
        ...

    def look(self, core: BipedCore, k: int) -> None:
        """Robot k has acted, or has just begun."""
        ...

    def end(self, core: BipedCore, k: int, ending: Ending) -> dict[str, Any]:
        """Entries of the row of the episode that has ended, besides its outcome."""
        ...


WATCHERS: Mapping[str, Callable[[], Watcher]] = MappingProxyType({"kick": KickWatcher, "tour": TourWatcher})


def biped_of(env_id: str) -> CompiledRobot:
    """The robot of an environment.

    Raises:
        InvalidValueError: it is of another kind.
    """
    with closing(make_env(env_id)) as env:
        return _bipeds(getattr(env.unwrapped, "episodes", None)).core.body


def _bipeds(episodes: Any) -> BipedEpisodes:
    if not isinstance(episodes, BipedEpisodes):
        raise InvalidValueError("protocols of other groups are for the biped's environments")
    return episodes


class Watched:
    """Robots that `run_episodes` takes, beside a watcher; `found` has its entries by scenario id.

    Args:
        robots: of an episode loop.
        episodes: theirs.
        watcher: looks at them after every action.

    Raises:
        InvalidValueError: they are robots of another kind than bipeds.
    """

    def __init__(self, robots: Robots, episodes: Any, watcher: Watcher):
        self.n, self.found = robots.n, {}
        self.rest, self.observe = robots.rest, robots.observe
        self._robots, self._core, self._watcher = robots, _bipeds(episodes).core, watcher
        self._ids: dict[int, str] = {}

    def begin(self, k: int, scenario: Scenario) -> None:
        """Begin a scenario with robot k."""
        self._robots.begin(k, scenario)
        self._ids[k] = scenario.id
        self._watcher.begin(self._core, k, scenario)
        self._watcher.look(self._core, k)

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """Act, then look."""
        ended = self._robots.step(rows, actions)
        for k in rows.tolist():
            self._watcher.look(self._core, k)
        return ended

    def ending(self, k: int) -> Ending:
        """How the episode of robot k has ended."""
        ending = self._robots.ending(k)
        self.found[self._ids[k]] = self._watcher.end(self._core, k, ending)
        return ending


@dataclass(frozen=True)
class PushProtocol:
    """A protocol of another group: its name says who watches, its scenarios what happens."""

    name: str  # of WATCHERS
    form: str  # of its scenarios
    robot: RobotModel  # that they were made for
    scenarios: tuple[Scenario, ...]

    def with_collisions(self) -> PushProtocol:
        """The same on robots that do not pass through themselves."""
        scenarios = (replace(one, errors=replace(one.errors, collisions=True)) for one in self.scenarios)
        return replace(self, scenarios=tuple(scenarios))

    @property
    def collisions(self) -> bool:
        """Whether legs, arms and trunk collide with each other, see `ModelErrors`."""
        return any(scenario.errors.collisions for scenario in self.scenarios)

    def summary(self) -> dict[str, Any]:
        """Name, form, and the hash of all scenarios as canonical JSON."""
        lines = "\n".join(scenario.to_json() for scenario in self.scenarios)
        digest = hashlib.sha256(lines.encode()).hexdigest()
        return {"name": self.name, "form": self.form, "sha256": digest, "episodes": len(self.scenarios)}


@dataclass(frozen=True)
class Results:
    """Rows of policies under one protocol."""

    protocol: PushProtocol
    env_id: str
    rows: dict[str, list[Row]]  # policy -> rows in the scenarios' order
    directory: Path


def run_protocol(
    protocol: PushProtocol,
    env_id: str,
    policies: Any,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
) -> Results:
    """Run every policy on every scenario of a protocol; rows present in the directory are kept.

    Args:
        protocol: what happens.
        env_id: environment, a form of the biped.
        policies: names, files, MODULE:ATTRIBUTE or objects, or a mapping of labels to them.
        workers: processes.
        directory: where outcomes.jsonl and config.json go; by default under runs/.
        overwrite: start over where the directory holds rows.

    Raises:
        PushRecoveryError: as `evaluate`, or the robot is no biped.
    """
    sources = policy_sources(policies)
    sizes = chunk_sizes(env_id, sources)
    config = {"format": FORMAT, "protocol": protocol.summary(), "env": env_id, "code": code_digest()}
    label = f"{protocol.name}-{protocol.form}-{env_label(env_id)}"
    config |= preset_digest(env_id)
    store, digests = open_rows(label, config, sources, KEY, SCORED, directory, overwrite)
    with store:
        missing = {
            name: [s for s in protocol.scenarios if (name, s.id) not in store.rows] for name in sources
        }
        jobs = [(protocol.name, *chunk) for chunk in make_chunks(missing, sizes, workers)]
        found = chain.from_iterable(parallel(env_id, run_watched, jobs, workers, sources))
        seconds = guessed_seconds(env_id, missing, sources, workers)
        ids = {scenario.id for scenario in protocol.scenarios}
        done = {name: sum(key[0] == name and key[1] in ids for key in store.rows) for name in digests}
        what = f"{protocol.name}: {len(ids)} episodes of {', '.join(digests)}"
        with progress_bars(
            list(digests), len(ids), Work(what, about(seconds), store.directory), done
        ) as bars:
            for row in found:
                store.append({**row, "policy_sha256": digests[row["policy"]]})
                done[row["policy"]] += 1
                bars.set(row["policy"], done[row["policy"]])
    rows = {name: [store.rows[name, s.id] for s in protocol.scenarios] for name in sources}
    return Results(protocol, env_id, rows, store.directory)


def run_watched(runner: Runner, job: Job) -> list[Row]:
    """The task of `parallel`: rows of one policy, its outcomes and the watcher's entries."""
    protocol, label, scenarios = job
    policy, robots, watcher = as_policy(runner.policy(label)), runner.robots(label), WATCHERS[protocol]()
    if robots is not None:
        return list(_rows(Watched(robots, robots.episodes, watcher), policy, scenarios, label))
    rows, env = [], runner.env_of(label)
    alone = Watched(GymRobot(env), getattr(env.unwrapped, "episodes", None), watcher)
    for scenario in scenarios:
        begin_policy(policy, scenario)
        rows += _rows(alone, policy, (scenario,), label)
    return rows


def _rows(robots: Watched, policy: Policy, scenarios: tuple[Scenario, ...], label: str) -> Iterator[Row]:
    for _, outcome in run_episodes(robots, policy, scenarios, label):
        yield {**outcome.to_dict(), **robots.found.pop(outcome.scenario_id)}
