"""One episode: environment, policy, scenario -> outcome; nothing else enters."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.policies.interface import Policy
from ...envs.biped.limit_record import LimitReport
from ...envs.scenario.scenario import Scenario
from .outcome import Outcome

NO_LIMITS = LimitReport({}, {})
MAX_STEPS = 1_000_000  # of an episode; only an environment that never ends gets there


def planning_period(env: gym.Env) -> float:
    """Simulated time of one environment step [s]: the environment's `dt`, otherwise 10 ms."""
    return float(getattr(env.unwrapped, "dt", 0.01))


def rollout(env: gym.Env, policy: Policy, scenario: Scenario, policy_name: str) -> Outcome:
    """Run one scenario to its end.

    The policy's state starts anew, and all randomness is the scenario's: the same scenario and policy give
    the same outcome bit for bit, whatever ran before.
    """
    observation, info = env.reset(seed=scenario.noise_seed, options={"scenario": scenario})
    if hasattr(policy, "reset"):
        policy.reset(seed=scenario.noise_seed)  # type: ignore[attr-defined]
    state: Any = None
    total, steps = 0.0, 0
    terminated = truncated = False
    while not (terminated or truncated):
        if steps >= MAX_STEPS:
            raise InvalidValueError(f"scenario {scenario.id!r} did not end within {MAX_STEPS} steps")
        action, state = policy.predict(
            observation, state=state, episode_start=np.array([steps == 0]), deterministic=True
        )
        observation, reward, terminated, truncated, info = env.step(action)
        total += float(reward)
        steps += 1
    end_time = float(info.get("time", steps * planning_period(env)))
    limits = limits_met(getattr(env.unwrapped, "episodes", None), 0)
    return outcome_of(scenario, policy_name, bool(terminated), info, end_time, steps, total, limits)


def limits_met(episodes: Any, k: int) -> LimitReport:
    """The limits that robot k of the episodes has met; none where its core keeps no record."""
    met = getattr(getattr(episodes, "core", None), "limits_met", None)
    return NO_LIMITS if met is None else met(k)


def outcome_of(
    scenario: Scenario,
    policy_name: str,
    fell: bool,
    info: dict[str, Any],
    end_time: float,
    steps: int,
    total_reward: float,
    limits: LimitReport = NO_LIMITS,
) -> Outcome:
    """The outcome of an episode that has ended; `info` is that of its last step."""
    recovered_at = info.get("recovered_at")
    first = scenario.pushes[0] if scenario.pushes else None
    moving = first is not None and (first.force[0] != 0.0 or first.force[1] != 0.0)
    return Outcome(
        scenario_id=scenario.id,
        policy=policy_name,
        survived=not fell,
        recovered=not fell and recovered_at is not None,
        recovered_at=None if recovered_at is None else float(recovered_at),
        failure_reason=str(info.get("failure_reason") or "fall") if fell else None,
        end_time=end_time,
        env_steps=steps,
        total_reward=total_reward,
        impulse=first.impulse_magnitude if first else 0.0,
        psi_deg=math.degrees(first.direction) if first and moving else None,
        pushes=len(scenario.pushes),
        command=(scenario.command.vx, scenario.command.vy),
        first_limit=next(iter(limits.met), None),
        limits_met={name: round(first, 6) for name, first in limits.met.items()},
        limit_shares={name: round(share, 6) for name, share in limits.shares.items()},
    )
