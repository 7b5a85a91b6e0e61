"""Gymnasium's Humanoid-v5 without any controller, side by side with the closed loop of many bipeds."""

from __future__ import annotations

import time
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.policies.two_stage import TwoStagePolicy
from ...envs.biped.env import BIPED_LIMITS
from ...envs.scenario.physics_options import CONTROL_STEP
from .bipeds import walking_core

HUMANOID = "Humanoid-v5"
ROBOTS = 64
SLICES = 12  # of either, in turn
HUMANOID_STEPS, PERIODS = 60, 6  # in a slice


def humanoid_timings(policy: TwoStagePolicy) -> dict[str, float]:
    """Simulated seconds per wall second on one core, of both; medians of SLICES slices.

    Humanoid-v5 gets random actions, drawn before; only its steps are timed, not its resets. The bipeds have
    planner and whole-body control in the loop.
    """
    env, core = gym.make(HUMANOID, disable_env_checker=True), walking_core(ROBOTS, 1)
    slices = []
    try:
        env.reset(seed=0)
        env.action_space.seed(0)
        for _ in range(SLICES):
            slices.append((_humanoid(env), _bipeds(core, policy)))
        humanoid, biped = np.median(slices, axis=0)
    finally:
        env.close()
    rates = {"humanoid_rtf": float(humanoid), "biped_rtf": float(biped)}
    return {**rates, "over_humanoid": float(biped / humanoid)}


def _humanoid(env: gym.Env) -> float:
    actions = [env.action_space.sample() for _ in range(HUMANOID_STEPS)]
    spent, clock = 0, time.perf_counter_ns
    for action in actions:
        began = clock()
        _, _, terminated, truncated, _ = env.step(action)
        spent += clock() - began
        if terminated or truncated:
            env.reset()
    dt: Any = env.unwrapped.dt  # type: ignore[attr-defined]
    return HUMANOID_STEPS * float(dt) * 1e9 / spent


def _bipeds(core: Any, policy: TwoStagePolicy) -> float:
    began = time.perf_counter_ns()
    for _ in range(PERIODS):
        actions = policy.predict(core.observation)[0]
        core.step(BIPED_LIMITS.from_action(actions), actions.astype(np.float64))
    spent = time.perf_counter_ns() - began
    return ROBOTS * PERIODS * core.substeps * CONTROL_STEP * 1e9 / spent
