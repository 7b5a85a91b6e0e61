"""Run policies under a protocol, with a watcher beside the robots; rows survive a kill, on any processes."""

import hashlib
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, Self

from ...controllers.errors import InvalidValueError
from ...controllers.model.robot import RobotModel
from ...envs.biped.env import BipedEpisodes
from ...envs.joint.full_body import driven
from ...envs.robots.compiled_robot import CompiledRobot, compiled_robot
from ...envs.scenario.scenario import AT_REST, Scenario
from ..output.progress import Work, about, progress_bars
from ..rollout.environments import code_digest, env_label, make_env, preset_digest
from ..rollout.episodes import Ints, Observer
from ..rollout.outcome import Outcome
from ..rollout.policy_source import guessed_seconds, keep_rows, open_rows, policy_sources
from ..rollout.workers import Runner, chunk_sizes, make_chunks, parallel
from .kick import KickWatcher
from .tour import TourWatcher

FORMAT = 2  # of the rows
ARMS = ("held", "walking")  # that a harness drives on a tour, whose form is then "arms ..."
KEY = ("policy", "scenario_id")  # of a row
SCORED = ("recovered", "survived", "failure_reason", "end_time")

Row = dict[str, Any]
Job = tuple[str, str, tuple[Scenario, ...]]  # protocol, label of a policy, scenarios


WATCHERS = {  # by name and form: look at robots one by one; may write their commands
    "kick": KickWatcher, "tour": TourWatcher, **{f"tour arms {a}": partial(TourWatcher, arms=a) for a in ARMS}
}  # fmt: skip


def biped_of(env_id: str, whole: bool = False) -> CompiledRobot:
    """The robot of an environment, which has to be one of the biped's; `whole` with all joints driven."""
    with closing(make_env(env_id)) as env:
        body = _bipeds(getattr(env.unwrapped, "episodes", None)).core.body
    return compiled_robot(driven(body.description)) if whole else body


def _bipeds(episodes: Any) -> BipedEpisodes:
    if not isinstance(episodes, BipedEpisodes):
        raise InvalidValueError("protocols of other groups are for the biped's environments")
    return episodes


class Watched(Observer):
    """A watcher in an episode loop; `found` has its entries of rows by scenario id."""

    def __init__(self, watcher: KickWatcher | TourWatcher):
        self.found: dict[str, dict[str, Any]] = {}
        self._watcher = watcher

    def begin(self, robots: Any, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario; one that is no biped is refused."""
        core = _bipeds(robots.episodes).core
        self._watcher.begin(core, k, scenario)
        self._watcher.look(core, k)

    def after_step(self, robots: Any, rows: Ints) -> None:
        """The robots `rows` have acted."""
        for k in rows.tolist():
            self._watcher.look(robots.episodes.core, k)

    def end(self, robots: Any, k: int, outcome: Outcome) -> None:
        """The episode of robot k has ended."""
        self.found[outcome.scenario_id] = self._watcher.end(robots.episodes.core, k, outcome)


@dataclass(frozen=True)
class PushProtocol:
    """A protocol of another group: its name says who watches, its scenarios what happens."""

    name: str  # of WATCHERS
    form: str  # of its scenarios, or of what a watcher does
    robot: RobotModel  # that they were made for
    scenarios: tuple[Scenario, ...]

    def with_collisions(self) -> Self:
        """The same on robots that do not pass through themselves."""
        scenarios = (replace(one, errors=replace(one.errors, collisions=True)) for one in self.scenarios)
        return replace(self, scenarios=tuple(scenarios))

    def standing(self) -> Self:
        """The same of robots that stand on both feet where they are at rest (`Command.stand`)."""
        return replace(self, scenarios=tuple(replace(one, command=AT_REST) for one in self.scenarios))

    def unpushed(self) -> Self:
        """The same without any push."""
        return replace(self, scenarios=tuple(replace(one, pushes=()) for one in self.scenarios))

    @property
    def pushed(self) -> bool:
        """Whether any robot is pushed or kicked."""
        return any(scenario.pushes or scenario.kicks for scenario in self.scenarios)

    @property
    def watcher(self) -> str:
        """Key of WATCHERS."""
        of_form = f"{self.name} {self.form}"
        return of_form if of_form in WATCHERS else self.name

    @property
    def stands(self) -> bool:
        """Whether robots at rest stand; otherwise they step in place."""
        return any(scenario.command.stand for scenario in self.scenarios)

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
    sizes = chunk_sizes(env_id, sources, protocol.scenarios, Watched(WATCHERS[protocol.watcher]()))
    config = {"format": FORMAT, "protocol": protocol.summary(), "env": env_id, "code": code_digest()}
    config |= preset_digest(env_id)
    label = f"{protocol.name}-{protocol.form}-{env_label(env_id)}"
    store, digests = open_rows(label, config, sources, KEY, SCORED, directory, overwrite)
    with store:
        asked = protocol.scenarios
        missing = {name: [s for s in asked if (name, s.id) not in store.rows] for name in sources}
        jobs = [(protocol.watcher, *chunk) for chunk in make_chunks(missing, sizes, workers)]
        found = chain.from_iterable(parallel(env_id, run_watched, jobs, workers, sources))
        length = about(guessed_seconds(env_id, missing, sources, workers))
        ids = {scenario.id for scenario in asked}
        done = {name: sum(key[0] == name and key[1] in ids for key in store.rows) for name in digests}
        what = f"{protocol.name}: {len(ids)} episodes of {', '.join(digests)}"
        work = Work(what, length, store.directory)
        with progress_bars(list(digests), len(ids), work, done) as bars:
            keep_rows(store, found, digests, bars, done)
    rows = {name: [store.rows[name, s.id] for s in protocol.scenarios] for name in sources}
    return Results(protocol, env_id, rows, store.directory)


def run_watched(runner: Runner, job: Job) -> list[Row]:
    """The task of `parallel`: rows of one policy, its outcomes with the watcher's entries."""
    protocol, label, scenarios = job
    watched = Watched(WATCHERS[protocol]())
    outcomes = runner.run_all(label, scenarios, watched)
    return [{**outcome.to_dict(), **watched.found.pop(outcome.scenario_id)} for outcome in outcomes]
