"""Stage 1 against general solvers, fine grids, optimality conditions, and its equations written out here."""

import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.gait_box import DURATION, STEP, TRUNK, GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, transfer_weight
from push_recovery.controllers.model.observation import (
    COMMAND,
    DCM,
    ELAPSED,
    PREVIOUS_ACTION,
    PUSH_ESTIMATE,
    SWING_POSITION,
    TRUNK_ANGLE,
)
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.qp import QpSolution, solve_qp
from push_recovery.controllers.settings import PlannerConfig, preset_config
from push_recovery.controllers.stage_1 import (
    HELD,
    OFFSET,
    REMAINING,
    ROW_SIZE,
    TARGET,
    StepPlanner,
    StepProblem,
    solve_step,
    step_program,
)

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
    """Multipliers of the rows active at x, by least squares; wrong signs would show in the residual."""
    rows = program.A @ x
    active = (np.abs(rows - program.lower) < 1e-9) | (np.abs(rows - program.upper) < 1e-9)
    dual = np.zeros(len(rows))
    gradient = program.H @ x + program.f
    dual[active] = np.linalg.lstsq(program.A[active].T, -gradient, rcond=None)[0]
    return dual, rows


def test_kkt_conditions_hold(kkt_residual):
    rng = np.random.default_rng(2)
    for _ in range(200):
        p = random_problem(rng)
        plan = solve_step(p)
        program = step_program(p)
        x = np.array([*plan.step, plan.tau, *plan.offset])
        dual, rows = kkt_dual(program, x)
        assert max(kkt_residual(program, QpSolution(x, dual, "solved", 0))[:2]) < 1e-9
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
    "change", [{"gain": (math.nan, 0.0)}, {"step_low": (0.6, 0.1)}, {"tau_low": -1.0}, {"alpha_step": -1.0}]
)
def test_bad_problems_are_refused(change):
    with pytest.raises(InvalidValueError):
        replace(random_problem(np.random.default_rng(5)), **change)


ROBOT, LIMITS = RobotModel(), GaitLimits()
CONFIG = PlannerConfig(foothold="capture_point", push_carry=0.0, freeze=0.0)


def plan(elapsed, dcm, command=(0.0, 0.0), config=CONFIG, swing=(0.0, 0.2)):
    observation = np.zeros(36)
    observation[ELAPSED], observation[DCM], observation[COMMAND] = elapsed, dcm, command
    observation[SWING_POSITION] = *swing, 0.0
    rows = np.zeros((1, ROW_SIZE))
    StepPlanner(ROBOT, LIMITS, config).plan(observation[None], rows)
    return rows[0]


def nominal_dcm(gait, elapsed, delay=0.0):
    """(u + b) exp(-omega (T + delay - t)), (2,)."""
    end = np.array([gait.length + gait.offset_x, gait.width + gait.offset_y])
    return end * math.exp(-ROBOT.omega * (gait.duration + delay - elapsed))


@pytest.mark.parametrize("elapsed", [0.0, 0.2, 0.6])
@pytest.mark.parametrize("command", [(0.0, 0.0), (0.4, 0.0), (-0.2, 0.0), (0.0, -0.1)])
def test_the_capture_points_error_moves_the_foothold_one_for_one_at_any_moment(elapsed, command):
    gait = nominal_gait(ROBOT, LIMITS, command)
    expected = nominal_dcm(gait, elapsed)
    undisturbed = plan(elapsed, expected, command)
    np.testing.assert_allclose(undisturbed[STEP : STEP + 2], [gait.length, gait.width], atol=1e-12)
    np.testing.assert_allclose(undisturbed[OFFSET : OFFSET + 2], gait.offset, atol=1e-12)
    pushed = plan(elapsed, expected + [0.05, -0.03], command)
    np.testing.assert_allclose(pushed[STEP : STEP + 2], [gait.length + 0.05, gait.width - 0.03], atol=1e-12)
    assert pushed[DURATION] == gait.duration
    growth = math.exp(ROBOT.omega * (gait.duration - elapsed))
    left = gait.offset + (growth - 1.0) * np.array([0.05, -0.03])  # what one for one leaves to the next step
    np.testing.assert_allclose(pushed[OFFSET : OFFSET + 2], left, atol=1e-12)


def test_in_place_the_numbers_are_these():
    """l_p 0.2 m, T 0.65 s: half-way xi_nom is 0.2 / (exp(0.325 omega) + exp(-0.325 omega))."""
    half = math.exp(0.325 * math.sqrt(9.81 / ROBOT.com_height))
    row = plan(0.325, (0.1, 0.2 / (half + 1 / half)))
    np.testing.assert_allclose(row[STEP : STEP + 3], [0.1, 0.2, 0.65], atol=1e-12)
    b = -0.2 / (half**2 + 1.0)
    assert row[OFFSET + 1] == pytest.approx(b, abs=1e-12)
    np.testing.assert_allclose(row[TARGET : TARGET + 2], [0.1, 0.2 + b], atol=1e-12)


def test_the_step_stays_in_its_box():
    gait = nominal_gait(ROBOT, LIMITS)
    for error, bounds in (((2.0, 2.0), LIMITS.high), ((-2.0, -2.0), LIMITS.low)):
        row = plan(0.1, nominal_dcm(gait, 0.1) + error)
        assert row[STEP : STEP + 2].tolist() == bounds[:2].tolist()


def test_a_step_that_is_late_ends_a_margin_from_now_and_its_delay_counts():
    config = replace(CONFIG, duration_margin=0.02, touchdown_delay=0.01)
    gait = nominal_gait(ROBOT, LIMITS, touchdown_delay=0.01)
    early = plan(0.3, nominal_dcm(gait, 0.3, 0.01), config=config)
    assert early[DURATION] == gait.duration
    np.testing.assert_allclose(early[STEP : STEP + 2], [0.0, 0.2], atol=1e-12)
    late = plan(0.9, (0.0, 0.1), config=config)
    assert late[DURATION] == pytest.approx(0.92)
    assert late[REMAINING] == pytest.approx(0.03)
    nominal = (0.2 + gait.offset_y) * math.exp(-ROBOT.omega * 0.03)
    assert late[STEP + 1] == pytest.approx(0.2 + 0.1 - nominal, abs=1e-12)


def test_in_double_support_a_foot_that_follows_to_the_end_leaves_the_nominal_g():
    """What the next step grows from is b + c u (`planner`): at touchdown it must be nominal, c = kappa(0)."""
    d = 0.1
    config = replace(preset_config("double-support"), foothold="capture_point", push_carry=0.0)
    gait = nominal_gait(ROBOT, LIMITS, (0.2, 0.0), 0.0, d)
    end = np.array([gait.length + gait.offset_x, gait.width + gait.offset_y])
    row = plan(gait.duration, end + [0.02, 0.01], (0.2, 0.0), config)
    c = 1.0 - (1.0 - math.exp(-ROBOT.omega * d)) / (ROBOT.omega * d)  # kappa(0)
    g = row[OFFSET : OFFSET + 2] + c * row[STEP : STEP + 2]
    np.testing.assert_allclose(g, gait.offset + c * np.array([gait.length, gait.width]), atol=1e-12)


def test_another_foothold_is_refused_and_the_nearest_named():
    message = r"unknown PlannerConfig\.foothold 'capture'; did you mean 'capture_point'\?"
    with pytest.raises(UnknownNameError, match=message):
        PlannerConfig(foothold="capture")  # pyright: ignore[reportArgumentType]


def row_of(observation: np.ndarray, config: PlannerConfig, adapt: bool = True) -> np.ndarray:
    """The row (ROW_SIZE,) of one observation (36,)."""
    rows = np.zeros((1, ROW_SIZE))
    StepPlanner(ROBOT, LIMITS, config, adapt).plan(observation[None], rows)
    return rows[0]


@pytest.mark.parametrize("elapsed", [0.38, 0.45])  # before and after the time that was planned
def test_a_step_that_is_held_ends_where_its_dcm_drifts_to(elapsed):
    """b = (xi - 0) exp(omega (T + delay - t)) - u; a step that is late ends now."""
    config = PlannerConfig(freeze=0.05, touchdown_delay=0.02, trunk_debt=False)
    observation = np.zeros(36)
    asked = np.array([0.1, 0.25, 0.4, 0.0, 0.0, 0.0, 0.0])
    observation[PREVIOUS_ACTION] = LIMITS.to_action(asked)
    observation[ELAPSED], observation[DCM] = elapsed, (0.12, 0.2)
    row = row_of(observation, config)
    assert row[HELD] == 1.0
    np.testing.assert_allclose(row[STEP : STEP + 3], asked[:3], atol=1e-6)
    growth = math.exp(ROBOT.omega * (max(0.4 - elapsed, 0.0) + 0.02))
    np.testing.assert_allclose(
        row[OFFSET : OFFSET + 2], growth * np.array([0.12, 0.2]) - asked[:2], atol=1e-5
    )
    assert row[REMAINING] == pytest.approx(max(0.4 - elapsed, 0.0) + 0.02, abs=1e-6)


@pytest.mark.parametrize(
    ("dcm", "push", "held"),
    [
        ((0.05, 0.12), 0.0, True),
        ((0.05, 0.12), 0.03, False),  # the best step is some 0.65 s long, as the nominal one is
        ((0.9, 0.9), 0.03, True),  # the best step is over at once, and so is one that is reopened
    ],
)
def test_a_push_reopens_an_ending_step_for_one_that_does_not_end_at_once(dcm, push, held):
    config = PlannerConfig(freeze=0.05, push_carry=0.1, push_threshold=0.02, trunk_debt=False)
    observation, asked = np.zeros(36), np.array([0.1, 0.25, 0.4, 0.0, 0.0, 0.0, 0.0])
    observation[PREVIOUS_ACTION] = LIMITS.to_action(asked)
    observation[ELAPSED], observation[DCM], observation[PUSH_ESTIMATE.start] = 0.38, dcm, push
    row, free = row_of(observation, config), row_of(observation, replace(config, freeze=0.0))
    assert row[HELD] == held
    expected = asked[:3] if held else free[STEP : STEP + 3]
    np.testing.assert_allclose(row[STEP : STEP + 3], expected, atol=1e-6)
    assert np.abs(asked[:3] - free[STEP : STEP + 3]).max() > 0.05


def test_the_trunk_is_asked_upright_within_its_box_on_either_side():
    """tau = -k a - d rate, bounded: leaning to one side and to the other give opposite answers."""
    config = PlannerConfig()
    for lean in (-3.0, -0.01, 0.01, 3.0):
        observation = np.zeros(36)
        observation[TRUNK_ANGLE] = lean, -lean
        wanted = -config.upright_stiffness * lean
        low, high = LIMITS.box[:, TRUNK]
        row = row_of(observation, config)
        assert row[TRUNK] == pytest.approx(min(max(wanted, low), high))
        assert row[TRUNK + 1] == pytest.approx(min(max(-wanted, low), high))


def test_only_a_push_beyond_its_threshold_is_carried_on():
    config = PlannerConfig(push_carry=0.1, push_threshold=0.2)
    quiet, below, above = np.zeros((3, 36))
    for observation in (quiet, below, above):
        observation[DCM] = 0.02, 0.1
    below[PUSH_ESTIMATE], above[PUSH_ESTIMATE] = (0.12, 0.15), (0.13, 0.16)  # 0.192 and 0.206 m
    assert row_of(below, config).tobytes() == row_of(quiet, config).tobytes()
    assert abs(row_of(above, config)[STEP] - row_of(quiet, config)[STEP]) > 1e-3


def test_in_double_support_the_step_keeps_its_price():
    """Stage 1 solves for v = u (1 - c) and g = b + c u, and alpha_step prices u itself."""
    d = 0.1
    config = replace(preset_config("double-support"), alpha_step=50.0, alpha_offset=5.0)
    assert config.double_support == d
    observation = np.zeros(36)
    observation[ELAPSED], observation[DCM], observation[COMMAND] = 0.05, (0.03, 0.16), (0.2, 0.0)
    observation[SWING_POSITION] = -0.1, 0.2, 0.0
    row = row_of(observation, config)
    nominal = nominal_gait(ROBOT, LIMITS, (0.2, 0.0), 0.0, d)
    c, now = transfer_weight(0.0, d, ROBOT.omega), transfer_weight(0.05, d, ROBOT.omega)
    reach = 1.0 - c
    gain = (observation[DCM] - now * observation[SWING_POSITION][:2]) * math.exp(-ROBOT.omega * 0.05)
    step = np.array([nominal.length, nominal.width])
    offset = nominal.offset + c * step
    exact = solve_step(
        StepProblem(
            gain=(gain[0], gain[1]),
            step_nominal=(reach * step[0], reach * step[1]),
            tau_nominal=math.exp(ROBOT.omega * nominal.duration),
            offset_nominal=(offset[0], offset[1]),
            step_low=(reach * LIMITS.length_min, reach * LIMITS.width_min),
            step_high=(reach * LIMITS.length_max, reach * LIMITS.width_max),
            tau_low=math.exp(ROBOT.omega * LIMITS.duration_min),
            tau_high=math.exp(ROBOT.omega * LIMITS.duration_max),
            alpha_step=50.0 / reach**2,
            alpha_duration=config.alpha_duration,
            alpha_offset=5.0,
        )
    )
    found = np.array(exact.step) / reach
    assert abs(found[0] - nominal.length) > 0.01  # the price is felt
    np.testing.assert_allclose(row[STEP : STEP + 2], found, atol=1e-9)
    assert row[DURATION] == pytest.approx(exact.duration(ROBOT.omega), abs=1e-9)
    np.testing.assert_allclose(row[OFFSET : OFFSET + 2], np.array(exact.offset) - c * found, atol=1e-9)
    np.testing.assert_allclose(
        row[TARGET : TARGET + 2], found + nominal.offset + c * (step - found), atol=1e-9
    )


def test_a_swing_foot_that_cannot_be_in_time_gets_the_longest_step():
    """With hardly any acceleration every place needs longer than T_max, which stays the bound."""
    observation = np.zeros(36)
    observation[DCM], observation[SWING_POSITION] = (0.2, 0.25), (-0.5, 0.3, 0.0)
    row = row_of(observation, PlannerConfig(swing_acceleration=0.5))
    assert row[DURATION] == pytest.approx(LIMITS.duration_max, abs=1e-9)
    late = observation.copy()
    late[ELAPSED] = LIMITS.duration_max + 0.1
    assert row_of(late, PlannerConfig(swing_acceleration=0.5))[DURATION] == pytest.approx(
        LIMITS.duration_max + 0.1, abs=1e-9
    )


def test_without_adaptation_every_state_gets_the_nominal_gait():
    observation = np.zeros(36)
    observation[DCM], observation[COMMAND], observation[ELAPSED] = (0.4, -0.3), (0.3, 0.05), 0.2
    row, nominal = (
        row_of(observation, PlannerConfig(), adapt=False),
        nominal_gait(ROBOT, LIMITS, (0.3, 0.05)),
    )
    np.testing.assert_array_equal(row[STEP : STEP + 3], [nominal.length, nominal.width, nominal.duration])
    np.testing.assert_array_equal(row[OFFSET : OFFSET + 2], nominal.offset)
    assert row[REMAINING] == nominal.duration - 0.2


@pytest.mark.parametrize(
    ("elapsed", "duration"), [(0.1, 0.65), (0.6, 0.65), (0.64, 0.66), (0.9, 0.92), (1.2, 1.22)]
)
def test_a_fixed_time_that_is_past_ends_a_margin_from_now(elapsed, duration):
    observation = np.zeros(36)
    observation[ELAPSED], observation[DCM] = elapsed, (0.02, 0.1)
    row = row_of(observation, PlannerConfig(adapt_duration=False, duration_margin=0.02))
    assert row[DURATION] == pytest.approx(duration, abs=1e-9)


def test_with_a_fixed_place_only_the_time_answers():
    """alpha_2 (tau - tau_nom) + alpha_3 a . (a tau - u_nom - b_nom) = 0 at the best tau."""
    config = PlannerConfig(adapt_step=False, alpha_duration=2.0, alpha_offset=300.0)
    observation = np.zeros(36)
    observation[ELAPSED], observation[DCM], observation[COMMAND] = 0.1, (0.05, 0.08), (0.2, 0.0)
    row, gait = row_of(observation, config), nominal_gait(ROBOT, LIMITS, (0.2, 0.0))
    a = observation[DCM] * math.exp(-0.1 * ROBOT.omega)
    end = np.array([gait.length, gait.width]) + gait.offset
    tau = (2.0 * math.exp(ROBOT.omega * gait.duration) + 300.0 * a @ end) / (2.0 + 300.0 * a @ a)
    np.testing.assert_allclose(row[STEP : STEP + 2], [gait.length, gait.width], atol=1e-12)
    assert row[DURATION] == pytest.approx(math.log(tau) / ROBOT.omega, abs=1e-9)  # 0.5653 s


def test_an_offset_that_costs_nothing_leaves_place_and_time_nominal():
    problem = random_problem(np.random.default_rng(8), alpha_offset=0.0)
    found = solve_step(problem)
    assert found.step == pytest.approx(problem.step_nominal)
    assert found.tau == pytest.approx(problem.tau_nominal)


def test_in_the_transfer_an_undisturbed_capture_step_is_nominal():
    """The CoP is on its way from the other foot: the DCM is kappa of that way behind the one of a step."""
    whole, t, place, omega = 0.1, 0.04, np.array([-0.15, 0.22]), ROBOT.omega
    config = replace(preset_config("double-support"), foothold="capture_point", push_carry=0.0)
    gait = nominal_gait(ROBOT, LIMITS, (0.2, 0.0), 0.0, whole)
    left = whole - t
    kappa = left / whole - (1.0 - math.exp(-omega * left)) / (omega * whole)
    row = plan(t, nominal_dcm(gait, t) + kappa * place, (0.2, 0.0), config, swing=place)
    np.testing.assert_allclose(row[STEP : STEP + 2], [gait.length, gait.width], atol=1e-12)
    np.testing.assert_allclose(row[OFFSET : OFFSET + 2], gait.offset, atol=1e-12)


def test_where_no_time_is_better_the_nominal_one_is_taken():
    """An error of nothing and no price of the time: every tau in the range costs the same."""
    p = replace(random_problem(np.random.default_rng(1)), gain=(0.0, 0.0), alpha_duration=0.0)
    for nominal in (2.0, 9.0, 40.0):
        box = replace(p, tau_low=3.0, tau_high=30.0, tau_nominal=nominal)
        assert solve_step(box).tau == min(max(nominal, 3.0), 30.0)
