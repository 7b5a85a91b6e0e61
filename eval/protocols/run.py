"""Run policies under a protocol: rows that survive a kill, on any number of processes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ...controllers.model.robot import RobotModel
from ...envs.scenario.scenario import Scenario
from ..output.progress import Work, about, progress_bars
from ..output.rows import RowFile
from ..rollout.environments import code_digest, env_label, preset_digest
from ..rollout.policy_source import guessed_seconds, open_rows, policy_sources
from ..rollout.workers import Runner, chunk_sizes, make_chunks, parallel
from .kick import KickWatcher
from .tour import TourWatcher
from .watched import Watched, Watcher

FORMAT = 2  # of the rows
KEY = ("policy", "scenario_id")  # of a row
SCORED = ("recovered", "survived", "failure_reason", "end_time")
WATCHERS: Mapping[str, Callable[[], Watcher]] = MappingProxyType({"kick": KickWatcher, "tour": TourWatcher})

Row = dict[str, Any]
Job = tuple[str, str, tuple[Scenario, ...]]  # protocol, label of a policy, scenarios


@dataclass(frozen=True)
class Protocol:
    """What is run: the name says who watches, the scenarios what happens."""

    name: str  # of WATCHERS
    form: str  # of its scenarios
    robot: RobotModel  # that they were made for
    scenarios: tuple[Scenario, ...]

    def with_collisions(self) -> Protocol:
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

    protocol: Protocol
    env_id: str
    rows: dict[str, list[Row]]  # policy -> rows in the scenarios' order
    directory: Path


def run_protocol(
    protocol: Protocol,
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
        _keep(protocol, store, digests, found, about(seconds))
    rows = {name: [store.rows[name, s.id] for s in protocol.scenarios] for name in sources}
    return Results(protocol, env_id, rows, store.directory)


def _keep(
    protocol: Protocol,
    store: RowFile,
    digests: Mapping[str, str | None],
    found: Iterator[Row],
    how_long: str,
) -> None:
    """Append the rows as they finish, with a bar for each policy."""
    ids = {scenario.id for scenario in protocol.scenarios}
    done = {name: sum(key[0] == name and key[1] in ids for key in store.rows) for name in digests}
    work = Work(f"{protocol.name}: {len(ids)} episodes of {', '.join(digests)}", how_long, store.directory)
    with progress_bars(list(digests), len(ids), work, done) as bars:
        for row in found:
            store.append({**row, "policy_sha256": digests[row["policy"]]})
            done[row["policy"]] += 1
            bars.set(row["policy"], done[row["policy"]])


def run_watched(runner: Runner, job: Job) -> list[Row]:
    """The task of `parallel`: rows of one policy, its outcomes with the watcher's entries."""
    protocol, label, scenarios = job
    watched = Watched(WATCHERS[protocol]())
    outcomes = runner.run_all(label, scenarios, watched)
    return [{**outcome.to_dict(), **watched.found.pop(outcome.scenario_id)} for outcome in outcomes]
