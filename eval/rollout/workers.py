"""Episodes and other jobs on several processes; results depend neither on how many nor on the order."""

import math
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from types import MappingProxyType
from typing import Any, TypeVar

import gymnasium as gym

from ...controllers.errors import InvalidValueError
from ...envs.episode.episodes import GaitEpisodes
from ...envs.scenario.scenario import Scenario, one_of_each
from ..output import processes, rows
from .environments import code_digest, make_env, own_env, preset_digest
from .episodes import (
    GymRobot,
    Observer,
    Slots,
    action_rule,
    batch_episodes,
    plans_batches,
    rollout,
    run_episodes,
)
from .outcome import Outcome
from .policy_source import PolicyEnv, Sources, policy_sources

S = TypeVar("S")
J = TypeVar("J")
R = TypeVar("R")
Job = tuple[str, Scenario]  # policy name or file, scenario
Chunk = tuple[str, tuple[Scenario, ...]]  # policy name or file, scenarios that may run side by side
CHUNKS_A_WORKER = 4  # at least, so that no worker is idle for long at the end
SLOTS = 16  # episodes side by side, and in a chunk at most: its rows are written when all of it is done


class Runner:
    """Runs jobs in one environment, making it and its policies once; a label without a source is its name.

    A policy that has a robot of its own in the environment's preset, or that acts on the joints of the same
    robot, acts in an environment of its own.
    """

    def __init__(self, env_id: str, sources: Sources = MappingProxyType({})):
        self.env = make_env(env_id)
        self._env_id, self._sources = env_id, sources
        self._acting: dict[str, PolicyEnv] = {}  # by label
        self._episodes: dict[gym.Env, GaitEpisodes | None] = {}  # of SLOTS robots as that of an environment

    def acting(self, name: str) -> PolicyEnv:
        """The policy of this label in its environment, made on first use."""
        if name not in self._acting:
            source = self._sources.get(name) or policy_sources(name)[name]
            own = own_env(self.env, self._env_id, source.origin)
            env = self.env if own is None else own
            self._acting[name] = PolicyEnv(env, source.load(env), name)
        return self._acting[name]

    def robots(self, name: str) -> Slots | None:
        """Robots side by side for the policy of a label; None where it acts on one at a time."""
        env, policy, _ = self.acting(name)
        rule = action_rule(env) if plans_batches(policy) else None
        if rule is None:
            return None
        if env not in self._episodes:
            self._episodes[env] = batch_episodes(rule.env, SLOTS)
        episodes = self._episodes[env]
        return None if episodes is None else Slots(episodes, rule)

    def run(self, job: Job) -> Outcome:
        """One episode."""
        return next(self.run_all(job[0], (job[1],), side_by_side=False))

    def run_all(
        self,
        name: str,
        scenarios: Iterable[Scenario],
        observer: Observer | None = None,
        side_by_side: bool = True,
    ) -> Iterator[Outcome]:
        """Episodes of one policy as they finish, on many robots where that changes no outcome.

        Scenarios are taken when there is room for one: outcomes so far may decide what comes.
        """
        env, policy, _ = self.acting(name)
        robots = self.robots(name) if side_by_side else None
        if robots is None:
            return (rollout(env, policy, scenario, name, observer) for scenario in scenarios)
        return (outcome for _, outcome in run_episodes(robots, policy, scenarios, name, observer))

    def check_can_begin(self, scenarios: Iterable[Scenario], observer: Observer | None = None) -> None:
        """Begin one scenario of each kind in every environment that a policy acts in.

        Args:
            scenarios: that are to be run.
            observer: that will look on, and may refuse a robot.

        Raises:
            PushRecoveryError: one that a robot can't have.
        """
        scenarios = list(one_of_each(scenarios))
        if observer is not None:  # its own refusal comes before that of a push
            scenarios[:0] = [replace(one, pushes=()) for one in scenarios[:1]]
        for env in dict.fromkeys(self.acting(name).env for name in self._sources):
            with GymRobot(env) as robot:
                for scenario in scenarios:
                    robot.begin(0, scenario)
                    if observer is not None:
                        observer.begin(robot, 0, scenario)

    def chunk(self, name: str) -> int:
        """How many scenarios are worth a job of this policy."""
        return 1 if self.robots(name) is None else SLOTS

    def close(self) -> None:
        """Close the environments."""
        for env in (self.env, *(acting.env for acting in self._acting.values())):
            env.close()


def run_chunk(runner: Runner, chunk: Chunk) -> list[Outcome]:
    """The task of `parallel` for episodes."""
    return list(runner.run_all(*chunk))


def chunk_sizes(
    env_id: str, sources: Sources, scenarios: Iterable[Scenario] = (), observer: Observer | None = None
) -> dict[str, int]:
    """How many scenarios are worth a job of each policy.

    What can't be made or begun fails here, before any work; see `Runner.check_can_begin`.
    """
    with closing(Runner(env_id, sources)) as runner:
        runner.check_can_begin(scenarios, observer)
        return {name: runner.chunk(name) for name in sources}


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


def installation() -> dict[str, str]:
    """Versions and the digest of the source, which rows hang on besides the kind of processor."""
    return {**rows.versions(), "code": code_digest()}


def same_runner(files: Mapping[str, str | None], env_id: str, sources: Sources) -> Runner:
    """A worker's runner; raises where `files` of the process that asks are not its `named_files`."""
    _require_same(files, named_files(env_id, sources), "the same files")
    return Runner(env_id, sources)


def same_installation(installed: Mapping[str, str], start: Callable[..., S], *arguments: Any) -> S:
    """A worker's state; raises where that of the process that asks is not its `installation`."""
    _require_same(installed, installation(), "the same installation")
    return start(*arguments)


def _require_same(there: Mapping[str, Any], here: Mapping[str, Any], what: str) -> None:
    """Raise InvalidValueError where a worker has other files or versions than the process that asks."""
    if differs := rows.differing(there, here):
        raise InvalidValueError(
            f"a worker on {platform.node()!r} would give other rows: {', '.join(differs)} differ there, and "
            f"all machines need {what}"
        )


def open_pool(workers: int, start: Callable[..., S], *arguments: Any) -> processes.Pool[S]:
    """Worker processes here, or those of the Ray cluster that `workers` are of; `start` makes a state."""
    if isinstance(workers, processes.RayWorkers):
        return processes.RayPool(same_installation, installation(), start, *arguments)
    return processes.WorkerPool(workers, start, *arguments)


def parallel(
    env_id: str,
    task: Callable[[Runner, J], R],
    jobs: Sequence[J],
    workers: int,
    sources: Sources = MappingProxyType({}),
) -> Iterator[R]:
    """Results of the jobs, which pickle, as they finish; the task is a function of a module.

    They run in this process for one worker and where a policy can't be handed to others, else in others.

    Raises:
        WorkerError: a job raised in a worker, or a worker ended.
    """
    cluster = isinstance(workers, processes.RayWorkers)
    if not jobs:
        return
    if (not cluster and min(workers, len(jobs)) <= 1) or not all(one.pickles for one in sources.values()):
        with closing(Runner(env_id, sources)) as runner:
            for job in jobs:
                yield task(runner, job)
        return
    files, count = named_files(env_id, sources), workers if cluster else min(workers, len(jobs))
    with open_pool(count, same_runner, files, env_id, dict(sources)) as pool:
        for _, result in pool.run(task, jobs):
            yield result
