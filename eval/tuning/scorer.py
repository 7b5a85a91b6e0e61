"""Worth of a preset on scenarios, run side by side in processes that last as long as the search."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, closing
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

import gymnasium as gym

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.policies.interface import Policy
from ...controllers.policies.two_stage import make_policy
from ...envs.biped.env import BipedEpisodes
from ...envs.episode.episodes import GaitEpisodes
from ...envs.pendulum.env import PendulumEpisodes
from ...envs.scenario.scenario import Scenario
from ..output.processes import Pool, RayWorkers
from ..rollout.environments import EnvName, env_ids, make_env, preset_digest
from ..rollout.episodes import rollout_batch
from ..rollout.outcome import Outcome
from ..rollout.workers import SLOTS, open_pool

BIPED, PENDULUM = "PushRecovery/Biped-v0", "PushRecovery/Pendulum-v0"
Job = tuple[str, str, str, bytes, Sequence[Scenario]]  # of `run_scenarios`
RECOVERED, STANDING, FALLEN = 1.0, 0.5, 0.0  # worth of an episode; standing without having settled


def worth(outcome: Outcome) -> float:
    """Worth of an episode, in [0, 1]."""
    if outcome.recovered:
        return RECOVERED
    return STANDING if outcome.survived else FALLEN


def check_env(env_id: str) -> str:
    """The id of an environment whose planner can be tuned, which may name no preset: a pendulum or a gait."""
    name = EnvName.parse(env_id)
    if name.preset:
        raise InvalidValueError(f"a study starts at a preset of its own: say --preset {name.preset}")
    own_episodes(env_id)  # which registers the id
    tuned = {gym.spec(own).entry_point for own in (BIPED, PENDULUM)}
    if gym.spec(name.full_id).entry_point not in tuned:
        valid = [own for own in env_ids() if gym.spec(own).entry_point in tuned]
        raise UnknownNameError("environment to tune", env_id, valid)
    return env_id.removeprefix("push_recovery:")


def own_episodes(env_id: str) -> GaitEpisodes:
    """Episodes of one robot of an environment, with its own preset."""
    return _own_episodes(env_id, *preset_digest(env_id).items())


@lru_cache(maxsize=16)
def _own_episodes(env_id: str, *content: tuple[str, str]) -> GaitEpisodes:
    """`own_episodes` of files with a content."""
    with closing(make_env(env_id)) as env:
        inner: Any = env.unwrapped
        return inner.episodes


def preset_episodes(env_id: str, n: int, preset: str, policy: str) -> GaitEpisodes:
    """Episodes of n robots of an environment with a preset, by name or file, that a policy walks."""
    own = own_episodes(env_id)
    if isinstance(own, BipedEpisodes):
        return BipedEpisodes(n, preset=preset, robot=own.description, arm=policy)
    return PendulumEpisodes(n, preset=preset)


@lru_cache(maxsize=1)
def _prepared(env_id: str, policy: str, preset: str, content: bytes) -> tuple[GaitEpisodes, Policy]:
    if Path(preset).read_bytes() != content:
        raise InvalidValueError(f"the preset {preset!r} is another one here: workers need the same files")
    episodes = preset_episodes(env_id, SLOTS, preset, policy)
    return episodes, make_policy(policy, episodes.robot, episodes.limits, preset)


def run_scenarios(state: None, job: Job) -> dict[str, float]:
    """Worth by scenario id: the task of a worker, which keeps what it has prepared by itself."""
    env_id, name, preset, content, scenarios = job
    episodes, policy = _prepared(env_id, name, preset, content)
    return {out.scenario_id: worth(out) for out in rollout_batch(episodes, policy, scenarios, name)}


def _nothing() -> None:
    """No state of a worker."""


class Scorer(AbstractContextManager):
    """Runs one variant of one environment under preset files, in this process where there is one worker."""

    def __init__(self, env_id: str, policy: str, workers: int = 1):
        self.env_id, self.policy, self.workers = check_env(env_id), policy, workers
        self._pool: Pool[None] | None = None

    def __enter__(self) -> Self:
        if self.workers > 1 or isinstance(self.workers, RayWorkers):
            self._pool = open_pool(self.workers, _nothing)
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.close()

    def values(self, preset: Path, scenarios: Sequence[Scenario]) -> list[float]:
        """Worth of the scenarios under the settings of a preset file, in their order."""
        job = (self.env_id, self.policy, str(preset), preset.read_bytes())
        found: dict[str, float] = {}
        if self._pool is None:
            found = run_scenarios(None, (*job, scenarios))
        else:
            stride = 2 * self.workers + 1  # odd: no part has one profile of the suite alone
            parts = [scenarios[k::stride] for k in range(stride)]
            for _, values in self._pool.run(run_scenarios, [(*job, part) for part in parts if part]):
                found |= values
        return [found[scenario.id] for scenario in scenarios]
