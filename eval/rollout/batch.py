"""Many episodes side by side on one core: the outcomes of `rollout`, bit for bit, sooner."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.policies.interface import Policy
from ...controllers.policies.network import NetworkPolicy
from ...controllers.policies.two_stage import RandomPolicy, TwoStagePolicy
from ...envs.biped.env import BipedEnv, BipedEpisodes
from ...envs.biped.limit_record import LimitReport
from ...envs.episode.env import check_action
from ...envs.episode.episodes import GaitEpisodes
from ...envs.pendulum.env import PendulumEnv, PendulumEpisodes
from ...envs.scenario.scenario import Scenario
from .one import MAX_STEPS, limits_met, outcome_of, rollout
from .outcome import Outcome
from .wrapped_action import ActionRule, Actions, action_rule

Ints = NDArray[np.int64]


def batch_episodes(env: gym.Env, n: int, threads: int = 1) -> GaitEpisodes | None:
    """Episodes of n robots as the environment has one; None where it is not this project's or is wrapped.

    Bipeds share `threads`; pendulums cost too little to share.
    """
    while type(env) is OrderEnforcing:
        env = env.env
    if type(env) is BipedEnv:
        one = env.episodes
        return BipedEpisodes(n, one.preset, one.control_hz, threads)
    if type(env) is PendulumEnv:
        one = env.episodes
        return PendulumEpisodes(n, one.robot, one.limits, one.preset, one.control_hz)
    return None


def plans_batches(policy: Policy) -> bool:
    """Whether an action of the policy is known not to depend on what else is in the batch."""
    return type(policy) in {TwoStagePolicy, RandomPolicy, NetworkPolicy}


def rollout_batch(
    episodes: GaitEpisodes,
    policy: Policy,
    scenarios: Iterable[Scenario],
    policy_name: str,
    rule: ActionRule | None = None,
) -> Iterator[Outcome]:
    """Run scenarios to their ends, one in each slot of the core; yields outcomes as they finish.

    An outcome is that of `rollout` in every field, whatever runs beside it.

    Args:
        episodes: the slots; what they held before is lost.
        policy: one that `plans_batches`.
        scenarios: taken one at a time, when a slot is free: what has been yielded may decide what comes.
        policy_name: for the outcomes.
        rule: what an action means, see `action_rule`; a gait action for one period without it.

    Raises:
        InvalidValueError: actions of another shape or not finite, or an episode that never ends.
    """
    queue, slots = iter(scenarios), _Slots(episodes, rule)
    for k in range(episodes.n):
        slots.fill(k, next(queue, None))
    state: Any = None
    while len(rows := slots.live):
        action, state = policy.predict(
            episodes.core.observation[rows],
            state=state,
            episode_start=slots.steps[rows] == 0,
            deterministic=True,
        )
        for k in slots.step(rows, action):
            yield slots.outcome(k, policy_name)
            slots.fill(k, next(queue, None))
        if state is not None:
            kept = np.isin(rows, slots.live)
            state = tuple(part[kept] for part in state)


def rollout_all(
    env: gym.Env, policy: Policy, scenarios: Sequence[Scenario], policy_name: str, slots: int
) -> list[Outcome]:
    """Outcomes in the order of the scenarios; up to `slots` side by side where that changes none of them."""
    rule = action_rule(env) if plans_batches(policy) else None
    episodes = None if rule is None else batch_episodes(rule.env, min(slots, max(len(scenarios), 1)))
    if episodes is None:
        return [rollout(env, policy, scenario, policy_name) for scenario in scenarios]
    found = {out.scenario_id: out for out in rollout_batch(episodes, policy, scenarios, policy_name, rule)}
    return [found[scenario.id] for scenario in scenarios]


class _Slots:
    """What is counted of the episode in each slot."""

    def __init__(self, episodes: GaitEpisodes, rule: ActionRule | None):
        self._episodes, self._rule = episodes, rule
        self._hold = 1 if rule is None else rule.hold
        self._scenarios: list[Scenario | None] = [None] * episodes.n
        self._actions = np.zeros((episodes.n, GAIT_SIZE), np.float32)
        self._begun = np.zeros(episodes.n, np.bool_)
        self._total = np.zeros(episodes.n)  # reward
        self._ends: dict[int, tuple[bool, float, dict[str, Any], LimitReport]] = {}  # by slot; time in [s]
        self._live: Ints | None = None  # found when asked for
        self.steps = np.zeros(episodes.n, np.int64)

    @property
    def live(self) -> Ints:
        """Slots in which an episode runs."""
        if self._live is None:
            self._live = np.flatnonzero([scenario is not None for scenario in self._scenarios])
        return self._live

    def fill(self, k: int, scenario: Scenario | None) -> None:
        """Begin a scenario in slot k, or leave the slot empty."""
        self._scenarios[k], self._live = scenario, None
        self._total[k], self.steps[k] = 0.0, 0
        if scenario is not None:
            self._episodes.begin(k, scenario)
            self._begun[k] = True
            return
        if not self._begun[k]:
            self._episodes.begin(k, Scenario("empty"))
            self._begun[k] = True
        self._episodes.failure()[k] = 1  # a robot that has fallen rests: an empty slot costs no physics

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """One action of the episodes in `rows`, for as long as it is held; returns the slots that ended."""
        if self.steps[rows].max() >= MAX_STEPS:
            k = int(rows[self.steps[rows].argmax()])
            raise InvalidValueError(f"scenario {self._at(k).id!r} did not end within {MAX_STEPS} steps")
        held = check_action(actions, "actions", (len(rows), GAIT_SIZE))
        reward, left = np.zeros(self._episodes.n), rows
        for _ in range(self._hold):
            self._actions[left] = self._gait_actions(left, held)
            period = self._episodes.step(self._actions)
            reward[left] += period.reward.total[left]
            over = (period.failed | period.truncated)[left]
            if over.any():
                for k in left[over].tolist():
                    self._end(k, bool(period.failed[k]))
                left, held = left[~over], held[~over]
            if not len(left):
                break
        self._total[rows] += reward[rows]
        self.steps[rows] += 1
        return sorted(self._ends)

    def outcome(self, k: int, policy_name: str) -> Outcome:
        """Of the episode that has ended in slot k."""
        fell, time, info, limits = self._ends.pop(k)
        return outcome_of(
            self._at(k), policy_name, fell, info, time, int(self.steps[k]), float(self._total[k]), limits
        )

    def _gait_actions(self, rows: Ints, actions: Actions) -> Actions:
        if self._rule is None:
            return actions
        return self._rule.gait_actions(self._episodes.core.observation[rows], actions)

    def _end(self, k: int, fell: bool) -> None:
        """Keep what becomes of slot k; within a held action the robot goes on."""
        episodes = self._episodes
        info = {
            "failure_reason": episodes.failures[episodes.failure()[k]],
            "recovered_at": episodes.monitor.recovered_at(k),
        }
        self._ends[k] = fell, float(episodes.motion().time[k]), info, limits_met(episodes, k)

    def _at(self, k: int) -> Scenario:
        scenario = self._scenarios[k]
        assert scenario is not None  # noqa: S101
        return scenario
