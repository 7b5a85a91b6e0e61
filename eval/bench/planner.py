"""Timings of the planner: one plan at a time, and many in one call."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...controllers.model.gait_box import GAIT_SIZE
from ...controllers.model.observation import DCM, OBSERVATION_SIZE, TRUNK_ANGLE, TRUNK_RATE
from ...controllers.policies.plan import Plan
from ...controllers.policies.two_stage import TwoStagePolicy
from ...controllers.stage_1.columns import ROW_SIZE
from ...controllers.stage_1.planner import StepPlanner
from ...controllers.stage_2.planner import CopPlanner
from ...envs.scenario.push import polar_push
from ...envs.scenario.scenario import Scenario
from ..rollout.batch import batch_episodes
from ..rollout.wrapped_action import action_rule

CALLS, WARM_UP = 2000, 100  # timed calls of one part, and those before: compilation and caches
BATCH, REPEATS = 4096, 15  # plans in one call; timed calls of which the median is taken
ROBOTS, PERIODS = 64, 64  # that the observations of pushed robots are from
FORCE, DURATION = 150.0, 0.1  # of the largest push [N], and of each [s]

Observations = NDArray[np.float64]
Timing = dict[str, float]


def summary(microseconds: Any) -> Timing:
    """Median and 99th percentile [us]."""
    values = np.asarray(list(microseconds), dtype=np.float64)
    return {"median": round(float(np.median(values)), 3), "p99": round(float(np.quantile(values, 0.99)), 3)}


def time_calls(call: Callable[[Any], object], arguments: list[Any], calls: int = CALLS) -> Timing:
    """Time `call` on each argument in turn, `calls` times in all, after WARM_UP untimed ones."""
    clock = time.perf_counter_ns
    for k in range(WARM_UP):
        call(arguments[k % len(arguments)])
    spent = []
    for k in range(calls):
        argument = arguments[k % len(arguments)]
        began = clock()
        call(argument)
        spent.append((clock() - began) / 1e3)
    return summary(spent)


def pushed_observations(env: gym.Env, policy: TwoStagePolicy, walk: Observations) -> Observations:
    """BATCH observations of robots that walk in place and are pushed; of the walk where there are none.

    Args:
        env: whose robots they are.
        policy: that acts.
        walk: (m, 36) of one robot, repeated where the environment does not run in batches.
    """
    rule = action_rule(env)
    episodes = None if rule is None or rule.residual is not None else batch_episodes(rule.env, ROBOTS)
    if episodes is None:
        return np.resize(walk, (BATCH, OBSERVATION_SIZE))
    rng, found = np.random.default_rng(0), []
    for k in range(ROBOTS):
        force, angle, start = rng.uniform(0.0, FORCE), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 0.4)
        episodes.begin(k, Scenario(f"bench-{k}", (polar_push(force, angle, DURATION, start),)))
    for _ in range(PERIODS):
        found.append(episodes.core.observation.copy())
        episodes.step(policy.predict(found[-1])[0].reshape(ROBOTS, GAIT_SIZE))
    return np.concatenate(found)


@dataclass(frozen=True)
class Stage2:
    """The problem that stage 2 solves at one observation."""

    observation: Observations  # (36,)
    plan: Plan

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Of `CopPlanner.plan`."""
        seen = self.observation
        return self.plan.remaining, seen[DCM], seen[TRUNK_ANGLE], seen[TRUNK_RATE], self.plan.dcm_target

    @property
    def row(self) -> NDArray[np.float64]:
        """Of `CopPlanner.plan_batch`, (11,)."""
        remaining, *vectors = self.arguments
        return np.concatenate([[remaining], *vectors, np.zeros(2)])


def planner_timings(policy: TwoStagePolicy, observations: Observations) -> dict[str, Timing]:
    """Stage 1 (observation to step plan), stage 2 (both axes), a whole plan: one call each from Python."""
    batches = [np.ascontiguousarray(row, dtype=np.float64)[None] for row in observations]
    steps, row = StepPlanner(policy.robot, policy.limits, policy.config), np.empty((1, ROW_SIZE))
    planner = CopPlanner(policy.robot, policy.limits, policy.config)
    problems = [Stage2(batch[0], policy.plan(batch[0])).arguments for batch in batches]
    return {
        "stage_1_us": time_calls(lambda batch: steps.plan(batch, row), batches),
        "stage_2_us": time_calls(lambda problem: planner.plan(*problem), problems),
        "plan_us": time_calls(policy.predict, list(observations)),
    }


def batch_planner_timings(policy: TwoStagePolicy, observations: Observations) -> dict[str, float]:
    """The same for all observations in one call on one thread, each; medians of REPEATS calls [us]."""
    steps = StepPlanner(policy.robot, policy.limits, policy.config)
    planner, plans = (
        CopPlanner(policy.robot, policy.limits, policy.config),
        np.empty((len(observations), ROW_SIZE)),
    )
    rows = np.array([Stage2(seen, policy.plan(seen)).row for seen in observations])
    calls: dict[str, Callable[[], object]] = {
        "stage_1": lambda: steps.plan(observations, plans),
        "stage_2": lambda: planner.plan_batch(rows),
        "plan": lambda: policy.predict(observations),
    }
    spent = {name: [] for name in calls}
    for _ in range(REPEATS + 1):
        for name, call in calls.items():
            began = time.perf_counter_ns()
            call()
            spent[name].append((time.perf_counter_ns() - began) / (1e3 * len(observations)))
    return {f"{name}_batch_us": float(np.median(times[1:])) for name, times in spent.items()}
