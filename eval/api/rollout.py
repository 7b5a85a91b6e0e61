"""One episode."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from ...envs.episode.profile import get_profile
from ...envs.scenario.scenario import Scenario
from ..rollout.environments import size_of
from ..rollout.names import DEFAULT_ENV
from ..rollout.one import rollout as run_episode
from ..rollout.outcome import Outcome
from ..rollout.policy_source import acting_in


def rollout(
    env: gym.Env | str = DEFAULT_ENV,
    policy: Any = "two-stage",
    scenario: Scenario = Scenario("unpushed"),  # noqa: B008  # frozen
    policy_name: str | None = None,
    *,
    profile: str = "exact",
) -> Outcome:
    """Run one scenario to its end: the row that an evaluation writes.

    Args:
        env: a gait environment, or its id.
        policy: a name, a file, "MODULE:ATTRIBUTE", or an object with `predict(observation)`.
        scenario: what happens.
        policy_name: of the outcome; by default the name, or the object's class.
        profile: of the robot, "exact" or "hardware"; what the scenario says itself stands.

    Raises:
        PushRecoveryError: unknown names, a policy that can't act.
    """
    with acting_in(env, policy, policy_name) as (made, acting, label):
        scenario = get_profile(profile).scaled(size_of(made)).applied(scenario)
        return run_episode(made, acting, scenario, label)
