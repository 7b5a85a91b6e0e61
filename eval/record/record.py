"""A recorded episode, and what records one: the ordinary rollout with somebody who looks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.policies.interface import Policy
from ...envs.biped.env import BipedEpisodes
from ...envs.episode.episodes import GaitEpisodes
from ...envs.episode.profile import get_profile
from ...envs.scenario.scenario import Scenario
from ..rollout.environments import size_of
from ..rollout.loop import Watch
from ..rollout.names import DEFAULT_ENV
from ..rollout.one import GymRobot, rollout
from ..rollout.outcome import Outcome
from ..rollout.policy_source import acting_in
from .sampler import Array, Row, Sampler


@dataclass(frozen=True, eq=False)
class EpisodeRecord:
    """Time histories of one episode; a sample after reset and after every environment step, n of them."""

    scenario: Scenario
    outcome: Outcome
    columns: Mapping[str, Array]  # (n,) each, read-only
    units: Mapping[str, str]  # of every column
    bounds: Mapping[str, float]  # how far some columns may go both ways, in their units
    sole: tuple[float, float]  # length, width [m]
    push_starts: tuple[float, ...]  # of the scenario's pushes [s], inf: its gait event has not come
    mass: float  # [kg]

    def __getitem__(self, name: str) -> Array:
        """One column.

        Raises:
            UnknownNameError: no such column; lists the valid ones.
        """
        if name not in self.columns:
            raise UnknownNameError("column", name, self.columns)
        return self.columns[name]

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.columns["time"])


class Recorder:
    """Watches a rollout, and keeps a row of every sample; another one may look with it."""

    def __init__(self, beside: Watch | None = None):
        self._rows: list[Row] = []
        self._beside = beside
        self._sampler: Sampler | None = None

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
        if self._sampler is None:
            self._sampler = Sampler(gait_episodes(robot.env))
        self._rows.append(self._sampler.row())
        if self._beside is not None:
            self._beside(robot)

    def record(self, env: gym.Env, scenario: Scenario, outcome: Outcome) -> EpisodeRecord:
        """What was seen of an episode that has ended."""
        episodes, sampler = gait_episodes(env), self._sampler
        assert sampler is not None  # noqa: S101  # a rollout looks at its start
        columns = {name: np.array([row[name] for row in self._rows]) for name in sampler.units}
        for column in columns.values():
            column.flags.writeable = False
        starts = episodes.core.pushes.start[0, : len(scenario.pushes)].tolist()
        return EpisodeRecord(
            scenario, outcome, columns, sampler.units, sampler.bounds, _sole(episodes), tuple(starts),
            episodes.robot.mass,
        )  # fmt: skip


def gait_episodes(env: gym.Env) -> GaitEpisodes:
    """The episodes of one of this project's environments.

    Raises:
        InvalidValueError: one of another kind, which does not tell its state.
    """
    episodes = getattr(env.unwrapped, "episodes", None)
    if not isinstance(episodes, GaitEpisodes):
        raise InvalidValueError(
            f"only episodes of this project's own environments are recorded, got {env.unwrapped}"
        )
    return episodes


def _sole(episodes: GaitEpisodes) -> tuple[float, float]:
    if isinstance(episodes, BipedEpisodes):
        length, width = episodes.core.body.half_sole
        return 2.0 * length, 2.0 * width
    return episodes.robot.foot_length, episodes.robot.foot_width


def record_episode(
    env: gym.Env, policy: Policy, scenario: Scenario, policy_name: str, watch: Watch | None = None
) -> EpisodeRecord:
    """`rollout` with its time histories; the outcome is the same bit for bit."""
    gait_episodes(env)
    recorder = Recorder(watch)
    outcome = rollout(env, policy, scenario, policy_name, recorder)
    return recorder.record(env, scenario, outcome)


def record(
    policy: Any = "two-stage",
    scenario: Scenario = Scenario("unpushed"),  # noqa: B008  # frozen
    env: gym.Env | str = DEFAULT_ENV,
    policy_name: str | None = None,
    *,
    profile: str = "exact",
) -> EpisodeRecord:
    """Run one scenario to its end, and keep its time histories.

    Args:
        policy: a name, a file, "MODULE:ATTRIBUTE", or an object with `predict(observation)`.
        scenario: what happens.
        env: one of this project's environments, or its id.
        policy_name: of the outcome; by default the name, or the object's class.
        profile: of the robot, "exact" or "hardware"; what the scenario says itself stands.

    Returns:
        Columns by name with their units, such as `record["dcm_y"]` [m], and the outcome that `rollout` gives.

    Raises:
        PushRecoveryError: unknown names, a policy that can't act, an environment of another project.
    """
    with acting_in(env, policy, policy_name) as (made, acting, label):
        scenario = get_profile(profile).scaled(size_of(made)).applied(scenario)
        return record_episode(made, acting, scenario, label)
