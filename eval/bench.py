"""Timings on this machine: bare physics, the planner's parts, and the closed loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..controllers.errors import PushRecoveryError
from ..controllers.observation import DCM, OBSERVATION_SIZE, TRUNK_ANGLE, TRUNK_RATE
from ..envs.scenario import Scenario
from .loading import load_policy, make_env
from .rollout import planning_period

WARM_UP = 100  # calls before timing: compilation and caches
CALLS = 2000  # timed calls of a planner's part
RAW_TIME = 5.0  # simulated time of the bare physics [s]
FALL_FREE = 0.2  # the unactuated robot is put back upright after this long [s]


class BenchError(PushRecoveryError):
    """The closed loop did not last."""


Observations = NDArray[np.float64]
Timing = dict[str, float]


def summary(microseconds: Iterable[float]) -> Timing:
    """Median and 99th percentile [us]."""
    values = np.asarray(list(microseconds), dtype=np.float64)
    return {"median": round(float(np.median(values)), 3), "p99": round(float(np.quantile(values, 0.99)), 3)}


def time_calls(call: Callable[[Any], object], arguments: list[Any]) -> Timing:
    """Time `call` on each argument in turn, CALLS times in all, after WARM_UP untimed ones."""
    clock = time.perf_counter_ns
    for k in range(WARM_UP):
        call(arguments[k % len(arguments)])
    spent = []
    for k in range(CALLS):
        argument = arguments[k % len(arguments)]
        began = clock()
        call(argument)
        spent.append((clock() - began) / 1e3)
    return summary(spent)


def closed_loop(env: gym.Env, seconds: float) -> tuple[float, Observations]:
    """Real-time factor with two-stage in the loop, unpushed and in place, and the observations met."""
    policy = load_policy("two-stage", env)
    scenario = Scenario("bench", duration=seconds + WARM_UP * planning_period(env))
    observation, _ = env.reset(seed=0, options={"scenario": scenario})
    observations, began, steps = [], 0.0, 0
    over = False
    while not over:
        if steps == WARM_UP:
            began = time.perf_counter()
        action, _ = policy.predict(observation)
        observation, _, terminated, truncated, _ = env.step(action)
        observations.append(observation)
        steps += 1
        if terminated:
            raise BenchError(f"two-stage fell after {steps * planning_period(env):.2f} s; nothing to time")
        over = truncated
    wall = time.perf_counter() - began
    return (steps - WARM_UP) * planning_period(env) / wall, np.array(observations)


def planner_timings(env: gym.Env, observations: Observations) -> dict[str, Timing]:
    """Stage 1 (observation to step plan), stage 2 (both axes), a whole plan: one call each from Python."""
    from ..controllers.cop_planner import CopPlanner
    from ..controllers.policies import TwoStagePolicy
    from ..controllers.stage_1 import stage_1_constants, stage_1_rows

    policy = load_policy("two-stage", env)
    if not isinstance(policy, TwoStagePolicy):
        return {}
    batches = [
        np.ascontiguousarray(row, dtype=np.float64).reshape(1, OBSERVATION_SIZE) for row in observations
    ]
    constants = stage_1_constants(policy.robot, policy.limits, policy.config)
    low, high = policy.limits.low, policy.limits.high
    planner = CopPlanner(policy.robot, policy.limits, policy.config)
    problems = []
    for batch in batches:
        obs, plan = batch[0], policy.plan(batch[0])
        problems.append((plan.remaining, obs[DCM], obs[TRUNK_ANGLE], obs[TRUNK_RATE], plan.dcm_target))
    return {
        "stage_1_us": time_calls(lambda batch: stage_1_rows(batch, constants, low, high, True), batches),
        "stage_2_us": time_calls(lambda problem: planner.plan(*problem), problems),
        "plan_us": time_calls(policy.predict, list(observations)),
    }


def physics_timings(env: gym.Env) -> dict[str, Any]:
    """Bare mj_step of the environment's model, and what control adds to a physics step.

    whole_body_us is the wall time of an environment step less its bare physics, by physics step: gait
    machine, swing foot, whole-body control, observation and Python around them.
    """
    model = getattr(env.unwrapped, "model", None)
    if model is None:
        return {}
    import mujoco as mujoco_module

    mujoco: Any = mujoco_module  # its functions are not in its stubs
    data = mujoco.MjData(model)
    count = max(1, round(FALL_FREE / model.opt.timestep))
    wall = simulated = 0.0
    while simulated < RAW_TIME:
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, data, 0)
        else:
            mujoco.mj_resetData(model, data)
        began = time.perf_counter()
        mujoco.mj_step(model, data, count)
        wall += time.perf_counter() - began
        simulated += count * model.opt.timestep
    raw_us = wall / simulated * model.opt.timestep * 1e6
    ticks = planning_period(env) / model.opt.timestep
    spent = [(step_us - ticks * raw_us) / ticks for step_us in _step_times(env)]
    return {"raw_physics_rtf": simulated / wall, "whole_body_us": summary(spent)}


def _step_times(env: gym.Env) -> list[float]:
    """Wall times of environment steps along a nominal gait [us]."""
    policy = load_policy("passive", env)
    period = planning_period(env)
    observation, _ = env.reset(
        seed=0, options={"scenario": Scenario("bench", duration=(WARM_UP + CALLS) * period)}
    )
    spent, over = [], False
    while not over:
        action, _ = policy.predict(observation)
        began = time.perf_counter_ns()
        observation, _, terminated, truncated, _ = env.step(action)
        spent.append((time.perf_counter_ns() - began) / 1e3)
        over = terminated or truncated
    return spent[min(WARM_UP, len(spent) // 2) :]


def bench(env_id: str, seconds: float) -> dict[str, Any]:
    """All timings that this environment has, in one run; keys of the contract, one thread.

    Args:
        env_id: environment of the closed loop.
        seconds: simulated time of the closed loop [s].
    """
    env = make_env(env_id)
    try:
        rtf, observations = closed_loop(env, seconds)
        return {
            "env": env_id,
            **physics_timings(env),
            "single_env_rtf": rtf,
            "threads": 1,
            **planner_timings(env, observations[:CALLS]),
        }
    finally:
        env.close()
