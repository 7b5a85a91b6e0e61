"""Stage 2 on two feet: the optimum by another solver, the limits in closed form, mirror and rest."""

import copy
import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.model.standing import CORNERS, OFFSET, Feet, max_standing_impulse
from push_recovery.controllers.qp import QuadraticProgram, solve_qp
from push_recovery.controllers.settings import preset_config
from push_recovery.controllers.stage_2.problem import explicit_problem
from push_recovery.controllers.stage_2.standing import StandingPlanner

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)
CONFIG = preset_config("default")
SIDE_BY_SIDE, ASTRIDE = Feet.side_by_side(ROBOT), Feet((0.15, 0.25), 0.4)
TORQUE = ROBOT.trunk_torque_max / ROBOT.trunk_inertia


def row_of(feet, dcm, lean=(0.0, 0.0), rate=(0.0, 0.0)):
    return np.array([*feet.other, feet.turn, *dcm, *lean, *rate])


def oracle(feet, config, dcm, lean, rate):
    """First CoP and trunk acceleration of the program, written out densely and solved as it stands."""
    n = round(config.standing_horizon / config.sampling_time)
    until, free = np.full(n, config.sampling_time), np.tile([[0.0], [-9.0], [9.0]], n)
    axes = []
    for i in range(2):
        state = np.array([dcm[i] - feet.middle[i], lean[i], rate[i], 0.0])
        axes.append(explicit_problem(ROBOT, config, until, n, state, free, (-TORQUE, TORQUE)))
    size, m = axes[0].qp.f.size, axes[0].qp.lower.size
    hull = feet.hull(LIMITS)[:CORNERS]
    H, A = np.zeros((2 * size, 2 * size)), np.zeros((2 * m + CORNERS * n, 2 * size))
    for i, axis in enumerate(axes):
        part = slice(i * size, (i + 1) * size)
        H[part, part], A[i * m : (i + 1) * m, part] = axis.qp.H, axis.qp.A
        for e, edge in enumerate(hull):
            A[2 * m + e * n : 2 * m + (e + 1) * n, i * size : i * size + n] = edge[i] * np.eye(n)
    room = np.repeat(hull[:, OFFSET] - hull[:, :2] @ feet.middle, n)
    qp = QuadraticProgram(
        H,
        np.concatenate([axis.qp.f for axis in axes]),
        A,
        np.concatenate([*(axis.qp.lower for axis in axes), np.full(room.size, -1e3)]),
        np.concatenate([*(axis.qp.upper for axis in axes), room]),
        np.concatenate([*(axis.qp.soft_weight for axis in axes), np.zeros(room.size)]),
    )
    x = solve_qp(qp).x.reshape(2, size)
    return x[:, 0] + feet.middle, x[:, n]


@pytest.mark.parametrize("feet", [SIDE_BY_SIDE, ASTRIDE])
@pytest.mark.parametrize(
    ("offset", "lean", "rate"),
    [
        ((0.001, 0.002), (0.0, 0.0), (0.0, 0.0)),  # within all bounds
        ((0.08, -0.03), (0.1, -0.2), (0.5, 0.0)),
        ((0.12, 0.14), (0.0, 0.0), (0.0, 0.0)),  # at the edges of the hull, with the trunk
        ((-0.15, 0.02), (-0.6, 0.3), (-2.0, 1.0)),
    ],
)
def test_the_plan_is_the_optimum_of_the_program(feet, offset, lean, rate):
    dcm = np.array(feet.middle) + offset
    planned = StandingPlanner(ROBOT, LIMITS, CONFIG).plan_batch(row_of(feet, dcm, lean, rate)[None])[0]
    cop, trunk = oracle(feet, CONFIG, dcm, lean, rate)
    assert planned[:2] == pytest.approx(cop, abs=2e-5)
    assert planned[2:4] == pytest.approx(trunk, abs=2e-3)
    assert planned[6] == 0


def caught(planner, feet, psi, impulse, seconds=5.0, hz=100):
    """DCM from the middle, lean and CoP of a pendulum that a velocity jump hits and the plan catches."""
    w, gain, dt = ROBOT.omega, ROBOT.cmp_per_trunk_acceleration, 1.0 / hz
    grow, lean, rate, trace = math.exp(w * dt), np.zeros(2), np.zeros(2), []
    dcm = feet.middle + impulse / (ROBOT.mass * w) * np.array([math.cos(psi), math.sin(psi)])
    for _ in range(round(seconds * hz)):
        result = planner.plan_batch(row_of(feet, dcm, lean, rate)[None])[0]
        cop, a = result[:2], result[2:4]
        dcm = grow * dcm - (grow - 1.0) * (cop + gain * a)
        lean, rate = lean + dt * rate + 0.5 * dt * dt * a, rate + dt * a
        stopped = (
            np.abs(lean) > ROBOT.trunk_angle_max
        )  # a stop takes the trunk's momentum and gives it to the CoM
        dcm, rate = dcm + stopped * w * gain * rate, np.where(stopped, 0.0, rate)
        lean = np.clip(lean, -ROBOT.trunk_angle_max, ROBOT.trunk_angle_max)
        trace.append([*(dcm - feet.middle), *lean, *cop])
        if np.hypot(*trace[-1][:2]) > 1.0:
            break
    return np.split(np.array(trace), 3, axis=1)


@pytest.mark.parametrize("feet", [SIDE_BY_SIDE, ASTRIDE])
@pytest.mark.parametrize(
    ("cop", "trunk", "share"), [(True, True, 0.97), (True, False, 0.99), (False, True, 0.85)]
)
@pytest.mark.parametrize("psi", [0.0, 0.8, 1.6, 3.5])
def test_it_catches_all_but_a_little_of_the_limit_and_no_more(feet, cop, trunk, share, psi):
    planner = StandingPlanner(ROBOT, LIMITS, CONFIG.replace(use_cop=cop, use_trunk=trunk))
    limit = max_standing_impulse(ROBOT, psi, soles=cop, flywheel=trunk, feet=feet)
    dcm, _, cops = caught(planner, feet, psi, share * limit)
    assert np.abs(dcm[-1]).max() < 2e-3
    hull = feet.hull(LIMITS)
    assert (cops @ hull[:, :2].T <= hull[:, OFFSET] + 1e-12).all()
    fallen, _, _ = caught(planner, feet, psi, 1.06 * limit)  # the stop gives up to 3 % of the trunk
    assert np.hypot(*fallen[-1]) > 1.0


def test_the_trunk_comes_upright_again():
    limit = max_standing_impulse(ROBOT, 0.5)
    _, lean, _ = caught(StandingPlanner(ROBOT, LIMITS, CONFIG), SIDE_BY_SIDE, 0.5, 0.9 * limit)
    assert np.abs(lean).max() > 0.5
    assert np.abs(lean[-1]).max() < 0.05


def test_nothing_moves_at_rest():
    out = StandingPlanner(ROBOT, LIMITS, CONFIG).plan_batch(row_of(ASTRIDE, ASTRIDE.middle)[None])[0]
    assert out.tolist() == [*ASTRIDE.middle, 0.0, 0.0, *ASTRIDE.middle, 0.0]


def test_mirrored_states_have_mirrored_plans_and_a_batch_those_of_its_rows():
    planner = StandingPlanner(ROBOT, LIMITS, CONFIG)
    mirror = np.array([1, -1, -1, 1, -1, 1, -1, 1, -1])
    rows = np.random.default_rng(3).normal(0.0, 0.1, (20, 9)) + row_of(ASTRIDE, ASTRIDE.middle)
    plans = planner.plan_batch(rows)
    assert planner.plan_batch(mirror * rows) == pytest.approx(plans * [1, -1, 1, -1, 1, -1, 1], abs=1e-7)
    alone = np.vstack([copy.copy(planner).plan_batch(row[None]) for row in rows])
    assert alone.tolist() == plans.tolist()


def test_impossible_rows_are_named():
    planner = StandingPlanner(ROBOT, LIMITS, CONFIG)
    with pytest.raises(InvalidValueError, match=r"rows must have shape \(n, 9\), got \(1, 8\)"):
        planner.plan_batch(np.zeros((1, 8)))
    with pytest.raises(InvalidValueError, match="needs finite states"):
        planner.plan_batch(np.full((1, 9), math.nan))
    with pytest.raises(InvalidValueError, match="the CoP margins leave no sole"):
        StandingPlanner(ROBOT, LIMITS, CONFIG.replace(cop_margin_x=0.2))


@pytest.mark.parametrize("offset", [(0.03, -0.02), (0.2, 0.1)])
def test_the_dcm_of_one_interval_is_that_of_a_pendulum_on_the_planned_cop(offset):
    config = CONFIG.replace(use_trunk=False, standing_horizon=0.05)
    dcm, growth = np.array(ASTRIDE.middle) + offset, math.exp(0.05 * ROBOT.omega)
    found = StandingPlanner(ROBOT, LIMITS, config).plan_batch(row_of(ASTRIDE, dcm)[None])[0]
    assert found[4:6] == pytest.approx(growth * dcm - (growth - 1.0) * found[:2], abs=1e-9)


def test_a_waist_without_roll_is_caught_aside_as_one_without_a_trunk():
    limits = GaitLimits.of(RobotModel(trunk_roll=False))
    lacking = StandingPlanner(ROBOT, limits, CONFIG)
    rigid = StandingPlanner(ROBOT, LIMITS, CONFIG.replace(use_trunk=False))
    for aside in (0.03, 0.14, 0.17, -0.16):  # the soles end at 0.15 m
        row = row_of(SIDE_BY_SIDE, (0.0, 0.1 + aside))[None]
        assert lacking.plan_batch(row)[0] == pytest.approx(rigid.plan_batch(row)[0], abs=1e-7)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_gravity_of_a_leaning_trunk_is_taken_from_the_torque_of_the_whole_plan(side, axis):
    """j |a| <= 150 N m less 100 sin(0.5) N m on the side to which the trunk leans away from it."""
    planner = StandingPlanner(ROBOT, LIMITS, CONFIG.replace(trunk_gravity=100.0))
    dcm, lean = np.array(SIDE_BY_SIDE.middle), np.zeros(2)
    dcm[axis], lean[axis] = dcm[axis] - 0.25 * side, 0.5 * side
    planner.plan_batch(row_of(SIDE_BY_SIDE, dcm, lean)[None])
    least = (side * planner._program.plan[axis, planner._cops :]).min()
    assert least == pytest.approx((100.0 * math.sin(0.5) - 150.0) / 8.0, abs=1e-6)


@pytest.mark.parametrize("feet", [SIDE_BY_SIDE, ASTRIDE])
def test_without_a_debt_of_the_trunk_the_plan_is_the_optimum_too(feet):
    config, dcm = CONFIG.replace(trunk_debt=False), np.array(feet.middle) + [0.08, -0.03]
    row = row_of(feet, dcm, (0.1, -0.2), (0.5, 0.0))
    planned = StandingPlanner(ROBOT, LIMITS, config).plan_batch(row[None])[0]
    cop, trunk = oracle(feet, config, dcm, (0.1, -0.2), (0.5, 0.0))
    assert planned[:2] == pytest.approx(cop, abs=2e-5)
    assert planned[2:4] == pytest.approx(trunk, abs=2e-3)
