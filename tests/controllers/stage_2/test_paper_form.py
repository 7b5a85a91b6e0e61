import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.qp import solve_qp
from push_recovery.controllers.settings import PlannerConfig
from push_recovery.controllers.stage_2.paper_form import JerkCopPlanner
from push_recovery.controllers.stage_2.problem import STATUS, grid

ROBOT, LIMITS = RobotModel(), GaitLimits()
REPAIRED = PlannerConfig(form="jerk", beta_trunk=1e-2)
LITERAL = PlannerConfig(form="jerk", beta_trunk=1.0, beta_trunk_rate=1.0, jerk_cost="literal")
PLANNERS = {
    "repaired": JerkCopPlanner(ROBOT, LIMITS, REPAIRED),
    "literal": JerkCopPlanner(ROBOT, LIMITS, LITERAL),
}
SPREAD = np.array([0.05, 0.2, 0.5, 0.2, 0.02, 0.03, 3.0])[:, None]  # the arguments of plan, from dcm on


def call(planner: JerkCopPlanner, remaining: float, state) -> SimpleNamespace:
    out = planner.plan(remaining, state)
    return SimpleNamespace(
        cop=out[:2], trunk_acceleration=out[2:4], dcm_end=out[4:6], status=STATUS[int(out[6])]
    )


def states(n: int, seed: int = 0, scale: float = 1.0) -> list[tuple[float, np.ndarray]]:
    rng = np.random.default_rng(seed)
    return [(float(rng.uniform(0.02, 0.9)), scale * SPREAD * rng.normal(size=(7, 2))) for _ in range(n)]


def paper_matrices(T: float) -> tuple[np.ndarray, np.ndarray]:
    """A and B of eqs. 12-14."""
    A = np.eye(5)
    A[0, 1] = A[2, 3] = A[3, 4] = T
    A[2, 4] = T**2 / 2
    B = np.array([[T**2 / 2, 0], [T, 0], [0, T**3 / 6], [0, T**2 / 2], [0, T]])
    return A, B


def paper_cost(
    config: PlannerConfig, remaining: float, state: np.ndarray, U: np.ndarray
) -> tuple[float, list]:
    """Eq. 20 of inputs U (N, 2), and the states, by rolling the state-space model out."""
    w, c = ROBOT.omega, ROBOT.cmp_per_trunk_acceleration
    xi, theta, rate, target, reference, cop, acceleration = state
    x = np.array([xi, w * (xi - cop - c * acceleration), theta, rate, acceleration])
    cost, time, trace = 0.0, 0.0, []
    for k, T in enumerate(grid(config, remaining)):
        share = T / config.sampling_time if k == 0 else 1.0
        free = 0.0
        if config.jerk_cost == "repaired":
            free = w * (xi - reference) * (np.exp(w * (time + T)) - np.exp(w * time)) / T
        A, B = paper_matrices(T)
        x = A @ x + B @ U[k]
        z = x[0] - x[1] / w - c * x[4]
        cost += config.beta_cop * (z - reference) ** 2 + config.beta_trunk_rate * x[3] ** 2
        cost += share * (
            config.beta_dcm_acceleration * (U[k, 0] - free) ** 2 + config.beta_trunk * U[k, 1] ** 2
        )
        cost += config.beta_trunk_angle * x[2] ** 2 if config.jerk_cost == "repaired" else 0.0
        trace.append(np.append(x, z))
        time += T
    return cost + config.beta_dcm * (x[0] - target) ** 2, trace


@pytest.mark.parametrize("name", PLANNERS)
def test_program_is_the_papers_cost_and_constraints(name):
    planner, rng = PLANNERS[name], np.random.default_rng(1)
    for remaining, state in states(10):
        qp = planner.program(remaining, 0, state[:, 0])
        N = qp.f.size // 2
        zero = paper_cost(planner.config, remaining, state[:, 0], np.zeros((N, 2)))[0]
        U = rng.normal(size=(N, 2)) * [1.0, 20.0]
        x = U.T.ravel()
        cost, trace = paper_cost(planner.config, remaining, state[:, 0], U)
        assert 2 * (0.5 * x @ qp.H @ x + qp.f @ x) + zero == pytest.approx(cost, rel=1e-9)
        trace = np.array(trace)
        at_limit = qp.A @ x - qp.upper  # value - bound
        np.testing.assert_allclose(at_limit[:N], trace[:, 5] - LIMITS.cop_x_max, atol=1e-9)
        np.testing.assert_allclose(
            at_limit[N : 2 * N], trace[:, 4] - LIMITS.trunk_acceleration_max, atol=1e-9
        )
        np.testing.assert_allclose(at_limit[2 * N :], trace[:, 2] - ROBOT.trunk_angle_max, atol=1e-9)


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
@pytest.mark.parametrize("name", PLANNERS)
def test_plan_is_the_optimum_of_the_program(name, solver, kkt_residual):
    planner = JerkCopPlanner(ROBOT, LIMITS, replace(PLANNERS[name].config, solver=solver))
    for remaining, state in states(20, seed=2, scale=0.5):
        plan = call(planner, remaining, state)
        assert plan.status == "solved"
        for axis in range(2):
            qp = planner.program(remaining, axis, state[:, axis])
            solution = solve_qp(qp)
            assert max(kkt_residual(qp, solution)) < 1e-3
            U = solution.x.reshape(2, -1).T
            trace = paper_cost(planner.config, remaining, state[:, axis], U)[1]
            assert plan.dcm_end[axis] == pytest.approx(trace[-1][0], abs=1e-6)
            period = min(0.01, grid(planner.config, remaining)[0])
            acceleration = state[6, axis] + period * U[0, 1]
            assert plan.trunk_acceleration[axis] == pytest.approx(acceleration, abs=1e-4)


def test_repaired_form_always_has_a_plan_within_the_bounds():
    for remaining, state in states(300, seed=3, scale=6.0):
        plan = call(PLANNERS["repaired"], remaining, state)
        assert plan.status == "solved"
        assert np.all(np.abs(plan.cop) <= [LIMITS.cop_x_max, LIMITS.cop_y_max])
        assert np.all(np.abs(plan.trunk_acceleration) <= LIMITS.trunk_acceleration_max)


def test_literal_form_says_where_the_trunk_limit_had_to_give_way():
    state = np.zeros((7, 2))
    state[1:3, 0] = 1.0, 8.0
    plan = call(PLANNERS["literal"], 0.3, state)
    assert plan.status == "relaxed"
    assert plan.trunk_acceleration[0] < 0


def walk(planner: JerkCopPlanner) -> tuple[np.ndarray, np.ndarray]:
    """Nominal step, closed loop: (CoPs, DCM error at touchdown)."""
    start, h, cop, acceleration = np.array([0.03, 0.02]), 0.01, np.zeros(2), np.zeros(2)
    dcm, target = start, start * np.exp(ROBOT.omega * 0.6)
    angle, rate, cops = np.zeros(2), np.zeros(2), []
    for k in range(60):
        plan = call(planner, 0.6 - k * h, [dcm, angle, rate, target, np.zeros(2), cop, acceleration])
        cop, acceleration = plan.cop, plan.trunk_acceleration
        cmp = cop + ROBOT.cmp_per_trunk_acceleration * acceleration
        dcm = cmp + np.exp(ROBOT.omega * h) * (dcm - cmp)
        angle, rate = angle + h * rate + h * h / 2 * acceleration, rate + h * acceleration
        cops.append(cop)
    return np.array(cops), dcm - target


def test_repaired_form_leaves_the_nominal_motion_alone_and_the_literal_one_does_not():
    quiet, error = walk(PLANNERS["repaired"])
    assert np.max(np.abs(quiet)) < 2e-3
    assert np.max(np.abs(error)) < 2e-3
    restless, _ = walk(PLANNERS["literal"])
    assert np.max(np.abs(restless[:, 0])) > 0.05


def test_mirrored_state_gives_the_mirrored_plan_and_repeats_are_identical():
    for planner in PLANNERS.values():
        for remaining, state in states(20, seed=4):
            plan, mirrored = call(planner, remaining, state), call(planner, remaining, -state)
            np.testing.assert_allclose(mirrored.cop, -plan.cop, atol=1e-12)
            np.testing.assert_allclose(mirrored.trunk_acceleration, -plan.trunk_acceleration, atol=1e-9)
            again = call(pickle.loads(pickle.dumps(planner)), remaining, state)  # noqa: S301
            np.testing.assert_array_equal(again.cop, plan.cop)
            np.testing.assert_array_equal(again.dcm_end, plan.dcm_end)


@pytest.mark.parametrize("variant", [{"use_cop": False}, {"use_trunk": False}])
def test_unused_inputs_stay_at_rest(variant):
    planner = JerkCopPlanner(ROBOT, LIMITS, replace(REPAIRED, **variant))
    for remaining, state in states(10, seed=5):
        qp = planner.program(
            remaining, 0, state[:, 0] * np.array([1, 1, 1, 1, 1, 1, variant != {"use_trunk": False}])
        )
        plan, N = call(planner, remaining, state), grid(planner.config, remaining).size
        assert plan.status == "solved"
        if "use_trunk" in variant:
            assert plan.trunk_acceleration.tolist() == [0.0, 0.0]
            assert qp.f.size == N
        else:
            np.testing.assert_allclose(qp.upper[:N], qp.lower[:N], atol=1e-15)


def test_bad_input_is_named():
    planner, state = PLANNERS["repaired"], np.zeros((7, 2))
    with pytest.raises(InvalidValueError, match="finite"):
        planner.plan(0.3, state + np.inf)
    with pytest.raises(InvalidValueError, match=r"at most 1\.3 s"):
        planner.plan(2.0, state)
    with pytest.raises(UnknownNameError, match="literal, repaired"):
        JerkCopPlanner(ROBOT, LIMITS, replace(REPAIRED, jerk_cost="exact"))  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="beta_dcm_acceleration"):
        JerkCopPlanner(ROBOT, LIMITS, replace(REPAIRED, beta_dcm_acceleration=0.0))


@pytest.mark.parametrize("axis", [0, 1])
def test_either_axis_says_where_its_limit_gave_way(axis):
    state = np.zeros((7, 2))
    state[1:3, axis] = 1.0, 8.0  # the stop of 1.047 rad is passed within 6 ms
    assert call(PLANNERS["literal"], 0.3, state).status == "relaxed"
