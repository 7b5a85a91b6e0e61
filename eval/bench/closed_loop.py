"""The closed loop of many bipeds at once: planner, whole-body control and physics, against bare physics.

Gymnasium's Humanoid-v5 without any controller is timed side by side with it.
"""

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...controllers.model.nominal_gait import nominal_gait, nominal_start
from ...controllers.policies.two_stage import TwoStagePolicy
from ...envs.biped.core import BIPED, BIPED_LIMITS, BipedCore
from ...envs.robots.biped import biped_model
from ...envs.scenario.model_errors import CONTROL_STEP
from ...envs.scenario.push import Push
from ...envs.scenario.scenario import Scenario
from .planner import summary

ROBOTS = {1: (1,), 16: (1, 2), 64: (1, 2), 256: (1, 2), 1024: (1,)}  # number: threads to try
QUICK = (1, 16, 64)  # numbers that take no time to speak of
SHOWN = (64, 2)  # robots and threads of `vector_env_rtf`
WARM_UP, PERIODS = 10, 50  # planning periods before timing, and timed
MEMORY = 256  # robots of which the memory is taken
CALLS = 1000  # planning periods of the one robot whose control is timed
HUMANOID = "Humanoid-v5"
BATCH_ROBOTS = 64
SLICES = 12  # of either, in turn
HUMANOID_STEPS, SLICE_PERIODS = 60, 6  # in a slice


@dataclass(frozen=True)
class BatchTiming:
    """Median wall time of one planning period of one robot, in one run [us]."""

    robots: int
    threads: int
    physics: float  # bare steps of the same states, on as many threads
    plan: float
    core: float  # whole-body control and physics
    period: float  # simulated [s]

    @property
    def rtf(self) -> float:
        """Simulated seconds of all robots per wall second."""
        return self.period * 1e6 / (self.plan + self.core)

    @property
    def over_physics(self) -> float:
        """Cost of the closed loop over that of bare physics."""
        return (self.plan + self.core) / self.physics


def walking_core(n: int, threads: int, force: float = 150.0) -> BipedCore:
    """N robots at the start of a walk in place; each is pushed once, with up to `force` [N] for 0.1 s."""
    core, rng = BipedCore(n, BIPED, BIPED_LIMITS, threads=threads), np.random.default_rng(0)
    nominal = nominal_gait(BIPED, BIPED_LIMITS, (0.0, 0.0))
    gait = np.array([nominal.length, nominal.width, nominal.duration, 0.0, 0.0, 0.0, 0.0])
    action = BIPED_LIMITS.to_action(gait).astype(np.float64)
    start = nominal_start(nominal, BIPED.pelvis_width, BIPED.omega)
    for k in range(n):
        angle, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, force)
        push = Push((size * np.cos(angle), size * np.sin(angle), 0.0), 0.1, rng.uniform(0.05, 0.45))
        core.reset(k, Scenario(f"bench-{k}", (push,)), start, gait, action)
    return core


def advance(core: BipedCore, policy: TwoStagePolicy) -> None:
    """One planning period of all robots."""
    actions = policy.predict(core.observation)[0]
    core.step(BIPED_LIMITS.from_action(actions), actions.astype(np.float64))


def time_batch(policy: TwoStagePolicy, n: int, threads: int) -> BatchTiming:
    """Time the closed loop of n robots; bare physics by `mujoco.batch` from the same states, in turn."""
    from mujoco.batch import Batch

    core, raw = walking_core(n, threads), Batch(biped_model(), n, threads, persistent=True)
    qpos, qvel, ctrl = raw.bind("qpos"), raw.bind("qvel"), raw.bind("ctrl")
    spent: NDArray[np.float64] = np.zeros((WARM_UP + PERIODS, 3))
    clock = time.perf_counter_ns
    for tick in spent:
        qpos[:], qvel[:], ctrl[:] = core.physics.qpos, core.physics.qvel, core.physics.ctrl
        times = [clock()]
        raw.step(nstep=core.substeps)
        times.append(clock())
        actions = policy.predict(core.observation)[0]
        times.append(clock())
        core.step(BIPED_LIMITS.from_action(actions), actions.astype(np.float64))
        times.append(clock())
        tick[:] = np.diff(times) / (1e3 * n)
    physics, plan, step = np.median(spent[WARM_UP:], axis=0)
    return BatchTiming(n, threads, float(physics), float(plan), float(step), core.substeps * CONTROL_STEP)


def time_control(policy: TwoStagePolicy) -> dict[str, Any]:
    """Bare mj_step along an undisturbed walk of one robot, and what control adds to a physics step.

    whole_body_us is the wall time of the simulation core less the bare physics of the same states, by physics
    step: gait machine, swing foot, whole-body control.
    """
    import mujoco as mujoco_module

    mujoco: Any = mujoco_module  # its functions are not in its stubs
    core, model = walking_core(1, 1, force=0.0), biped_model()
    data, steps, clock = mujoco.MjData(model), core.substeps, time.perf_counter_ns
    spent: NDArray[np.float64] = np.zeros((WARM_UP + CALLS, 2))
    for tick in spent:
        for name in ("qpos", "qvel", "ctrl"):
            getattr(data, name)[:] = getattr(core.physics, name)[0]
        actions = policy.predict(core.observation)[0]
        gaits, actions = BIPED_LIMITS.from_action(actions), actions.astype(np.float64)
        times = [clock()]
        mujoco.mj_step(model, data, steps)
        times.append(clock())
        core.step(gaits, actions)
        times.append(clock())
        tick[:] = np.diff(times) / (1e3 * steps)
    physics = float(np.median(spent[WARM_UP:, 0]))
    return {
        "raw_physics_rtf": CONTROL_STEP * 1e6 / physics,
        "whole_body_us": summary(spent[WARM_UP:, 1] - physics),
    }


def resident_mib() -> float | None:
    """Resident memory of this process that no file backs [MiB]; None where the system does not say.

    Pages of libraries and caches are left out: the system takes them back whenever it likes.
    """
    try:
        resident, of_files = map(int, Path("/proc/self/statm").read_text().split()[1:3])
    except OSError:
        return None
    return (resident - of_files) * os.sysconf("SC_PAGE_SIZE") / 2**20


def memory_per_robot(policy: TwoStagePolicy) -> dict[str, float]:
    """Resident memory that a robot takes [MiB]; to be taken before much has been freed."""
    before = resident_mib()
    core = walking_core(MEMORY, 1)
    for _ in range(WARM_UP):
        advance(core, policy)
    after = resident_mib()
    return {} if before is None or after is None else {"memory_mib_per_robot": (after - before) / MEMORY}


def batch_timings(policy: TwoStagePolicy, quick: bool = False) -> dict[str, Any]:
    """Flat keys for every number of robots and threads, and the keys of the contract for `SHOWN`."""
    content: dict[str, Any] = {}
    for n in QUICK if quick else ROBOTS:
        for threads in ROBOTS[n]:
            timing = time_batch(policy, n, threads)
            label = f"{n}_robots_{threads}_threads"
            content[f"rtf_{label}"] = timing.rtf
            content[f"cost_over_physics_{label}"] = timing.over_physics
            content[f"period_us_{label}"] = timing.plan + timing.core
            if (n, threads) == SHOWN:
                content |= {"vector_env_rtf": timing.rtf, "vector_envs": n, "threads": threads}
    return content


def humanoid_timings(policy: TwoStagePolicy) -> dict[str, float]:
    """Simulated seconds per wall second on one core, of both; medians of SLICES slices.

    Humanoid-v5 gets random actions, drawn before; only its steps are timed, not its resets. The bipeds have
    planner and whole-body control in the loop.
    """
    env, core = gym.make(HUMANOID, disable_env_checker=True), walking_core(BATCH_ROBOTS, 1)
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
    for _ in range(SLICE_PERIODS):
        advance(core, policy)
    spent = time.perf_counter_ns() - began
    return BATCH_ROBOTS * SLICE_PERIODS * core.substeps * CONTROL_STEP * 1e9 / spent
