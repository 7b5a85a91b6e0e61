"""What the planner's timings are of."""

import time
from itertools import accumulate, cycle
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import TwoStagePolicy
from push_recovery.controllers.qp import QuadraticProgram
from push_recovery.controllers.stage_1 import solve_step
from push_recovery.eval.bench import planner as bench_solvers
from push_recovery.eval.bench.planner import BATCH, SOLVERS, WARM_UP, pushed_observations, solver_timings
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.load_policy import load_policy


@pytest.fixture(scope="module")
def met():
    env = make_env("PushRecovery/Pendulum-v0")
    policy = load_policy("two-stage", env)
    assert isinstance(policy, TwoStagePolicy)
    return env, policy, pushed_observations(env, policy, np.zeros((1, 36)))


def test_summary():
    assert bench_solvers.summary(range(1, 101)) == {"median": 50.5, "p99": 99.01}


def test_calls_are_counted_and_timed():
    calls = []

    def wait(argument):
        calls.append(argument)
        if len(calls) > WARM_UP and len(calls) % 2:
            time.sleep(20e-6)

    timing = bench_solvers.time_calls(wait, [1, 2, 3], 50)
    assert len(calls) == WARM_UP + 50
    assert calls[:4] == [1, 2, 3, 1]
    assert timing["p99"] > 20.0


def test_observations_are_of_robots_that_were_pushed(met):
    _, policy, observations = met
    assert observations.shape == (BATCH, 36)
    assert len(np.unique(observations, axis=0)) > 0.5 * BATCH
    plans = [policy.plan(row) for row in observations[::64]]
    moved = [np.abs(plan.step - [plan.nominal.length, plan.nominal.width]).max() > 0.02 for plan in plans]
    assert np.mean(moved) > 0.2
    walk = np.arange(72.0).reshape(2, 36)
    unknown = make_env("toy_gait_env:PushRecovery/SturdyToy-v0")
    assert pushed_observations(unknown, policy, walk)[:3].tolist() == [*walk.tolist(), walk[0].tolist()]


def test_stage_1_problems_are_those_behind_the_plans(met):
    _, policy, observations = met
    for row in observations[::97]:
        problem = bench_solvers.Stage2(row, policy.plan(row))
        if problem.plan.held:
            continue
        solution = solve_step(bench_solvers.step_problem(policy, problem))
        assert solution.step == pytest.approx(problem.plan.step.tolist(), abs=1e-9)
        assert solution.duration(policy.robot.omega) == pytest.approx(problem.plan.duration, abs=1e-9)


def test_a_soft_row_costs_half_its_weight_times_its_slack_squared():
    """min 0.5 x^2 - 3 x with x <= 1 soft at weight 2: x = (3 + 2) / (1 + 2)."""
    one = np.ones((1, 1))
    program = QuadraticProgram(one, np.array([-3.0]), one, np.array([-9.0]), np.ones(1), np.array([2.0]))
    solve, read = SOLVERS["daqp"](bench_solvers.hard(program))
    assert read(solve())[0] == pytest.approx(5.0 / 3.0)


def test_every_solver_finds_our_plan(met, monkeypatch):
    _, policy, observations = met
    monkeypatch.setattr(bench_solvers, "PROBLEMS", 8)
    content = solver_timings(policy, observations)
    assert set(content["solvers_missing"]) <= {"quadprog", "proxqp"}
    for name in set(SOLVERS) - set(content["solvers_missing"]):
        assert content[f"stage_2_{name}_error_m"] < 1e-4
        assert 0 < content[f"stage_1_{name}_us"]["median"] <= content[f"stage_1_{name}_us"]["p99"]
    assert content["stage_2_daqp_c_us"]["median"] < content["stage_2_daqp_us"]["median"]
    assert np.abs(bench_solvers.record(policy, observations)[2]).max() <= 0.1


def test_a_solver_that_is_not_installed_is_named(met, monkeypatch):
    _, policy, observations = met
    monkeypatch.setattr(bench_solvers, "PROBLEMS", 2)
    monkeypatch.setattr(bench_solvers, "MODULES", dict.fromkeys(bench_solvers.MODULES, "no_such_module"))
    content = solver_timings(policy, observations)
    assert content == {"solvers_missing": ["daqp", "osqp", "quadprog", "proxqp"]}


def test_a_batch_is_timed_by_the_plan(met, monkeypatch):
    """A clock on which every call lasts 1 ms, 77 us apart: of 8 plans 125 us each."""
    _, policy, observations = met
    ticks = accumulate(cycle([77_000, 1_000_000]))
    monkeypatch.setattr(bench_solvers, "time", SimpleNamespace(perf_counter_ns=lambda: next(ticks)))
    found = bench_solvers.batch_planner_timings(policy, observations[:8])
    assert found == pytest.approx(
        {"stage_1_batch_us": 125.0, "stage_2_batch_us": 125.0, "plan_batch_us": 125.0}
    )
