"""The corrections of a residual in pushed episodes, beside what becomes of the same pushes without them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.learned.network import NetworkPolicy
from ...controllers.model.frame import side_sign
from ...controllers.model.gait_box import GAIT_SIZE, GaitLimits
from ...envs.scenario.scenario import Scenario
from ..record.record import EpisodeRecord, record_episode
from ..rollout.one import rollout

Array = NDArray[np.float64]
STEPS = 3  # that are looked at: the one that is pushed in, and those after it


@dataclass(frozen=True, eq=False)
class PushCorrections:
    """One pushed episode under a residual."""

    scenario_id: str
    psi: float  # direction of the push in the canonical frame of its begin, 90 outward [deg]
    impulse: float  # horizontal [N s]
    below_recovered: bool  # without the residual
    recovered: bool
    corrections: Array  # (STEPS, 7) mean over each step from the push on, gait variables; NaN: no such step


class Watched:
    """A residual policy that remembers what it was asked and what it did.

    Raises:
        InvalidValueError: the policy is no residual on gait actions.
    """

    def __init__(self, policy: Any):
        rule = policy.rule if isinstance(policy, NetworkPolicy) else None
        if rule is None:
            raise InvalidValueError("only a residual on gait actions has corrections to look at")
        self._policy, self.rule, self.limits = policy, rule, policy.description.limits
        self.observations: list[Array] = []
        self.actions: list[NDArray[np.float32]] = []

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """What the policy does."""
        action, state = self._policy.predict(observation, state, episode_start, deterministic)
        self.observations.append(np.asarray(observation, np.float64))
        self.actions.append(action)
        return action, state


def collect(env: gym.Env, policy: Any, scenarios: Sequence[Scenario]) -> Iterator[PushCorrections]:
    """Run every scenario with the residual and without it.

    Args:
        env: in which both act.
        policy: a residual on gait actions.
        scenarios: with one push or more, of which the first counts.
    """
    for scenario in scenarios:
        watched = Watched(policy)
        episode = record_episode(env, watched, scenario, "residual")
        below = rollout(env, watched.rule.policy, scenario, "below")
        yield corrections_of(episode, watched, below.recovered)


def corrections_of(episode: EpisodeRecord, watched: Watched, below_recovered: bool) -> PushCorrections:
    """What the residual did from the first push on.

    Args:
        episode: with a sample before each action, and one after the last.
        watched: the policy that acted.
        below_recovered: whether the policy below recovers.
    """
    n = len(watched.actions)
    below = watched.rule.below(np.array(watched.observations)).base
    added = gait_corrections(watched.limits, below, np.array(watched.actions))
    time, step = episode["time"][:n], episode["step"][:n]
    pushed = int(np.searchsorted(time, episode.push_starts[0], side="right")) - 1
    means = np.full((STEPS, GAIT_SIZE), np.nan)
    for k in range(STEPS):
        of_step = (np.arange(n) >= pushed) & (step == step[pushed] + k)
        if of_step.any():
            means[k] = added[of_step].mean(axis=0)
    push = episode.scenario.pushes[0]
    turned = push.direction - (0.0 if push.frame == "heading" else episode["heading"][pushed])
    outward = side_sign(int(episode["stance_side"][pushed])) * turned
    return PushCorrections(
        episode.scenario.id,
        math.degrees(math.remainder(outward, math.tau)),
        math.hypot(*push.force[:2]) * push.duration,
        below_recovered,
        episode.outcome.recovered,
        means,
    )


def gait_corrections(limits: GaitLimits, below: ArrayLike, actions: ArrayLike) -> Array:
    """Gait variables of actions (n, 7) less those of the actions (n, 7) below."""
    return limits.from_action(actions) - limits.from_action(below)
