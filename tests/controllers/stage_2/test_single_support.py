import pickle
from dataclasses import replace
from types import SimpleNamespace

import numba
import numpy as np
import pytest
from push_recovery.controllers.array_table import dense_part_of
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.qp import solve_qp
from push_recovery.controllers.settings import PlannerConfig
from push_recovery.controllers.stage_2.problem import (
    RESULT_SIZE,
    STATUS,
    acceleration_interval,
    constants_of,
)
from push_recovery.controllers.stage_2.single_support import CopPlanner, Parts, plan_rows

ROBOT, LIMITS, ZERO = RobotModel(), GaitLimits(), (0.0, 0.0)
CONFIG = PlannerConfig(beta_trunk_limit=1e4)
PLANNER = CopPlanner(ROBOT, LIMITS, CONFIG)
SPREAD = np.array(
    [0.08, 0.08, 0.4, 0.4, 2.0, 2.0, 0.3, 0.3, 0.02, 0.02]
)  # dcm, angle, rate, target, reference
VARIANTS = [{}, {"use_trunk": False}, {"use_cop": False}, {"trunk_gravity": 70.0},
        {"trunk_debt": True}, {"trunk_debt": True, "use_cop": False}]  # fmt: skip


def rows(n: int, seed: int = 0, scale: float = 1.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    times = rng.uniform(-0.02, 1.2, (n, 1))
    return np.concatenate([times, scale * SPREAD * rng.normal(size=(n, 10))], axis=1)


def call(planner: CopPlanner, *row) -> SimpleNamespace:
    """The plan of a row (11,), given whole or in parts."""
    out = planner.plan_batch(np.hstack(row)[None])[0]
    return SimpleNamespace(
        cop=out[:2], trunk_acceleration=out[2:4], dcm_end=out[4:6], status=STATUS[int(out[6])]
    )


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: ",".join(variant) or "all")
def test_plan_is_the_optimum_of_the_dense_problem(variant, kkt_residual):
    planner = CopPlanner(ROBOT, LIMITS, replace(CONFIG, **variant))
    for row in rows(60):
        plan = call(planner, row)
        assert plan.status == "solved"
        for axis in range(2):
            problem = planner.program(row, axis)
            solution = solve_qp(problem.qp)
            # Multipliers reach beta_dcm x 1 m
            assert max(kkt_residual(problem.qp, solution)) < 1e-3
            cop, acceleration = problem.first(solution.x)
            assert plan.cop[axis] == pytest.approx(cop, abs=1e-6)
            assert plan.trunk_acceleration[axis] == pytest.approx(acceleration, abs=1e-5)
            assert plan.dcm_end[axis] == pytest.approx(problem.dcm_end(solution.x), abs=1e-6)


def test_osqp_agrees_with_daqp():
    second, solved = CopPlanner(ROBOT, LIMITS, replace(CONFIG, solver="osqp")), 0
    for row in rows(15, seed=3, scale=0.4):
        exact, first_order = call(PLANNER, row), call(second, row)
        solved += first_order.status == "solved"  # a first-order method may give up; its plan is then DAQP's
        np.testing.assert_allclose(first_order.cop, exact.cop, atol=1e-5)
        np.testing.assert_allclose(first_order.dcm_end, exact.dcm_end, atol=1e-5)
        np.testing.assert_allclose(first_order.trunk_acceleration, exact.trunk_acceleration, atol=2e-5)
    assert solved >= 13


@pytest.mark.parametrize("remaining", [0.004, 0.05, 0.237, 0.65])
def test_predicted_end_equals_the_integrated_motion(remaining):
    """Dense Runge-Kutta integration of eqs. 6b and 9 under the planned inputs."""
    row = rows(1, seed=4)[0]
    row[0] = remaining
    problem = PLANNER.program(row, 0)
    x = solve_qp(problem.qp).x
    dcm, time = row[1], 0.0
    for k, duration in enumerate(problem.durations[: problem.cops]):
        cmp = x[k] + ROBOT.cmp_per_trunk_acceleration * x[problem.cops + k]
        steps = 400
        h = duration / steps
        for _ in range(steps):
            k1 = ROBOT.omega * (dcm - cmp)
            k2 = ROBOT.omega * (dcm + h / 2 * k1 - cmp)
            k3 = ROBOT.omega * (dcm + h / 2 * k2 - cmp)
            k4 = ROBOT.omega * (dcm + h * k3 - cmp)
            dcm += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        time += duration
    assert time == pytest.approx(remaining, abs=1e-12)
    assert call(PLANNER, row).dcm_end[0] == pytest.approx(dcm, abs=1e-6)


def test_unconstrained_cop_only_plan_has_a_closed_form():
    """One interval: z = (p beta z_ref + B w e) / (p beta + B w^2), e the error of the free motion."""
    planner = CopPlanner(ROBOT, LIMITS, replace(CONFIG, use_trunk=False))
    remaining, dcm, target, reference = 0.04, 0.01, 0.0112, 0.002
    growth = np.exp(ROBOT.omega * remaining)
    weight, share = growth - 1, remaining / CONFIG.sampling_time
    error = growth * dcm - target
    own = CONFIG.beta_cop * share
    expected = (own * reference + CONFIG.beta_dcm * weight * error) / (own + CONFIG.beta_dcm * weight**2)
    plan = call(planner, remaining, (dcm, 0.0), ZERO, ZERO, (target, 0.0), (reference, 0.0))
    assert plan.cop[0] == pytest.approx(expected, abs=1e-12)
    assert plan.trunk_acceleration.tolist() == [0.0, 0.0]


def test_every_state_has_a_plan_within_the_bounds():
    extreme = rows(2000, seed=5, scale=8.0)
    out = PLANNER.plan_batch(extreme)
    assert np.all(out[:, 6] == 0)
    assert np.all(np.abs(out[:, 0]) <= LIMITS.cop_x_max)
    assert np.all(np.abs(out[:, 1]) <= LIMITS.cop_y_max)
    assert np.all(np.abs(out[:, 2:4]) <= LIMITS.trunk_acceleration_max)
    assert np.mean(np.abs(out[:, 0]) == LIMITS.cop_x_max) > 0.2  # the bounds were tried


def test_mirrored_state_gives_the_mirrored_plan():
    states = rows(200, seed=6)
    mirrored = states * np.concatenate([[1.0], np.full(10, -1.0)])
    np.testing.assert_allclose(
        PLANNER.plan_batch(mirrored)[:, :6], -PLANNER.plan_batch(states)[:, :6], atol=1e-12
    )


def test_axes_are_independent_and_equal():
    row = rows(1, seed=7, scale=0.2)[0]
    swapped = row.copy()
    swapped[1:] = row[1:].reshape(5, 2)[:, ::-1].ravel()
    np.testing.assert_array_equal(call(PLANNER, swapped).cop, call(PLANNER, row).cop[::-1])


def test_a_plan_depends_on_its_arguments_alone():
    states = rows(50, seed=8)
    together = PLANNER.plan_batch(states)
    order = np.random.default_rng(0).permutation(50)
    np.testing.assert_array_equal(PLANNER.plan_batch(states[order]), together[order])
    fresh = CopPlanner(ROBOT, LIMITS, CONFIG)
    for k in order:
        plan = call(fresh, states[k])
        np.testing.assert_array_equal(np.concatenate([plan.cop, plan.trunk_acceleration]), together[k, :4])


def test_every_worker_has_scratch_of_its_own_and_gives_the_same_plans():
    states = rows(100, seed=9)
    alone, planner = PLANNER.plan_batch(states), CopPlanner(ROBOT, LIMITS, CONFIG, 3)
    scratch = ("matrices", "handles", "lower", "upper", "optimum", "solution")
    addresses = {getattr(own, name).ctypes.data for own in planner._tables for name in scratch}
    assert len(addresses) == 3 * len(scratch)
    for packed in planner.packed:
        out = np.zeros((100, RESULT_SIZE))
        assert plan_rows(states, out, packed) == 0
        assert out.tobytes() == alone.tobytes()
    assert len(pickle.loads(pickle.dumps(planner)).packed) == 3  # noqa: S301
    states[-1, 1] = np.nan
    with pytest.raises(InvalidValueError, match="stage 2 needs finite states"):
        planner.plan_batch(states)


@numba.njit
def tables_of(packed):
    return dense_part_of(packed, Parts, "tables")


@pytest.mark.parametrize("use_trunk", [True, False])
def test_the_compiled_loop_reads_every_array_where_it_lies_and_scalars_by_their_names(use_trunk):
    planner = CopPlanner(ROBOT, LIMITS, replace(CONFIG, use_trunk=use_trunk), workers=2)
    assert constants_of(planner._tables[0].numbers) == planner.constants
    assert planner.constants.use_trunk == use_trunk
    assert planner.constants.omega == ROBOT.omega
    assert planner.constants.beta_dcm == CONFIG.beta_dcm
    for packed, held in zip(planner.packed, planner._tables, strict=True):
        found = tables_of(packed)
        assert type(found) is type(held)
        np.testing.assert_array_equal(found.box, LIMITS.box)
        for name, own, other in zip(held._fields, found, held, strict=True):
            assert other.flags.c_contiguous, name
            assert own.ctypes.data == other.ctypes.data, name
            assert (own.dtype, own.shape) == (other.dtype, other.shape), name


def test_closed_loop_reaches_the_target_and_rights_the_trunk():
    dcm, target = np.array([0.03, 0.02]), np.array([0.03, 0.02]) * np.exp(ROBOT.omega * 0.6) + [0.75, -0.45]
    angle, rate, h = np.zeros(2), np.zeros(2), 0.01
    for k in range(60):
        plan = call(PLANNER, 0.6 - k * h, dcm, angle, rate, target, ZERO)
        cmp = plan.cop + ROBOT.cmp_per_trunk_acceleration * plan.trunk_acceleration
        dcm = cmp + np.exp(ROBOT.omega * h) * (dcm - cmp)
        angle = angle + h * rate + h * h / 2 * plan.trunk_acceleration
        rate = rate + h * plan.trunk_acceleration
        assert np.all(np.abs(angle) < ROBOT.trunk_angle_max + 0.02)
    np.testing.assert_allclose(dcm, target, atol=1e-4)


def test_gravity_of_the_trunk_is_taken_from_the_torque():
    planner = CopPlanner(ROBOT, LIMITS, replace(CONFIG, trunk_gravity=70.0))
    row = np.zeros(11)
    row[[0, 3, 4]] = 0.3, 0.5, -0.5
    bounds = []
    for axis in range(2):
        problem = planner.program(row, axis)
        accelerations = slice(problem.cops, problem.cops + problem.accelerations)
        low, high = set(problem.qp.lower[accelerations]), set(problem.qp.upper[accelerations])
        assert len(low) == len(high) == 1
        bounds.append((*low, *high))
    (low, high), mirrored = bounds
    assert low == pytest.approx((70.0 * np.sin(0.5) - 150.0) / 8.0)
    assert high == LIMITS.trunk_acceleration_max
    assert mirrored == (-high, -low)
    assert acceleration_interval(0.5, 70.0 / 8.0, 150.0 / 8.0, 1.0) == (-1.0, 1.0)  # within the gait box


def test_margins_keep_the_cop_from_the_edge():
    planner = CopPlanner(ROBOT, LIMITS, replace(CONFIG, cop_margin_x=0.02, cop_margin_y=0.012))
    plan = call(planner, 0.3, (0.4, 0.4), ZERO, ZERO, ZERO, ZERO)
    np.testing.assert_allclose(plan.cop, [0.08, 0.038], atol=1e-12)


def test_planner_survives_pickling():
    copy = pickle.loads(pickle.dumps(PLANNER))  # noqa: S301
    np.testing.assert_array_equal(copy.plan_batch(rows(1)), PLANNER.plan_batch(rows(1)))


def test_bad_input_is_named():
    with pytest.raises(InvalidValueError, match="finite"):
        call(PLANNER, 0.3, (np.nan, 0.0), np.zeros(8))
    with pytest.raises(InvalidValueError, match=r"at most 1\.3 s"):
        call(PLANNER, 5.0, np.zeros(10))
    with pytest.raises(InvalidValueError, match=r"\(n, 11\)"):
        PLANNER.plan_batch(np.zeros((3, 4)))
    with pytest.raises(InvalidValueError, match="margins"):
        CopPlanner(ROBOT, LIMITS, replace(CONFIG, cop_margin_y=0.05))
    with pytest.raises(InvalidValueError, match="beta_trunk"):
        CopPlanner(ROBOT, LIMITS, replace(CONFIG, beta_trunk=0.0))


def test_a_touchdown_one_interval_beyond_the_longest_horizon_is_refused():
    assert call(PLANNER, 1.3, np.zeros(10)).status == "solved"
    with pytest.raises(InvalidValueError, match=r"at most 1\.3 s"):
        call(PLANNER, 1.32, np.zeros(10))
