"""Pushes to tune on, from seeds of their own: of every kind, at the pelvis alone, or punches of the tour.

Of each there are two suites: one that a search meets, and one that is held out for what it has found. Their
run ids are none of the tour protocol's, so what is tuned on its punches has met none of the scored ones.
What a preset is worth on them is found side by side in processes that last as long as the search (`Scorer`).
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any, Self

import gymnasium as gym
import numpy as np

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.model.capturability import max_recoverable_force
from ...controllers.model.robot import SAME, RobotModel, Similarity
from ...controllers.policies.interface import Policy
from ...controllers.policies.two_stage import make_policy
from ...controllers.validation import require_choice
from ...envs.biped.env import BipedEpisodes
from ...envs.episode.episodes import GaitEpisodes
from ...envs.pendulum.env import PendulumEpisodes
from ...envs.robots.compiled_robot import CompiledRobot
from ...envs.scenario.distribution import PushDistribution
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors, PhysicsOptions
from ...envs.scenario.scenario import EXACT, FASTEST_TURN, HARDWARE, Command, Profile, Scenario
from ..output.processes import Pool, RayWorkers
from ..protocols.tour import FASTEST_X, FASTEST_Y, SLOWEST_X, tour_scenario
from ..rollout.environments import EnvName, env_ids, make_env, preset_digest
from ..rollout.episodes import rollout_batch
from ..rollout.outcome import Outcome
from ..rollout.workers import SLOTS, open_pool
from ..score.draw import BLOCK, stratified_scenario, stratified_uniforms
from ..score.kinds import DRAWS
from ..score.suites import OF_ROBOT, Suite, of_size

TAKEN = (12, 14, 16)  # punches of a run, all under the whole ceiling
FIRST, APART, SPREAD = 1.0, 2.5, 0.3  # when the first comes, how far apart they are, drawn later by up to [s]
LENGTH = 9.0  # of an excerpt [s]
IN_PLACE, STRAIGHT, KINDS = 0, 1, 4  # commands; the others are of everything at once


def excerpt(scenario_id: str, run_id: int, robot: CompiledRobot) -> Scenario:
    """Three of the hardest punches of a tour, on a robot that turns in place, walks straight on, or both."""
    rng, whole = np.random.default_rng(run_id), tour_scenario(run_id, robot)
    starts = [round(FIRST + APART * i + SPREAD * float(rng.random()), 4) for i in range(len(TAKEN))]
    pushes = [replace(whole.pushes[i], start=start) for i, start in zip(TAKEN, starts, strict=True)]
    velocity, kind = Similarity.of(robot.robot).velocity, int(rng.integers(KINDS))
    forward = 0.0 if kind == IN_PLACE else velocity * rng.uniform(SLOWEST_X, FASTEST_X)
    left = 0.0 if kind in {IN_PLACE, STRAIGHT} else velocity * rng.uniform(-FASTEST_Y, FASTEST_Y)
    turn = 0.0 if kind == STRAIGHT else rng.uniform(-FASTEST_TURN, FASTEST_TURN)
    return Scenario(
        scenario_id, tuple(pushes), Command(forward, left, turn), duration=LENGTH, noise_seed=run_id
    )


TUNING, VARIED, QUICK, PUNCHES = "tuning", "tuning-varied", "tuning-quick", "tuning-punches"
OF_EVERY_KIND = {VARIED: "varied", QUICK: "quick"}  # the suites that they are drawn like
VERSIONS = {TUNING: "1", VARIED: "2", QUICK: "1", PUNCHES: "1"}
SEEDS = {
    TUNING: 20260401, f"{TUNING}-held-out": 20260402,
    VARIED: 20261203, f"{VARIED}-held-out": 20261204,
    QUICK: 20261127, f"{QUICK}-held-out": 20261128,
}  # fmt: skip
FIRST_RUN = {PUNCHES: 3000, f"{PUNCHES}-held-out": 5000}  # of the tour, whose protocol has 0-63
BLOCKS = 4
SUITE_SIZE = BLOCKS * BLOCK  # scenarios of a suite
SHARE = (0.4, 2.0)  # of F*, whose step box is the paper's: on the biped about half is lost
FINE = Profile(  # what is tuned on one physics leans on it
    "fine", physics=PhysicsOptions(time_step=0.001, cone="elliptic", impratio=10.0, contact_time=0.004)
)
TURNS = EXACT, HARDWARE, FINE, HARDWARE  # profiles of the robots of OF_EVERY_KIND, in turn
RANGES = PushDistribution(first_step=2, settle_time=3.0)  # falls come within 2 s of the push


def held_out_of(name: str) -> str:
    """The suite that is held out beside the one of this name."""
    return f"{name}-held-out"


def _pelvis_pushes(name: str, scenarios: int) -> list[Scenario]:
    """Like `standard`, but about the limit in every direction.

    The share of F* is uniform, so the rate recovered is the mean share survived, over directions, phases and
    commands, of those from SHARE[0] to SHARE[1].
    """

    def force(share: float, psi: float, side: str) -> float:
        """Force [N] at a share in [0, 1] of SHARE, on a left or right stance."""
        # F* is that of a left stance in place; a right stance is its mirror image
        limit = max_recoverable_force(RobotModel(), psi if side == "left" else -psi, RANGES.push_duration)
        return (SHARE[0] + share * (SHARE[1] - SHARE[0])) * limit

    points = stratified_uniforms(BLOCKS, 5, SEEDS[name])[:scenarios]
    return [
        stratified_scenario(f"{name}-{i:04d}", RANGES, force, u, SEEDS[name] + 4096 * i)
        for i, u in enumerate(points)
    ]


def _pushes_like(like: str, name: str, scenarios: int) -> list[Scenario]:
    """Drawn like a suite, the robots of TURNS in turn."""
    drawn = DRAWS[like].stratified(name, BLOCKS, SEEDS[name])[:scenarios]
    own = [replace(s, noise_seed=SEEDS[name] + 4096 * i) for i, s in enumerate(drawn)]
    return [TURNS[i % len(TURNS)].applied(s) for i, s in enumerate(own)]


DRAWN: dict[str, Callable[[str, int], list[Scenario]]] = {
    TUNING: _pelvis_pushes,
    **{name: partial(_pushes_like, like) for name, like in OF_EVERY_KIND.items()},
}
TUNING_SUITES = (*DRAWN, PUNCHES)


@cache
def tuning_suite(
    name: str,
    scenarios: int,
    errors: ModelErrors = EXACT_MODEL,
    robot: tuple[str, Similarity] = ("biped", SAME),
) -> Suite:
    """The first scenarios of a suite of SEEDS; `errors` as in `_spoilt`, `robot` is its name and size."""
    require_choice("tuning suite", name, list(SEEDS))
    kind = name.removesuffix(held_out_of(""))
    suite = of_size(Suite(name, VERSIONS[kind], tuple(DRAWN[kind](name, scenarios))), *robot)
    return _spoilt(suite, errors)


def punched_suite(
    name: str, scenarios: int, robot: CompiledRobot, errors: ModelErrors = EXACT_MODEL
) -> Suite:
    """The first scenarios of a suite of FIRST_RUN, excerpts of the tour; `errors` as in `_spoilt`."""
    require_choice("tuning suite", name, list(FIRST_RUN))
    first = FIRST_RUN[name]
    drawn = tuple(excerpt(f"{name}-{i:04d}", first + i, robot) for i in range(scenarios))
    return _spoilt(Suite(f"{name}{OF_ROBOT}{robot.description.name}", VERSIONS[PUNCHES], drawn), errors)


def _spoilt(suite: Suite, errors: ModelErrors) -> Suite:
    """The suite with errors of every second robot, half of these with the mass error negated."""
    if errors == EXACT_MODEL:
        return suite
    both = errors, replace(errors, mass=-errors.mass)
    spoilt = [replace(s, errors=both[i // 2 % 2]) if i % 2 else s for i, s in enumerate(suite.scenarios)]
    return Suite(f"{suite.name}-half-{'-'.join(errors.names)}", suite.version, tuple(spoilt))


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
        return BipedEpisodes(n, preset=preset, robot=own.description, variant=policy)
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
