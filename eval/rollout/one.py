"""One episode: environment, policy, scenario -> outcome; nothing else enters."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from ...controllers.policies.interface import Policy, as_policy
from ...envs.biped.bounds_record import BoundsReport
from ...envs.episode.episodes import GaitEpisodes
from ...envs.scenario.scenario import Scenario
from ..measures.effort import StepMeter
from .loop import Ints, Watch, run_episodes
from .outcome import NO_BOUNDS, Ending, Outcome


def planning_period(env: gym.Env) -> float:
    """Simulated time of one environment step [s]: the environment's `dt`, otherwise 10 ms."""
    return float(getattr(env.unwrapped, "dt", 0.01))


def rollout(
    env: gym.Env, policy: Policy, scenario: Scenario, policy_name: str, watch: Watch | None = None
) -> Outcome:
    """Run one scenario to its end.

    The policy's state starts anew, and all randomness is the scenario's: the same scenario and policy give
    the same outcome bit for bit, whatever ran before.

    Args:
        env: any environment of this project, wrapped or not, or one with its options and info.
        policy: acts; it is handed what its `predict` takes, and the scenario where it has a method
            `begin_scenario`, as what replays stored answers has, and what refuses some scenarios.
        scenario: what happens.
        policy_name: for the outcome.
        watch: called with the `GymRobot` after reset and after every step, to look, not to touch.
    """
    policy = as_policy(policy)
    robot = GymRobot(env, watch)
    begin_policy(policy, scenario)
    _, outcome = next(run_episodes(robot, policy, (scenario,), policy_name))
    return outcome


def begin_policy(policy: Policy, scenario: Scenario) -> None:
    """Let a policy that acts alone begin a scenario, where it has something to begin."""
    if hasattr(policy, "reset"):
        policy.reset(seed=scenario.noise_seed)  # type: ignore[attr-defined]
    if hasattr(policy, "begin_scenario"):  # replays by scenario, or does not act in every one
        policy.begin_scenario(scenario)  # type: ignore[attr-defined]


class GymRobot:
    """The one robot of a Gymnasium environment, whose info says how its episode ends."""

    n = 1

    def __init__(self, env: gym.Env, watch: Watch | None = None):
        self.env, self._watch = env, watch
        self.info: dict[str, Any] = {}  # of the last step or reset
        self.ended = False
        self._observation: Any = None
        episodes = getattr(env.unwrapped, "episodes", None)
        self._meter = StepMeter(episodes) if isinstance(episodes, GaitEpisodes) else None
        self._steps, self._total, self._fell = 0, 0.0, False

    def begin(self, k: int, scenario: Scenario) -> None:
        """Reset to a scenario."""
        self._observation, self.info = self.env.reset(
            seed=scenario.noise_seed, options={"scenario": scenario}
        )
        self._steps, self._total, self._fell, self.ended = 0, 0.0, False, False
        if self._meter is not None:
            self._meter.begin(k)
        self._look()

    def rest(self, k: int) -> None:
        """Nothing is left to do."""

    def observe(self, rows: Ints) -> Any:
        """The observation as the environment gives it, not as a batch."""
        return self._observation

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """One environment step."""
        self._observation, reward, terminated, truncated, self.info = self.env.step(actions)
        self._total += float(reward)
        self._steps += 1
        self._fell, self.ended = bool(terminated), bool(terminated or truncated)
        self._look()
        return [0] if self.ended else []

    def ending(self, k: int) -> Ending:
        """What the info of the last step says."""
        info = self.info
        return Ending(
            fell=self._fell,
            time=float(info.get("time", self._steps * planning_period(self.env))),
            recovered_at=info.get("recovered_at"),
            failure_reason=info.get("failure_reason"),
            total_reward=self._total,
            bounds=bounds_met(getattr(self.env.unwrapped, "episodes", None), k),
            measures={} if self._meter is None else self._meter.of(k),
        )

    def _look(self) -> None:
        if self._watch is not None:
            self._watch(self)


def bounds_met(episodes: Any, k: int) -> BoundsReport:
    """The bounds that robot k of the episodes has met; none where its core keeps no record."""
    met = getattr(getattr(episodes, "core", None), "bounds_met", None)
    return NO_BOUNDS if met is None else met(k)
