"""Timings on this machine, in one run: bare physics, the planner, the closed loop, and others beside them.

Times are in microseconds where no other unit is given. `warm_up` compiles all kernels ahead of their use.
"""

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

from ...controllers.errors import PushRecoveryError
from ...controllers.policies.two_stage import RandomPolicy, TwoStagePolicy
from ...controllers.settings import VARIANTS
from ...envs.scenario.model_errors import ModelErrors
from ...envs.scenario.push import Push
from ...envs.scenario.scenario import Command, CommandChange, Scenario
from ..output.progress import Work, progress_bars
from ..output.tables import Table
from ..rollout import environments, episodes, load_policy
from ..rollout.environments import env_ids, make_env
from ..rollout.episodes import rollout, rollout_all
from ..rollout.load_policy import acts_on_joints, acts_on_residual, make_policy
from . import KEYS, planner

FULL = 5.0  # a closed loop of fewer seconds asks for the quick part only
ROBOTS = re.compile(r"period_us_(\d+)_robots_(\d+)_threads")
SOLVER = re.compile(r"stage_1_(\w+)_us")
START = "import gymnasium as gym; gym.make({env!r}, disable_env_checker=True, **{options!r}).reset(seed=0)"


class BenchError(PushRecoveryError):
    """The closed loop did not last."""


def closed_loop(env: gym.Env, seconds: float) -> tuple[float, planner.Observations]:
    """Real-time factor with two-stage in the loop, unpushed and in place, and the observations met."""
    policy, period = load_policy.load_policy("two-stage", env), episodes.planning_period(env)
    scenario = Scenario("bench", duration=seconds + planner.WARM_UP * period)
    observation, _ = env.reset(seed=0, options={"scenario": scenario})
    observations, began, steps, over = [], 0.0, 0, False
    while not over:
        if steps == planner.WARM_UP:
            began = time.perf_counter()
        action, _ = policy.predict(observation)
        observation, _, terminated, truncated, _ = env.step(action)
        observations.append(observation)
        steps += 1
        if terminated:
            raise BenchError(f"two-stage fell after {steps * period:.2f} s; nothing to time")
        over = truncated
    wall = time.perf_counter() - began
    return (steps - planner.WARM_UP) * period / wall, np.array(observations)


def start_time(env_id: str, **options: str) -> float:
    """Wall time from starting Python to an environment that has been reset, with kernels from disk [s]."""
    name = env_id if ":" in env_id else f"push_recovery:{env_id}"
    code = START.format(env=name, options=options)
    began = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        raise BenchError(f"{env_id} did not start in a process of its own: {done.stderr.strip()[-200:]}")
    return time.perf_counter() - began


def bench(env_id: str, seconds: float) -> dict[str, Any]:
    """All timings that this environment has, in one run; named by `KEYS` and `GROUPS`.

    `threads` is that of the vector form; all else is measured on one.

    Args:
        env_id: environment of the closed loop.
        seconds: simulated time of the closed loop [s]; with less than FULL the slow parts are left out: more
            than 64 robots, Humanoid-v5, other solvers, the start of a process.
    """
    env, quick = environments.make_env(env_id), seconds < FULL
    work = Work(f"timings of {env_id}", "a minute or less" if quick else "some minutes")
    try:
        with progress_bars(["bench"], 1, work, moving=False) as bars:  # which would take time of their own
            content = _measured(env, env_id, seconds)
            bars.set("bench", 1)
        if quick:
            return content
        named = environments.EnvName.parse(env_id)
        return {**content, "start_s": start_time(named.full_id, **named.options)}
    finally:
        env.close()


def _measured(env: gym.Env, env_id: str, seconds: float) -> dict[str, Any]:
    """All timings but that of the start of a process."""
    from ...envs.biped.env import BipedEnv
    from . import closed_loop as loop

    quick = seconds < FULL
    rtf, walk = closed_loop(env, seconds)
    content: dict[str, Any] = {"env": env_id, "single_env_rtf": rtf, "threads": 1}
    policy = load_policy.load_policy("two-stage", env)
    if isinstance(policy, TwoStagePolicy):
        own = (policy.robot, policy.limits) == (loop.BIPED, loop.BIPED_LIMITS)
        if isinstance(env.unwrapped, BipedEnv) and own:  # what follows is timed on that robot
            content |= loop.memory_per_robot(policy) | loop.time_control(policy)
            content |= loop.batch_timings(policy, quick)
            content |= {} if quick else loop.humanoid_timings(policy)
        observations = planner.pushed_observations(env, policy, walk)
        content |= planner.planner_timings(policy, observations[: planner.CALLS])
        content |= planner.batch_planner_timings(policy, observations)
        if not quick:
            content |= planner.solver_timings(policy, observations)
    return content


def number(value: Any) -> str:
    """A number, or a median and its 99th percentile."""
    if isinstance(value, dict):
        return f"{value['median']:.2f} (p99 {value['p99']:.2f})"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def key_cells(content: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Key, value and meaning of each timing that stands alone."""
    return [(key, number(content[key]), meaning) for key, meaning in KEYS.items() if key in content]


def robot_cells(content: dict[str, Any]) -> list[tuple[str, ...]]:
    """Robots, threads, period of one robot, real-time factor, cost over physics."""
    cells = []
    for match in filter(None, map(ROBOTS.fullmatch, content)):
        label = f"{match[1]}_robots_{match[2]}_threads"
        values = [content[f"{name}_{label}"] for name in ("period_us", "rtf", "cost_over_physics")]
        cells.append((match[1], match[2], f"{values[0]:.0f}", f"{values[1]:.0f}", f"{values[2]:.2f}"))
    return cells


def solver_cells(content: dict[str, Any]) -> list[tuple[str, ...]]:
    """Solver, stage 1, stage 2, error of stage 2; the planner first, missing solvers last."""
    if "solvers_missing" not in content:
        return []
    cells = [("this planner", number(content["stage_1_us"]), number(content["stage_2_us"]), "-")]
    for match in filter(None, map(SOLVER.fullmatch, content)):
        if f"stage_2_{match[1]}_error_m" in content:
            first, second = (number(content[f"stage_{stage}_{match[1]}_us"]) for stage in (1, 2))
            cells.append((match[1], first, second, f"{content[f'stage_2_{match[1]}_error_m']:.0e} m"))
    for name in content["solvers_missing"]:
        cells.append((name, "not installed", f"pip install {planner.MODULES[name]}", "-"))
    return cells


def result_tables(content: dict[str, Any]) -> list[Table]:
    """What was measured: single numbers, closed loops of many robots, other solvers."""
    title = f"{content['env']}: rtf = simulated seconds per wall second, times in microseconds"
    robots = ("robots", "threads", "period of a robot [us]", "rtf", "cost over bare physics")
    solvers = ("solver", "stage 1 [us]", "stage 2, both axes [us]", "CoP from ours")
    calls = "The planner's problems from Python, one call each: median (p99)"
    tables = [
        Table(title, ("", "value", "what"), key_cells(content)),
        Table("Closed loop of many robots", robots, robot_cells(content)),
        Table(calls, solvers, solver_cells(content)),
    ]
    return [table for table in tables if table]


DOUBLE_SUPPORT = "PushRecovery/Pendulum-v0@double-support"
TOGETHER = 2  # robots side by side: what runs in batches
WALK = Scenario(
    "warm-up", (Push((30.0, 10.0, 0.0), 0.1, 0.2),), Command(0.1), duration=1.0,
    changes=(CommandChange(0.4, Command()),),
)  # fmt: skip
ERRORS = {  # those that each kind of robot knows
    "Pendulum": ModelErrors(mass=0.05, slope_forward=0.01, delay=0.004, dcm_noise=0.001),
    "Biped": ModelErrors(
        mass=0.05, payload=1.0, friction=0.8, slope_left=0.01, delay=0.004, dcm_noise=0.001,
        joint_noise=0.0005, floor_step=0.005,
    ),
}  # fmt: skip


def warm_up() -> Iterator[str]:
    """Run every environment, preset form and variant for a second; yields what comes next, for a display.

    What was compiled is kept for every process of this user until its sources change. Where all of it is
    there, this takes seconds.
    """
    for name in names():
        yield name
        _run(name)


def names() -> list[str]:
    """Environments that `warm_up` runs, those of other robots left out: their kernels are the biped's."""
    return [*(name for name in env_ids() if "robot" not in gym.spec(name).kwargs), DOUBLE_SUPPORT]


def variants(name: str) -> list[str]:
    """Those that plan in an environment; the paper's stage 2 and linear MPC know no double support."""
    without = ("two-stage-paper", "herdt") if name == DOUBLE_SUPPORT else ()
    return [variant for variant in VARIANTS if variant not in without]


def _run(name: str) -> None:
    env = make_env(name)
    try:
        if acts_on_residual(env) or acts_on_joints(env):
            # random actions may be residuals and targets as well; no variant gives those
            policy = make_policy("random", env) if acts_on_joints(env) else RandomPolicy()
            rollout(env, policy, WALK, "random")
            rollout_all(env, policy, [WALK] * TOGETHER, "random", TOGETHER)
            return
        errors = next(value for kind, value in ERRORS.items() if kind in name)
        for variant in variants(name):
            policy = make_policy(variant, env)
            rollout(env, policy, WALK, variant)
            rollout_all(env, policy, [WALK, replace(WALK, errors=errors)], variant, TOGETHER)
    finally:
        env.close()
