"""Pushed episodes as Minari data sets, which learners from data read: one for each pair of suite and policy.

A transition is one action of the policy, of a planning period where nothing is held. With o the observation,
a the action as the environment takes it and r the environment's reward it is (o_t, a_t, r_t, o_t+1);
`terminations` is true at a fall, `truncations` at any other end. An episode's attributes say what it is of:
its scenario as JSON, from which `env.reset` begins the same episode again, and what became of it.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.errors import InvalidValueError, MissingExtraError, shown
from ...controllers.policies.interface import Policy, action_and_state
from ...envs.scenario.scenario import Scenario
from .. import ceiling
from ..hindsight import CEILING
from ..output.progress import Bars
from ..output.rows import require_place
from ..rollout import DEFAULT_ENV, environments
from ..rollout.episodes import Ints, Observer, Slots, batch_episodes, plans_batches, rollout, run_episodes
from ..rollout.outcome import Outcome
from ..rollout.policy_source import acting_in, policy_sources
from ..score.suites import Suite

NAMESPACE, VERSION = "push-recovery", 0
ROOT = "MINARI_DATASETS_PATH"  # the variable that names Minari's folder
SLOTS = 32  # robots side by side
KEPT = ("recovered", "survived", "end_time", "impulse", "pushes", "total_reward")  # of an outcome
Numbers = list[np.ndarray]


@dataclass
class Transitions:
    """What one episode has met so far."""

    scenario: Scenario
    observations: Numbers
    actions: Numbers
    rewards: list[float]


class Collector(Observer):
    """Stands between a policy and the episode loop, and keeps the transitions of every robot.

    It acts as the policy does; `done` holds the episodes that have ended, by the number of their robot.
    """

    def __init__(self, policy: Policy):
        self._policy = policy
        self._open: dict[int, Transitions] = {}
        self._asked: tuple[Any, Any] = (None, None)
        self.done: dict[int, Transitions] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._policy, name)  # `begin_scenario` and `reset`, where the policy has them

    def predict(self, observation: Any, *words: Any, **named: Any) -> tuple[Any, Any]:
        """The policy's action and state."""
        seen = np.array(observation)
        action, state = action_and_state(self._policy.predict(observation, *words, **named))
        self._asked = seen, np.array(action)
        return action, state

    def begin(self, robots: Any, k: int, scenario: Scenario) -> None:
        """Begin the transitions of robot k."""
        self._open[k] = Transitions(scenario, [], [], [])

    def after_step(self, robots: Any, rows: Ints) -> None:
        """Keep what the robots `rows` saw, did and got."""
        seen, acted = (np.reshape(part, (len(rows), -1)) for part in self._asked)
        for i, k in enumerate(rows.tolist()):
            one = self._open[k]
            one.observations.append(seen[i])
            one.actions.append(acted[i])
            one.rewards.append(float(robots.reward[k]))

    def end(self, robots: Any, k: int, outcome: Outcome) -> None:
        """Keep where robot k has ended, too."""
        one = self.done[k] = self._open.pop(k)
        one.observations.append(np.reshape(robots.observe(np.array([k])), -1).copy())


def collect(
    env: gym.Env, policy: Policy, scenarios: tuple[Scenario, ...], label: str, threads: int = 1
) -> Iterator[tuple[Transitions, Outcome]]:
    """Transitions and outcomes in the order of the scenarios.

    Args:
        env: the environment.
        policy: acts.
        scenarios: what happens.
        label: of the outcomes.
        threads: that share the robots; they change nothing.
    """
    collector = Collector(policy)
    slots = min(SLOTS, len(scenarios))
    episodes = batch_episodes(env, slots, threads) if plans_batches(policy) else None
    if episodes is None:
        for scenario in scenarios:
            outcome = rollout(env, collector, scenario, label, collector)
            yield collector.done.pop(0), outcome
        return
    waiting: dict[int, tuple[Transitions, Outcome]] = {}
    due = 0
    for number, outcome in run_episodes(Slots(episodes), collector, scenarios, label, collector):
        ((_, one),) = collector.done.items()
        collector.done.clear()
        waiting[number] = one, outcome
        while due in waiting:
            yield waiting.pop(due)
            due += 1


@dataclass(frozen=True)
class DataSet:
    """A data set that is there."""

    id: str  # for `minari.load_dataset`
    path: Path
    episodes: int
    transitions: int
    recovered: int  # episodes


def dataset_id(suite: str, env: gym.Env, policy: str) -> str:
    """Name for Minari, push-recovery/ROBOT/SUITE-POLICY-v0, in the letters that Minari takes."""
    robot = "" if env.spec is None else re.sub(r"^.*/|-v\d+$", "", env.spec.id).lower()
    said = re.sub(r"[^\w-]+", "-", f"{suite}-{Path(policy).stem if os.sep in policy else policy}")
    return f"{NAMESPACE}/{robot or 'robot'}/{said.strip('-')}-v{VERSION}"


def write_datasets(
    suite: Suite, env_id: str, policies: Any, root: Path | None, threads: int, bars: Bars
) -> list[DataSet]:
    """Run the suite under each policy and write its data set, whole or not at all.

    One that is there already is kept if it is of this suite, and of this content of its policy.

    Args:
        suite: the pushes. Of the policy `ceiling` those that a search has found an answer to.
        env_id: the environment.
        policies: as `evaluate` takes them; also `ceiling`, which replays the stored answers of a suite.
        root: Minari's folder of data sets; None: its own.
        threads: that share the robots.
        bars: of the policies.

    Raises:
        MissingExtraError: Minari is not installed.
        PushRecoveryError: before any policy is run: unknown names, a policy that can't act, no stored answers
            to the suite, a place that can't be written to, or another data set or a damaged one of the name.
    """
    try:
        import minari  # noqa: F401
    except ImportError:
        raise MissingExtraError("minari", "data") from None
    found, folder = dict[str, DataSet](), _root(root)
    asked: dict[str, tuple[gym.Env, Policy, tuple[Scenario, ...], dict[str, str]]] = {}
    with ExitStack() as stack:
        for label, source in policy_sources(policies).items():
            scenarios, policy = suite.scenarios, source.origin
            if policy == CEILING:
                scenarios, policy = _answered(suite, env_id)
            env, acting, _ = stack.enter_context(acting_in(env_id, policy, label))
            made_of = {
                "suite": suite.name, "suite_sha256": suite.sha256, "policy": label, "env_id": env_id,
                "policy_sha256": source.digest() or "", "code_sha256": environments.code_digest(),
                **environments.preset_digest(env_id),
            }  # fmt: skip
            name = dataset_id(suite.name, env, label)
            if name in asked:
                raise InvalidValueError(
                    f"policies {asked[name][3]['policy']!r} and {label!r} would have one data set, {name!r}: "
                    "write them apart, or rename a file"
                )
            asked[name] = env, acting, scenarios, made_of
            place = folder / name
            if place.exists():
                found[name] = _read(folder, name, made_of)
            else:  # its folders are made once there is a data set
                require_place(next(one for one in place.parents if one.exists()) / place.name)
        for name, (env, acting, scenarios, made_of) in asked.items():
            if name not in found:
                _write(env, acting, scenarios, made_of, folder, name, threads, bars)
                found[name] = _read(folder, name, made_of)
            bars.set(made_of["policy"], len(scenarios))
    return [found[name] for name in asked]


def _answered(suite: Suite, env_id: str) -> tuple[tuple[Scenario, ...], Policy]:
    """The pushes of a suite that have a stored answer, and the policy that replays it."""
    found = ceiling.answered(suite, env_id)
    if found is None:
        raise InvalidValueError(
            f"no answers of a search are stored for suite {suite.name!r} on {env_id}, and ceiling replays "
            f"them; choose suite hard on {DEFAULT_ENV}"
        )
    return found[0].scenarios, found[1]


def _root(root: Path | None) -> Path:
    """Minari's folder of data sets."""
    named = root or os.environ.get(ROOT) or Path.home() / ".minari" / "datasets"
    return Path(named).absolute()


@contextmanager
def _minari_in(folder: Path) -> Iterator[None]:
    """Let Minari's folder be another one."""
    before = os.environ.get(ROOT)
    os.environ[ROOT] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ[ROOT]
        else:
            os.environ[ROOT] = before


def _read(root: Path, name: str, made_of: dict[str, str]) -> DataSet:
    """The data set of a name; raises InvalidValueError where it is damaged or made of something else."""
    import minari

    place, advice = root / name, "delete it, or choose another --out"
    try:
        with _minari_in(root):
            there: Any = minari.load_dataset(name)
        known = there.storage.metadata
        if other := [key for key, value in made_of.items() if known.get(key) != value]:
            raise InvalidValueError(f"{str(place)!r} is a data set of another {other[0]}: {advice}")
        told = there.storage.get_episode_metadata(there.episode_indices)
        recovered = sum(bool(one["recovered"]) for one in told)
        return DataSet(name, place, there.total_episodes, there.total_steps, recovered)
    except InvalidValueError:
        raise
    except Exception as error:  # of Minari, HDF5 or JSON, which don't tell the kind beforehand
        raise InvalidValueError(f"{str(place)!r} is no whole data set ({shown(error)}): {advice}") from error


def _write(
    env: gym.Env, policy: Policy, scenarios: tuple[Scenario, ...], made_of: dict[str, str], root: Path,
    name: str, threads: int, bars: Bars,
) -> None:  # fmt: skip
    """Write a data set beside its place, and move it there once it is whole."""
    import minari
    from minari import data_collector

    label, kept = made_of["policy"], list[dict[str, Any]]()
    create: Any = minari.create_dataset_from_buffers  # which takes them one by one, too
    buffer: Any = data_collector.EpisodeBuffer

    def episodes() -> Iterator[Any]:
        for one, outcome in collect(env, policy, scenarios, label, threads):
            ends = [False] * (len(one.rewards) - 1)
            yield buffer(
                id=len(kept), seed=one.scenario.noise_seed, options={"scenario": one.scenario.to_json()},
                observations=np.array(one.observations), actions=np.array(one.actions), rewards=one.rewards,
                terminations=[*ends, not outcome.survived], truncations=[*ends, outcome.survived],
            )  # fmt: skip
            kept.append({key: getattr(outcome, key) for key in KEPT})
            bars.set(label, len(kept))

    root.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory(dir=root, prefix=".unfinished-") as folder,
        _minari_in(Path(folder)),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore", UserWarning)  # of Minari: there is no author to name
        written = create(
            name, episodes(), env=env.spec, algorithm_name=label, action_space=env.action_space,
            observation_space=env.observation_space, data_format="hdf5", requirements=["push-recovery"],
            description=f"{label} on the pushes of {made_of['suite']}; see docs/your_own.md#data-sets",
        )  # fmt: skip
        written.storage.update_episode_metadata(kept)
        written.storage.update_metadata(made_of)
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        for entry in (Path(folder) / NAMESPACE).iterdir():
            if entry.is_file():  # what Minari says of the name space
                shutil.copy(entry, root / NAMESPACE / entry.name)
        os.replace(Path(folder) / name, root / name)
