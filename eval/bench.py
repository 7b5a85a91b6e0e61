"""Timings on this machine: bare physics, the planner's parts, and the closed loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Walk:
    """A nominal walk of the biped as the physics met it."""

    step_us: NDArray[np.float64]  # (n,) wall time of one planning period inside the simulation core [us]
    states: list[tuple[NDArray[np.float64], ...]]  # (qpos, qvel, ctrl) after each of them


def record_walk(env: gym.Env, core: Any) -> Walk:
    """Walk in place with two-stage; times the core's step, without policy and environment around it."""
    policy = load_policy("two-stage", env)
    period = planning_period(env)
    scenario = Scenario("bench", duration=(WARM_UP + CALLS) * period)
    observation, _ = env.reset(seed=0, options={"scenario": scenario})
    spent, states, step = [], [], core.step

    def timed(*arguments: Any) -> None:
        began = time.perf_counter_ns()
        step(*arguments)
        spent.append((time.perf_counter_ns() - began) / 1e3)

    core.step = timed
    try:
        over = False
        while not over:
            action, _ = policy.predict(observation)
            observation, _, terminated, truncated, _ = env.step(action)
            states.append(
                tuple(np.array(getattr(core.physics, name)[0]) for name in ("qpos", "qvel", "ctrl"))
            )
            over = terminated or truncated
    finally:
        del core.step
    skip = min(WARM_UP, len(spent) // 2)
    return Walk(np.array(spent[skip:]), states[skip:])


def physics_timings(env: gym.Env) -> dict[str, Any]:
    """Bare mj_step along a walk, and what control adds to a physics step.

    whole_body_us is the wall time of the simulation core less the bare physics of the same states, by physics
    step: gait machine, swing foot, whole-body control.
    """
    from ..envs.biped_env import BipedEnv
    from ..envs.biped_model import biped_model

    if not isinstance(env.unwrapped, BipedEnv):
        return {}
    import mujoco as mujoco_module

    mujoco: Any = mujoco_module  # its functions are not in its stubs
    model, core = biped_model(), env.unwrapped.core
    walk, data = record_walk(env, core), mujoco.MjData(model)
    steps = core.substeps
    spent = []
    for qpos, qvel, ctrl in walk.states:
        data.qpos, data.qvel, data.ctrl = qpos, qvel, ctrl
        began = time.perf_counter_ns()
        mujoco.mj_step(model, data, steps)
        spent.append((time.perf_counter_ns() - began) / 1e3)
    raw_us = float(np.median(spent)) / steps
    return {
        "raw_physics_rtf": model.opt.timestep * 1e6 / raw_us,
        "whole_body_us": summary(walk.step_us / steps - raw_us),
    }


def vector_timings(env: gym.Env) -> dict[str, Any]:
    """The closed loop of many bipeds at once, in their simulation core; see `bench_batch`."""
    from ..controllers.policies import TwoStagePolicy
    from ..envs.biped_env import BipedEnv

    policy = load_policy("two-stage", env)
    if not (isinstance(env.unwrapped, BipedEnv) and isinstance(policy, TwoStagePolicy)):
        return {}
    from .bench_batch import batch_timings

    return batch_timings(policy)


def bench(env_id: str, seconds: float) -> dict[str, Any]:
    """All timings that this environment has, in one run; keys of the contract.

    `threads` is that of the vector form; all else is measured on one.

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
            **vector_timings(env),
        }
    finally:
        env.close()
