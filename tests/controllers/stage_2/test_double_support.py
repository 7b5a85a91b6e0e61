import math
import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import strip, transfer_mean
from push_recovery.controllers.model.observation import ELAPSED
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.qp import solve_qp
from push_recovery.controllers.settings import preset_config
from push_recovery.controllers.stage_1 import ROW_SIZE
from push_recovery.controllers.stage_2.double_support import DoubleSupportPlanner, WithDoubleSupport
from push_recovery.controllers.stage_2.problem import SOLVED

ROBOT, LIMITS = RobotModel(), GaitLimits()
CONFIG = preset_config("double-support")
PLANNER = DoubleSupportPlanner(ROBOT, LIMITS, CONFIG)
VARIANTS = [{}, {"use_trunk": False}, {"use_cop": False}, {"trunk_debt": False, "trunk_gravity": 50.0},
        {"cop_margin_x": 0.02, "cop_margin_y": 0.01}]  # fmt: skip


def rows(n: int, seed: int = 0, spread: float = 0.04) -> np.ndarray:
    """States about a step that needs no correction, as `plan_batch` takes them."""
    rng, out = np.random.default_rng(seed), np.empty((n, 12))
    for row in out:
        elapsed, duration = rng.choice([0.0, 0.01, 0.05, 0.0893, 0.09, 0.0962]), rng.uniform(0.3, 1.0)
        other, step = (np.array([rng.uniform(-0.5, 0.5), rng.uniform(0.1, 0.4)]) for _ in range(2))
        target = step + [0.0, -0.02]
        dcm = target * math.exp(-ROBOT.omega * (duration - elapsed)) + 0.15 * other
        row[0:2] = duration - elapsed, elapsed
        row[2:4], row[4:6], row[10:12] = other, dcm + spread * rng.normal(size=2), target
        row[6:8], row[8:10] = 0.3 * rng.normal(size=2), rng.normal(size=2)
    return out


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: ",".join(variant) or "all")
def test_plan_is_the_optimum_of_the_dense_problem(variant, kkt_residual):
    planner = DoubleSupportPlanner(ROBOT, LIMITS, replace(CONFIG, **variant))
    tight = 0
    for row, out in zip(rows(40), planner.plan_batch(rows(40)), strict=True):
        problem = planner.program(row)
        solution = solve_qp(problem.qp)
        assert max(kkt_residual(problem.qp, solution)) < 1e-3
        assert out[6] == 0
        for i, (axis, x) in enumerate(zip(problem.axes, np.split(solution.x, 2), strict=True)):
            cop, acceleration = axis.first(x)
            assert out[i] == pytest.approx(cop, abs=1e-6)
            assert out[2 + i] == pytest.approx(acceleration, abs=1e-5)
            assert out[4 + i] == pytest.approx(axis.dcm_end(x), abs=1e-6)
        strips = problem.qp.lower.size - 2 * problem.axes[0].qp.lower.size
        tight += bool(strips and np.abs(solution.dual[-strips:]).max() > 1e-6)
    if planner.config.use_cop:
        assert tight > 5  # the hull's strip couples the axes


def test_undisturbed_state_follows_the_transfer():
    omega, d, remaining = ROBOT.omega, CONFIG.double_support, 0.63
    other, target = np.array([-0.1, 0.2]), np.array([0.12, 0.17])
    dcm = target * math.exp(-omega * remaining) + other * transfer_mean(0.02, 10.0, d, omega)
    row = np.concatenate([[remaining, 0.02], other, dcm, np.zeros(4), target])
    expected = np.concatenate([other * transfer_mean(0.02, 0.01, d, omega), np.zeros(2), target, [0]])
    assert PLANNER.plan_batch(row[None])[0] == pytest.approx(expected, abs=1e-9)


def test_cop_stays_in_the_hull_and_reaches_its_slanted_edge():
    states = rows(600, seed=1, spread=0.1)
    edge = 0
    for row, out in zip(states, PLANNER.plan_batch(states), strict=True):
        normal_x, normal_y, half = strip(row[2], row[3], LIMITS.cop_x_max, LIMITS.cop_y_max)
        over = abs(normal_x * out[0] + normal_y * out[1])
        assert over <= half + 1e-12
        for i, size in enumerate((LIMITS.cop_x_max, LIMITS.cop_y_max)):
            assert min(row[2 + i], 0.0) - size - 1e-12 <= out[i] <= max(row[2 + i], 0.0) + size + 1e-12
        edge += over > half - 1e-9
    assert edge > 60


def test_mirrored_state_gives_the_mirrored_plan():
    states = rows(100, seed=2)
    for flip in ([-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]):
        mirrored = states * np.concatenate([[1.0, 1.0], np.tile(flip, 5)])
        expected = PLANNER.plan_batch(states)[:, :6] * np.tile(flip, 3)
        np.testing.assert_allclose(PLANNER.plan_batch(mirrored)[:, :6], expected, atol=1e-7)


def test_a_plan_depends_on_its_arguments_alone():
    states = rows(30, seed=3)
    together = PLANNER.plan_batch(states)
    fresh = pickle.loads(pickle.dumps(PLANNER))  # noqa: S301
    for k in np.random.default_rng(0).permutation(30):
        np.testing.assert_array_equal(fresh.plan_batch(states[k : k + 1])[0], together[k])
    assert not together[:, 6].any()


def test_osqp_agrees_with_daqp():
    states = rows(8, seed=4, spread=0.01)
    second = DoubleSupportPlanner(ROBOT, LIMITS, replace(CONFIG, solver="osqp")).plan_batch(states)
    exact, places = PLANNER.plan_batch(states), [0, 1, 4, 5]  # CoP and DCM at touchdown
    np.testing.assert_allclose(second[:, places], exact[:, places], atol=1e-4)
    assert np.sum(second[:, 6] == SOLVED) >= 5


def test_bad_input_is_named():
    for start, message in (
        ((0.6, 0.0, np.nan), "finite"),
        ((0.5, 0.1, 0.0), r"less than 0\.1 s since the last"),
        ((2.0, 0.0, 0.0), r"at most 1\.3 s"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            PLANNER.plan_batch(np.array([[*start, 0.2, *[0.0] * 8]]))
    with pytest.raises(InvalidValueError, match=r"\(n, 12\)"):
        PLANNER.plan_batch(rows(1)[0])
    with pytest.raises(InvalidValueError, match="margins"):
        DoubleSupportPlanner(ROBOT, LIMITS, replace(CONFIG, cop_margin_y=0.05))


def test_both_feet_count_while_they_stand_for_most_of_the_coming_period():
    """0.1 s of double support, periods of 0.01 s: up to 0.095 s."""
    single, joint = [], []
    one = SimpleNamespace(regulate=lambda seen, rows: single.extend(seen[:, ELAPSED].tolist()))
    planner = WithDoubleSupport(PLANNER, one)
    planner._regulate_both = lambda seen, rows: joint.extend(seen[:, ELAPSED].tolist())
    seen = np.zeros((4, 36))
    seen[:, ELAPSED] = 0.0, 0.094, 0.096, 0.3
    planner.regulate(seen, np.zeros((4, ROW_SIZE)))
    assert (joint, single) == ([0.0, 0.094], [0.096, 0.3])
