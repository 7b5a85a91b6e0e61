import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.qp import QpSolution, kkt_residual, solve_qp
from push_recovery.controllers.stage_1 import StepProblem, solve_step, step_program

OMEGA = math.sqrt(9.81 / 0.8)


def random_problem(rng, alpha_offset=None):
    elapsed = rng.uniform(0.0, 0.6)
    dcm = rng.uniform([-0.3, -0.2], [0.3, 0.3])
    return StepProblem(
        gain=tuple(float(v) for v in dcm * math.exp(-OMEGA * elapsed)),
        step_nominal=(float(rng.uniform(-0.3, 0.3)), 0.2),
        tau_nominal=math.exp(OMEGA * 0.65),
        offset_nominal=(float(rng.uniform(-0.05, 0.05)), -0.0186),
        step_low=(-0.5, 0.1),
        step_high=(0.5, 0.4),
        tau_low=math.exp(OMEGA * max(0.3, elapsed)),
        tau_high=math.exp(OMEGA * 1.0),
        alpha_offset=10.0 ** rng.uniform(1, 6) if alpha_offset is None else alpha_offset,
        alpha_duration=10.0 ** rng.uniform(-2, 1),
    )


def cost(p, step, tau):
    offset = np.multiply.outer(tau, p.gain) - step
    return (
        p.alpha_step * np.sum((step - np.array(p.step_nominal)) ** 2, -1)
        + p.alpha_duration * (tau - p.tau_nominal) ** 2
        + p.alpha_offset * np.sum((offset - np.array(p.offset_nominal)) ** 2, -1)
    )


def test_equals_daqp_and_osqp():
    rng = np.random.default_rng(0)
    for _ in range(60):
        p = random_problem(rng, alpha_offset=10.0 ** rng.uniform(1, 4))
        plan = solve_step(p)
        exact = [*plan.step, plan.tau, *plan.offset]
        for solver, tolerance in (("daqp", 1e-8), ("osqp", 1e-5)):
            other = solve_qp(step_program(p), solver)
            assert other.status == "solved"
            assert other.x == pytest.approx(exact, abs=tolerance)


def test_no_point_of_a_fine_grid_is_better():
    rng = np.random.default_rng(1)
    for _ in range(40):
        p = random_problem(rng)
        plan = solve_step(p)
        taus = np.linspace(p.tau_low, p.tau_high, 20001)
        free = np.array(p.alpha_step * np.array(p.step_nominal)) + p.alpha_offset * (
            taus[:, None] * np.array(p.gain) - np.array(p.offset_nominal)
        )
        steps = np.clip(free / (p.alpha_step + p.alpha_offset), p.step_low, p.step_high)
        values = cost(p, steps, taus)
        mine = cost(p, np.array(plan.step), plan.tau)
        assert mine <= values.min() + 1e-9 * max(1.0, mine)
        assert values.min() - mine <= 1e-3 * max(1.0, mine)  # the grid comes close


def kkt_dual(program, x):
    """Multipliers of the rows active at x, by least squares; wrong signs would show in kkt_residual."""
    rows = program.A @ x
    active = (np.abs(rows - program.lower) < 1e-9) | (np.abs(rows - program.upper) < 1e-9)
    dual = np.zeros(len(rows))
    gradient = program.H @ x + program.f
    dual[active] = np.linalg.lstsq(program.A[active].T, -gradient, rcond=None)[0]
    return dual, rows


def test_kkt_conditions_hold():
    rng = np.random.default_rng(2)
    for _ in range(200):
        p = random_problem(rng)
        plan = solve_step(p)
        program = step_program(p)
        x = np.array([*plan.step, plan.tau, *plan.offset])
        dual, rows = kkt_dual(program, x)
        residual = kkt_residual(program, QpSolution(x, dual, "solved", 0))
        assert residual.stationarity < 1e-9
        assert residual.feasibility < 1e-9
        for i in range(2, 5):  # a push outwards only at the bound it belongs to
            if dual[i] > 1e-9:
                assert rows[i] == pytest.approx(program.upper[i], abs=1e-9)
            if dual[i] < -1e-9:
                assert rows[i] == pytest.approx(program.lower[i], abs=1e-9)


def test_nominal_state_keeps_the_nominal_step():
    tau = math.exp(OMEGA * 0.65)
    p = StepProblem(
        (0.0, 0.0186 / 1.0), (0.0, 0.2), tau, (0.0, 0.0186 * tau - 0.2), (-0.5, 0.1), (0.5, 0.4), 2.0, 30.0
    )
    plan = solve_step(p)
    assert plan.step == pytest.approx((0.0, 0.2), abs=1e-12)
    assert plan.duration(OMEGA) == pytest.approx(0.65, abs=1e-12)


def test_fixed_time_and_free_time_without_a_preference():
    p = random_problem(np.random.default_rng(4))
    fixed = replace(p, tau_low=7.0, tau_high=7.0)
    assert solve_step(fixed).tau == 7.0
    flat = replace(p, gain=(0.0, 0.0), alpha_duration=0.0, tau_nominal=9.0)
    assert flat.tau_low <= solve_step(flat).tau <= flat.tau_high


@pytest.mark.parametrize(
    "change",
    [{"gain": (math.nan, 0.0)}, {"step_low": (0.6, 0.1)}, {"tau_low": -1.0}, {"alpha_step": -1.0}],
)
def test_bad_problems_are_refused(change):
    with pytest.raises(InvalidValueError):
        replace(random_problem(np.random.default_rng(5)), **change)
