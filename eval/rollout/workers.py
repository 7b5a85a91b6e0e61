"""Episodes on several processes; what comes out does not depend on how many, or on the order."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, TypeVar

import gymnasium as gym

from ...controllers.errors import InvalidValueError
from ...controllers.policies.interface import Policy
from ...envs.episode.episodes import GaitEpisodes
from ...envs.scenario.scenario import Scenario
from ..output.cluster import RayPool, RayWorkers
from ..output.processes import Pool, WorkerPool
from ..output.rows import versions
from .environments import code_digest, make_env, own_env, preset_digest
from .episodes import ActionRule, Slots, action_rule, batch_episodes, plans_batches, rollout, rollout_batch
from .outcome import Outcome
from .policy_source import Sources, policy_sources

S = TypeVar("S")
J = TypeVar("J")
R = TypeVar("R")
Job = tuple[str, Scenario]  # policy name or file, scenario
Chunk = tuple[str, tuple[Scenario, ...]]  # policy name or file, scenarios that may run side by side
CHUNKS_A_WORKER = 4  # at least, so that no worker is idle for long at the end
SLOTS = 16  # episodes side by side, and in a chunk at most: its rows are written when all of it is done


class Place:
    """One environment, with the same robots side by side, made on first use."""

    def __init__(self, env: gym.Env):
        self.env = env
        self.rule: ActionRule | None = action_rule(env)
        self._slots: GaitEpisodes | None = None

    def slots(self) -> GaitEpisodes | None:
        """SLOTS robots; None where the environment has a way of its own."""
        if self._slots is None and self.rule is not None:
            self._slots = batch_episodes(self.rule.env, SLOTS)
        return self._slots


class Runner:
    """Runs jobs in one environment, making it and its policies once.

    A policy that has a robot of its own in the environment's preset, or that acts on the joints of the same
    robot, acts in an environment of its own.

    Args:
        env_id: environment.
        sources: of the policies by label; a label without one is a name or file.
    """

    def __init__(self, env_id: str, sources: Sources = MappingProxyType({})):
        self.env = make_env(env_id)
        self._env_id, self._sources = env_id, sources
        self._policies: dict[str, Policy] = {}
        self._common = Place(self.env)
        self._own: dict[str, Place] = {}  # by label

    def policy(self, name: str) -> Policy:
        """The policy of this label, made on first use."""
        if name not in self._policies:
            source = self._sources.get(name) or policy_sources(name)[name]
            own = own_env(self.env, self._env_id, source.origin)
            if own is not None:
                self._own[name] = Place(own)
            self._policies[name] = source.load(self._place(name).env)
        return self._policies[name]

    def env_of(self, name: str) -> gym.Env:
        """The environment that the policy of a label acts in."""
        self.policy(name)
        return self._place(name).env

    def _place(self, name: str) -> Place:
        """Where the policy of a label acts, once it is made."""
        return self._own.get(name, self._common)

    def run(self, job: Job) -> Outcome:
        """One episode."""
        name, scenario = job
        policy = self.policy(name)
        return rollout(self._place(name).env, policy, scenario, name)

    def run_all(self, name: str, scenarios: Iterable[Scenario]) -> Iterator[Outcome]:
        """Episodes of one policy, side by side where that changes no outcome, as they finish.

        A scenario is taken when there is room for it: outcomes so far may decide what comes. One such run at
        a time.
        """
        slots = self._slots(name)
        if slots is None:
            return (self.run((name, scenario)) for scenario in scenarios)
        return rollout_batch(slots, self.policy(name), scenarios, name, self._place(name).rule)

    def robots(self, name: str) -> Slots | None:
        """Robots side by side that the policy of a label acts on; None where it acts on one at a time."""
        episodes = self._slots(name)
        return None if episodes is None else Slots(episodes, self._place(name).rule)

    def chunk(self, name: str) -> int:
        """How many scenarios are worth a job of this policy."""
        return 1 if self._slots(name) is None else SLOTS

    def _slots(self, name: str) -> GaitEpisodes | None:
        return self._place(name).slots() if plans_batches(self.policy(name)) else None

    def close(self) -> None:
        """Close the environments."""
        for place in (self._common, *self._own.values()):
            place.env.close()


def run_chunk(runner: Runner, chunk: Chunk) -> list[Outcome]:
    """The task of `parallel` for episodes."""
    return list(runner.run_all(*chunk))


def chunk_sizes(env_id: str, sources: Sources) -> dict[str, int]:
    """How many scenarios are worth a job of each policy.

    Every policy is made for it: names and files fail here, before any work, and caches are warm for workers.
    """
    runner = Runner(env_id, sources)
    sizes = {name: runner.chunk(name) for name in sources}
    runner.close()
    return sizes


def make_chunks(
    missing: Mapping[str, Sequence[Scenario]], sizes: Mapping[str, int], workers: int
) -> list[Chunk]:
    """Cut the scenarios of every policy into jobs of at most `sizes`, of which every worker gets several."""
    share = math.ceil(sum(map(len, missing.values())) / (CHUNKS_A_WORKER * max(workers, 1)))
    chunks: list[Chunk] = []
    for name, scenarios in missing.items():
        size = max(1, min(sizes[name], share))
        chunks += [(name, tuple(scenarios[i : i + size])) for i in range(0, len(scenarios), size)]
    return chunks


def named_files(env_id: str, sources: Sources) -> dict[str, str | None]:
    """SHA-256 of every file that the environment and the policies are named by."""
    policies = {f"policy {name}": source.digest() for name, source in sources.items() if not source.in_memory}
    return {**preset_digest(env_id), **policies}


def same_runner(files: Mapping[str, str | None], env_id: str, sources: Sources) -> Runner:
    """A worker's runner; `files` are the `named_files` of the process that asks for it.

    Raises:
        InvalidValueError: they are others here.
    """
    _require_same(files, named_files(env_id, sources), "the same files")
    return Runner(env_id, sources)


def same_installation(installed: Mapping[str, str], start: Callable[..., S], *arguments: Any) -> S:
    """A worker's state; `installed` is the `installation` of the process that asks for it.

    Raises:
        InvalidValueError: it is another one here.
    """
    _require_same(installed, installation(), "the same installation")
    return start(*arguments)


def installation() -> dict[str, str]:
    """What rows hang on besides the kind of processor: versions, and the source behind them."""
    return {**versions(), "code": code_digest()}


def _require_same(there: Mapping[str, Any], here: Mapping[str, Any], what: str) -> None:
    if differs := sorted(name for name in {*there, *here} if there.get(name) != here.get(name)):
        raise InvalidValueError(
            f"a worker on {platform.node()!r} would give other rows: {', '.join(differs)} differ there, and "
            f"all machines need {what}"
        )


def open_pool(workers: int, start: Callable[..., S], *arguments: Any) -> Pool[S]:
    """Worker processes here, or those of the Ray cluster that `workers` are of; `start` makes a state."""
    if isinstance(workers, RayWorkers):
        return RayPool(workers, same_installation, installation(), start, *arguments)
    return WorkerPool(workers, start, *arguments)


def parallel(
    env_id: str,
    task: Callable[[Runner, J], R],
    jobs: Sequence[J],
    workers: int,
    sources: Sources = MappingProxyType({}),
) -> Iterator[R]:
    """Results of the jobs as they finish; in this process for one worker, else in others.

    Args:
        env_id: environment that every worker makes.
        task: module-level function of a runner and a job.
        jobs: picklable.
        workers: number of processes, or those of a Ray cluster; one process, this one, where a policy is an
            object that cannot be handed to others.
        sources: of the policies by label.

    Raises:
        WorkerError: a job raised in a worker, or a worker ended.
    """
    cluster = isinstance(workers, RayWorkers)
    if not jobs:
        return
    if (not cluster and min(workers, len(jobs)) <= 1) or not all(one.pickles for one in sources.values()):
        runner = Runner(env_id, sources)
        try:
            for job in jobs:
                yield task(runner, job)
        finally:
            runner.close()
        return
    asked = same_runner, named_files(env_id, sources), env_id, dict(sources)
    with open_pool(workers if cluster else min(workers, len(jobs)), *asked) as pool:
        for _, result in pool.run(task, jobs):
            yield result
