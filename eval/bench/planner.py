"""Timings of the planner, one plan at a time and many in one call, and of general solvers on its problems.

The solvers get the planner's two problems as matrices, from Python, by their own interfaces.
"""

import importlib
import importlib.util
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...controllers.model.gait_box import DURATION, GAIT_SIZE, STEP
from ...controllers.model.observation import DCM, ELAPSED, OBSERVATION_SIZE, TRUNK_ANGLE, TRUNK_RATE
from ...controllers.policies.two_stage import Plan, TwoStagePolicy
from ...controllers.qp import QuadraticProgram
from ...controllers.stage_1 import ROW_SIZE, StepPlanner, StepProblem, step_program
from ...controllers.stage_2.single_support import CopPlanner
from ...envs.scenario.push import polar_push
from ...envs.scenario.scenario import Scenario
from ..rollout.episodes import action_rule, batch_episodes

CALLS, WARM_UP = 2000, 100  # timed calls of one part, and those before: compilation and caches
BATCH, REPEATS = 4096, 15  # plans in one call; timed calls of which the median is taken
ROBOTS, PERIODS = 64, 64  # that the observations of pushed robots are from
FORCE, PUSH_DURATION = 150.0, 0.1  # of the largest push [N], and of each [s]

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
    """BATCH observations of robots that walk in place and are pushed; of `walk` (m, 36) where none are."""
    rule = action_rule(env)
    episodes = None if rule is None or rule.residual is not None else batch_episodes(rule.env, ROBOTS)
    if episodes is None:
        return np.resize(walk, (BATCH, OBSERVATION_SIZE))
    rng, found = np.random.default_rng(0), []
    for k in range(ROBOTS):
        force, angle, start = rng.uniform(0.0, FORCE), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 0.4)
        episodes.begin(k, Scenario(f"bench-{k}", (polar_push(force, angle, PUSH_DURATION, start),)))
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
    def row(self) -> NDArray[np.float64]:
        """Row of `CopPlanner.plan_batch`, (11,)."""
        seen, plan = self.observation, self.plan
        state = seen[DCM], seen[TRUNK_ANGLE], seen[TRUNK_RATE], plan.dcm_target
        return np.concatenate([[plan.remaining], *state, np.zeros(2)])


def planner_timings(policy: TwoStagePolicy, observations: Observations) -> dict[str, Timing]:
    """Stage 1 (observation to step plan), stage 2 (both axes), a whole plan: one call each from Python."""
    batches = [np.ascontiguousarray(row, dtype=np.float64)[None] for row in observations]
    steps, row = StepPlanner(policy.robot, policy.limits, policy.config), np.empty((1, ROW_SIZE))
    planner = CopPlanner(policy.robot, policy.limits, policy.config)
    rows = [Stage2(batch[0], policy.plan(batch[0])).row[None] for batch in batches]
    return {
        "stage_1_us": time_calls(lambda batch: steps.plan(batch, row), batches),
        "stage_2_us": time_calls(planner.plan_batch, rows),
        "plan_us": time_calls(policy.predict, list(observations)),
    }


def batch_planner_timings(policy: TwoStagePolicy, observations: Observations) -> dict[str, float]:
    """The same for all observations in one call on one thread, each; medians of REPEATS calls [us]."""
    steps = StepPlanner(policy.robot, policy.limits, policy.config)
    planner = CopPlanner(policy.robot, policy.limits, policy.config)
    plans = np.empty((len(observations), ROW_SIZE))
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


Array = NDArray[np.float64]
PROBLEMS = 200
TOLERANCE = 1e-6  # of the solvers that iterate
MODULES = {"daqp": "daqp", "osqp": "osqp", "quadprog": "quadprog", "proxqp": "proxsuite"}


def hard(program: QuadraticProgram) -> QuadraticProgram:
    """A program with its soft rows written out: a slack each among the x, at its weight."""
    soft = np.flatnonzero(program.soft_weight > 0)
    n, m, k = program.f.size, program.lower.size, soft.size
    H, A = np.zeros((n + k, n + k)), np.zeros((m, n + k))
    H[:n, :n], A[:, :n] = program.H, program.A
    H[range(n, n + k), range(n, n + k)] = program.soft_weight[soft]
    A[soft, range(n, n + k)] = 1.0
    return replace(program, H=H, f=np.concatenate([program.f, np.zeros(k)]), A=A, soft_weight=np.zeros(m))


Prepared = tuple[Callable[[], Any], Callable[[Any], Array]]  # solves a program; reads x out of what that gave


def _daqp(problem: QuadraticProgram) -> Prepared:
    import daqp

    sense = np.zeros(problem.lower.size, np.int32)
    lower, upper = np.ascontiguousarray(problem.lower), np.ascontiguousarray(problem.upper)
    return lambda: daqp.solve(problem.H, problem.f, problem.A, upper, lower, sense), lambda found: found[0]


def _osqp(problem: QuadraticProgram) -> Prepared:
    import osqp
    from scipy import sparse

    P, A = sparse.csc_matrix(np.triu(problem.H)), sparse.csc_matrix(problem.A)

    def solve() -> Any:
        solver = osqp.OSQP()
        solver.setup(
            P, problem.f, A, problem.lower, problem.upper, verbose=False, eps_abs=TOLERANCE, eps_rel=TOLERANCE
        )
        return solver.solve(raise_error=False)

    return solve, lambda found: found.x


def _quadprog(problem: QuadraticProgram) -> Prepared:
    quadprog: Any = importlib.import_module("quadprog")
    equal = problem.lower == problem.upper
    rows = np.vstack([problem.A[equal], problem.A[~equal], -problem.A[~equal]])
    bounds = np.concatenate([problem.lower[equal], problem.lower[~equal], -problem.upper[~equal]])
    C, count = np.ascontiguousarray(rows.T), int(equal.sum())
    return lambda: quadprog.solve_qp(problem.H, -problem.f, C, bounds, count), lambda found: found[0]


def _proxqp(problem: QuadraticProgram) -> Prepared:
    proxsuite: Any = importlib.import_module("proxsuite")
    equal = problem.lower == problem.upper
    A, b, C = problem.A[equal], problem.lower[equal], problem.A[~equal]
    lower, upper = problem.lower[~equal], problem.upper[~equal]
    solve = proxsuite.proxqp.dense.solve
    return (
        lambda: solve(problem.H, problem.f, A, b, C, lower, upper, eps_abs=TOLERANCE, eps_rel=0.0),
        lambda found: found.x,
    )


SOLVERS = {"daqp": _daqp, "osqp": _osqp, "quadprog": _quadprog, "proxqp": _proxqp}


def step_problem(policy: TwoStagePolicy, problem: Stage2) -> StepProblem:
    """The stage 1 problem behind a plan: its gain follows from u + b = a tau."""
    plan, config, omega = problem.plan, policy.config, policy.robot.omega
    tau, nominal = math.exp(omega * float(plan.gait[DURATION])), plan.nominal
    gain = (plan.gait[:2] + plan.offset) / tau
    low, high = policy.limits.low, policy.limits.high
    earliest = max(float(low[DURATION]), float(problem.observation[ELAPSED]) + config.duration_margin)
    return StepProblem(
        gain=(float(gain[0]), float(gain[1])), step_nominal=(nominal.length, nominal.width),
        tau_nominal=math.exp(omega * nominal.duration), offset_nominal=(nominal.offset_x, nominal.offset_y),
        step_low=(float(low[STEP]), float(low[STEP + 1])),
        step_high=(float(high[STEP]), float(high[STEP + 1])),
        tau_low=math.exp(omega * earliest), tau_high=math.exp(omega * max(float(high[DURATION]), earliest)),
        alpha_step=config.alpha_step, alpha_duration=config.alpha_duration, alpha_offset=config.alpha_offset,
    )  # fmt: skip


Problems = list[list[QuadraticProgram]]  # without soft rows; each group is timed as one


def record(policy: TwoStagePolicy, observations: Array) -> tuple[Problems, Problems, Array]:
    """Problems of stage 1; those of stage 2, x and y; and the CoP that stage 2 decides on, (n, 2) [m].

    PROBLEMS of each, evenly spaced over the observations, less those at which the step plan is held.
    """
    rows = observations[np.linspace(0, len(observations) - 1, PROBLEMS).astype(int)]
    problems = [problem for row in rows if not (problem := Stage2(row, policy.plan(row))).plan.held]
    planner = CopPlanner(policy.robot, policy.limits, policy.config)
    stage_1 = [[hard(step_program(step_problem(policy, problem)))] for problem in problems]
    stage_2 = [[hard(planner.program(problem.row, axis).qp) for axis in (0, 1)] for problem in problems]
    return stage_1, stage_2, planner.plan_batch(np.array([problem.row for problem in problems]))[:, :2]


def _time_all(name: str, problems: Problems) -> tuple[Timing, list[list[Any]]]:
    """Time of each group of problems [us], and what the solver gave for each; the second of two runs."""
    prepared = [[SOLVERS[name](problem) for problem in group] for group in problems]
    spent, results = [], []
    for _ in range(2):
        spent, results = [], []
        for group in prepared:
            began = time.perf_counter_ns()
            found = [solve() for solve, _ in group]
            spent.append((time.perf_counter_ns() - began) / 1e3)
            results.append(found)
    return summary(spent), results


def solver_timings(policy: TwoStagePolicy, observations: Array) -> dict[str, Any]:
    """Each solver on the same recorded problems, from matrices to solution, one call each from Python.

    For each solver NAME, stage_2_NAME_us is the time for both axes, and stage_2_NAME_error_m is the largest
    difference of its CoP from ours. `stage_2_daqp_c_us` is the time that DAQP itself counts in its C code.
    """
    stage_1, stage_2, own_cop = record(policy, observations)
    missing = [name for name, module in MODULES.items() if importlib.util.find_spec(module) is None]
    content: dict[str, Any] = {"solvers_missing": missing}
    for name in (name for name in SOLVERS if name not in missing):
        content[f"stage_1_{name}_us"], _ = _time_all(name, stage_1)
        content[f"stage_2_{name}_us"], results = _time_all(name, stage_2)
        _, read = SOLVERS[name](stage_2[0][0])
        cop = np.array([[float(read(found)[0]) for found in group] for group in results])
        content[f"stage_2_{name}_error_m"] = float(np.max(np.abs(cop - own_cop)))
        if name == "daqp":
            spent = [sum(1e6 * (f[3]["setup_time"] + f[3]["solve_time"]) for f in group) for group in results]
            content["stage_2_daqp_c_us"] = summary(spent)
            content["stage_2_daqp_c_mean_us"] = float(np.mean(spent))
    return content
