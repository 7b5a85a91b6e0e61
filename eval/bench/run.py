"""Timings on this machine, in one run: bare physics, the planner, the closed loop, and others beside them."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.errors import PushRecoveryError
from ...controllers.policies.two_stage import TwoStagePolicy
from ...envs.scenario.scenario import Scenario
from ..output.progress import progress_bars
from ..output.work import Work
from ..rollout.environments import make_env
from ..rollout.load_policy import load_policy
from ..rollout.one import planning_period
from .planner import (
    CALLS,
    WARM_UP,
    Observations,
    batch_planner_timings,
    planner_timings,
    pushed_observations,
)

FULL = 5.0  # a closed loop of fewer seconds asks for the quick part only
START = "import gymnasium as gym; gym.make({env!r}, disable_env_checker=True).reset(seed=0)"


class BenchError(PushRecoveryError):
    """The closed loop did not last."""


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


def start_time(env_id: str) -> float:
    """Wall time from starting Python to an environment that has been reset, with kernels from disk [s]."""
    name = env_id if ":" in env_id else f"push_recovery:{env_id}"
    began = time.perf_counter()
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-c", START.format(env=name)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise BenchError(f"{env_id} did not start in a process of its own: {done.stderr.strip()[-200:]}")
    return time.perf_counter() - began


def biped_timings(policy: TwoStagePolicy, quick: bool) -> dict[str, Any]:
    """What only the biped has: bare physics, control, many robots, Humanoid-v5 beside them."""
    from .bipeds import batch_timings, memory_per_robot, time_control

    content = {**memory_per_robot(policy), **time_control(policy), **batch_timings(policy, quick)}
    if quick:
        return content
    from .humanoid import humanoid_timings

    return {**content, **humanoid_timings(policy)}


def bench(env_id: str, seconds: float) -> dict[str, Any]:
    """All timings that this environment has, in one run; keys of the contract, and those of `bench_tables`.

    `threads` is that of the vector form; all else is measured on one.

    Args:
        env_id: environment of the closed loop.
        seconds: simulated time of the closed loop [s]; with less than FULL the slow parts are left out: more
            than 64 robots, Humanoid-v5, other solvers, the start of a process.
    """
    env, quick = make_env(env_id), seconds < FULL
    work = Work(f"timings of {env_id}", "a minute or less" if quick else "some minutes")
    try:
        with progress_bars(["bench"], 1, work, moving=False) as bars:  # which would take time of their own
            content = _measured(env, env_id, seconds)
            bars.set("bench", 1)
        return content if quick else {**content, "start_s": start_time(env_id)}
    finally:
        env.close()


def _measured(env: gym.Env, env_id: str, seconds: float) -> dict[str, Any]:
    """All but the start of a process."""
    from ...envs.biped.env import BipedEnv

    quick = seconds < FULL
    rtf, walk = closed_loop(env, seconds)
    content: dict[str, Any] = {"env": env_id, "single_env_rtf": rtf, "threads": 1}
    policy = load_policy("two-stage", env)
    if isinstance(policy, TwoStagePolicy):
        if isinstance(env.unwrapped, BipedEnv):
            content |= biped_timings(policy, quick)
        observations = pushed_observations(env, policy, walk)
        content |= planner_timings(policy, observations[:CALLS])
        content |= batch_planner_timings(policy, observations)
        if not quick:
            from .solvers import solver_timings

            content |= solver_timings(policy, observations)
    return content
