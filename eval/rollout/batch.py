"""Many episodes side by side on one core: the outcomes of `rollout`, bit for bit, sooner."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing
from numpy.typing import NDArray

from ...controllers.learned.network import NetworkPolicy
from ...controllers.policies.interface import Policy
from ...controllers.policies.random import RandomPolicy
from ...controllers.policies.two_stage import TwoStagePolicy
from ...envs.episode.env import GaitEnv
from ...envs.episode.episodes import GaitEpisodes
from ...envs.scenario.scenario import Scenario
from .loop import run_episodes
from .one import rollout
from .outcome import Outcome
from .slots import Slots
from .wrapped_action import ActionRule, action_rule

Ints = NDArray[np.int64]


def batch_episodes(env: gym.Env, n: int, threads: int = 1) -> GaitEpisodes | None:
    """Episodes of n robots as the environment has one; None where it is wrapped or acts in a way of its own.

    Bipeds share `threads`; pendulums cost too little to share.
    """
    while type(env) is OrderEnforcing:
        env = env.env
    own = isinstance(env, GaitEnv) and all(
        getattr(type(env), name) is getattr(GaitEnv, name) for name in ("reset", "step")
    )
    return env.episodes.alike(n, threads) if own else None  # type: ignore[attr-defined]


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
    slots = Slots(episodes, rule)
    return (outcome for _, outcome in run_episodes(slots, policy, scenarios, policy_name))


def rollout_all(
    env: gym.Env, policy: Policy, scenarios: Sequence[Scenario], policy_name: str, slots: int
) -> list[Outcome]:
    """Outcomes in the order of the scenarios; up to `slots` side by side where that changes none of them."""
    rule = action_rule(env) if plans_batches(policy) else None
    episodes = None if rule is None else batch_episodes(rule.env, min(slots, max(len(scenarios), 1)))
    if episodes is None:
        return [rollout(env, policy, scenario, policy_name) for scenario in scenarios]
    found = dict(run_episodes(Slots(episodes, rule), policy, scenarios, policy_name))
    return [found[number] for number in range(len(scenarios))]
