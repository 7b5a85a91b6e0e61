"""The prediction against the motion itself: cubics pieced together, feet added up.

Linear MPC against the problem written down a second time, in metres and seconds, and solved by others.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError
from push_recovery.controllers.model import observation as columns
from push_recovery.controllers.model.gait_box import COP, DURATION, STEP, GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, nominal_start
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies import linear_mpc
from push_recovery.controllers.policies.two_stage import TwoStagePolicy, make_policy
from push_recovery.controllers.qp import QpSolution, solve_qp
from push_recovery.controllers.settings import PlannerConfig
from push_recovery.controllers.stage_1 import DCM_END, OFFSET, ROW_SIZE, TARGET, StepPlanner
from push_recovery.controllers.stage_1 import REMAINING as PLAN_REMAINING
from scipy.optimize import minimize

OMEGA, REMAINING, PERIOD = 3.5, 0.13, 0.4


def motion(values):
    """CoP less foot, CoM velocity and time of every node, from x, x', x'' and x''' in metres and seconds."""
    x, speed, time, foot = values[linear_mpc.POSITION], OMEGA * values[linear_mpc.RATE], 0.0, 0.0
    nodes = []
    for step in range(linear_mpc.STEPS):
        acceleration = OMEGA**2 * values[linear_mpc.ACCELERATION + step]
        foot += values[linear_mpc.FOOT + step - 1] if step else 0.0
        nodes.append((x - acceleration / OMEGA**2 - foot, speed, time))
        for interval in range(linear_mpc.SAMPLES):
            d = (REMAINING, PERIOD, PERIOD)[step] / linear_mpc.SAMPLES
            jerk = OMEGA**3 * values[linear_mpc.JERK + step * linear_mpc.SAMPLES + interval]
            path = np.poly1d([jerk / 6.0, acceleration / 2.0, speed, x])
            x, speed, acceleration = (np.polyval(np.polyder(path, m), d) for m in range(3))
            time += d
            nodes.append((x - acceleration / OMEGA**2 - foot, speed, time))
    return np.array(nodes)


@pytest.fixture
def predicted():
    cop, rate, spans = (
        np.empty((linear_mpc.NODES, linear_mpc.COLUMNS)),
        np.empty((linear_mpc.NODES, linear_mpc.COLUMNS)),
        np.empty(linear_mpc.NODES),
    )
    linear_mpc.predict(REMAINING, PERIOD, OMEGA, cop, rate, spans)
    return cop, rate, spans


def test_nodes_are_those_of_the_motion(predicted):
    cop, rate, _ = predicted
    rng = np.random.default_rng(4)
    for _ in range(5):
        values = rng.normal(size=linear_mpc.COLUMNS)
        nodes = motion(values)
        np.testing.assert_allclose(cop @ values, nodes[:, 0], atol=1e-10)
        np.testing.assert_allclose(OMEGA * (rate @ values), nodes[:, 1], atol=1e-10)


def test_spans_integrate_by_the_trapezoid_rule(predicted):
    *_, spans = predicted
    time = motion(np.zeros(linear_mpc.COLUMNS))[:, 2]
    assert spans.sum() == pytest.approx(REMAINING + 2.0 * PERIOD, abs=1e-12)
    for values in (time, time**2):
        assert spans @ values == pytest.approx(np.trapezoid(values, time), abs=1e-12)


ROBOT, LIMITS = RobotModel(), replace(GaitLimits(), duration_max=0.6)
OMEGA_LINEAR_MPC, DELAY = ROBOT.omega, 0.02
CONFIG = PlannerConfig(
    foothold="linear_mpc", use_cop=False, use_trunk=False, mpc_velocity=0.15, mpc_step=0.05,
    mpc_jerk=5e-6, touchdown_delay=DELAY, cop_margin_x=0.01, cop_margin_y=0.005,
)  # fmt: skip
PUSHES = [(0.0, 0.0), (0.03, 0.02), (0.12, -0.03), (-0.2, 0.15), (0.02, -0.12)]


def nominal_motion(elapsed, command):
    """CoM and its velocity of the nominal gait, carried on from the start of the step, (2,) each."""
    gait = nominal_gait(ROBOT, LIMITS, command, DELAY)
    start = nominal_start(gait, ROBOT.pelvis_width, OMEGA_LINEAR_MPC, DELAY)
    c, s = math.cosh(OMEGA_LINEAR_MPC * elapsed), math.sinh(OMEGA_LINEAR_MPC * elapsed)
    com, speed = start.com, start.com_velocity
    return com * c + speed * s / OMEGA_LINEAR_MPC, com * OMEGA_LINEAR_MPC * s + speed * c


def observe(elapsed, command=(0.0, 0.0), dcm=(0.0, 0.0), com=(0.0, 0.0)):
    """The nominal gait with the DCM and the CoM moved [m]."""
    observation = np.zeros(36)
    position, speed = nominal_motion(elapsed, command)
    position, dcm = position + com, position + speed / OMEGA_LINEAR_MPC + dcm
    observation[columns.ELAPSED], observation[columns.COMMAND], observation[columns.COM] = (
        elapsed,
        command,
        position,
    )
    observation[columns.DCM], observation[columns.COM_VELOCITY] = dcm, OMEGA_LINEAR_MPC * (dcm - position)
    return observation


def rows_of(observation, config=CONFIG, limits=LIMITS, robot=ROBOT):
    rows = np.zeros((1, ROW_SIZE))
    StepPlanner(robot, limits, config).plan(observation[None], rows)
    linear_mpc.LinearMpc(robot, limits, config).regulate(observation[None], rows)
    return rows[0]


class Written:
    """The program of one axis once more, in SI units.

    Unknowns y: accelerations at the beginning of the steps, jerks and footsteps off the nominal gait.
    """

    def __init__(self, elapsed, command, axis, moved_com, moved_dcm):
        sides = [nominal_gait(ROBOT, LIMITS, (command[0], side * command[1]), DELAY) for side in (1, -1)]
        steps = [(gait.length, gait.width)[axis] for gait in sides]
        low, high = LIMITS.low[STEP + axis], LIMITS.high[STEP + axis]
        self.x, self.speed = moved_com[axis], OMEGA_LINEAR_MPC * (moved_dcm[axis] - moved_com[axis])
        self.lengths = [
            sides[0].duration + DELAY - elapsed,
            *[sides[0].duration + DELAY] * (linear_mpc.STEPS - 1),
        ]
        self.bounds = [(low - steps[0], high - steps[0]), (low - steps[1], high - steps[1])]
        if axis:  # the second step goes the other way
            self.bounds[1] = (steps[1] - high, steps[1] - low)
        self.sole = (LIMITS.cop_x_max - CONFIG.cop_margin_x, LIMITS.cop_y_max - CONFIG.cop_margin_y)[axis]

    def simulate(self, y):
        """Cost, and CoP less foot at every node."""
        starts, jerks, steps = y[: linear_mpc.STEPS], y[linear_mpc.STEPS : -2], y[-2:]
        x, speed, foot, cops = self.x, self.speed, 0.0, []
        cost = CONFIG.mpc_step * (steps[0] ** 2 + steps[1] ** 2)
        for step, length in enumerate(self.lengths):
            foot += 0.0 if step == 0 else steps[step - 1]
            d, acceleration, nodes = length / linear_mpc.SAMPLES, starts[step], []
            for jerk in [*jerks[step * linear_mpc.SAMPLES : (step + 1) * linear_mpc.SAMPLES], None]:
                cops.append(x - acceleration / OMEGA_LINEAR_MPC**2 - foot)
                nodes.append(CONFIG.mpc_velocity * speed**2 + cops[-1] ** 2)
                if jerk is not None:
                    x += speed * d + acceleration * d**2 / 2 + jerk * d**3 / 6
                    speed += acceleration * d + jerk * d**2 / 2
                    acceleration += jerk * d
                    cost += CONFIG.mpc_jerk * jerk**2 * d
            cost += np.trapezoid(nodes, dx=d)
        return cost, np.array(cops)

    def solve(self):
        """The solution, by SLSQP in the units of the CoP."""
        unit = np.array(
            [OMEGA_LINEAR_MPC**2] * linear_mpc.STEPS
            + [OMEGA_LINEAR_MPC**3] * (linear_mpc.STEPS * linear_mpc.SAMPLES)
            + [1.0] * 2
        )
        loose = [(None, None)] * (len(unit) - 2)
        inside = [
            {"type": "ineq", "fun": lambda v, sign=sign: self.sole - sign * self.simulate(v * unit)[1]}
            for sign in (1.0, -1.0)
        ]
        found = minimize(
            lambda v: 1e2 * self.simulate(v * unit)[0], np.zeros(len(unit)), method="SLSQP",
            bounds=[*loose, *self.bounds], constraints=inside, options={"ftol": 1e-15, "maxiter": 500},
        )  # fmt: skip
        return found.x * unit


@pytest.mark.parametrize("command", [(0.0, 0.0), (0.4, 0.1), (-0.2, -0.1)])
@pytest.mark.parametrize("elapsed", [0.0, 0.15, 0.4])
def test_the_nominal_gait_is_kept(elapsed, command):
    gait = nominal_gait(ROBOT, LIMITS, command, DELAY)
    row = rows_of(observe(elapsed, command))
    np.testing.assert_allclose(row[STEP : DURATION + 1], [gait.length, gait.width, gait.duration], atol=1e-12)
    np.testing.assert_allclose(row[COP : COP + 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(row[OFFSET : OFFSET + 2], gait.offset, atol=1e-12)


@pytest.mark.parametrize("dcm", PUSHES)
@pytest.mark.parametrize(("elapsed", "command"), [(0.05, (0.0, 0.0)), (0.3, (0.3, 0.1))])
def test_place_and_cop_are_those_of_the_problem_written_down(elapsed, command, dcm):
    com = (0.4 * dcm[0], 0.2 * dcm[1])
    row = rows_of(observe(elapsed, command, dcm, com))
    gait = nominal_gait(ROBOT, LIMITS, command, DELAY)
    for axis, nominal in enumerate((gait.length, gait.width)):
        written = Written(elapsed, command, axis, com, dcm)
        y = written.solve()
        assert row[STEP + axis] - nominal == pytest.approx(y[-2], abs=2e-5)
        assert row[COP + axis] == pytest.approx(written.simulate(y)[1][0], abs=2e-5)


def test_these_pushes_meet_every_kind_of_bound():
    """Otherwise the comparison above would say nothing of bounds."""
    met = set()
    for dcm in PUSHES:
        for axis in range(2):
            written = Written(0.05, (0.0, 0.0), axis, (0.4 * dcm[0], 0.2 * dcm[1]), dcm)
            y = written.solve()
            met |= {"sole"} if np.abs(written.simulate(y)[1]).max() > written.sole - 1e-6 else set()
            for step, (value, bounds) in enumerate(zip(y[-2:], written.bounds, strict=True)):
                met |= {(axis, step, end) for end in range(2) if abs(value - bounds[end]) < 1e-6}
    assert met >= {"sole", (0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 0), (1, 1, 1)}


@pytest.mark.parametrize("dcm", PUSHES)
def test_solutions_are_optimal_and_solvers_agree(dcm, kkt_residual):
    observation = observe(0.2, dcm=dcm)
    rows = np.zeros((1, ROW_SIZE))
    StepPlanner(ROBOT, LIMITS, CONFIG).plan(observation[None], rows)
    mpc = linear_mpc.LinearMpc(ROBOT, LIMITS, CONFIG)
    for axis in range(2):
        program = mpc.program(observation, rows[0], axis, mpc.horizon(float(rows[0, PLAN_REMAINING]), 0.45))
        np.testing.assert_allclose(program.H, program.H.T, atol=1e-12)
        solution = solve_qp(program)
        assert max(kkt_residual(program, solution)) < 1e-8
        np.testing.assert_allclose(solve_qp(program, "osqp").x, solution.x, atol=1e-4)


def test_forward_and_backward_are_mirror_images():
    for dcm in PUSHES:
        one, other = rows_of(observe(0.1, dcm=dcm)), rows_of(observe(0.1, dcm=(-dcm[0], dcm[1])))
        for column in (STEP, COP, OFFSET, DCM_END, TARGET):
            assert one[column] == pytest.approx(-other[column], abs=1e-9)
            assert one[column + 1] == other[column + 1]


def test_all_lengths_scale_with_the_robot():
    """Twice the lengths and sqrt(2) times the times are the same problem: the units are in order."""
    lengths = {"com_height": 1.6, "pelvis_width": 0.4, "foot_length": 0.4, "foot_width": 0.2}
    robot, t = replace(ROBOT, **lengths), math.sqrt(2.0)
    limits = replace(
        LIMITS, length_min=-1.0, length_max=1.0, width_min=0.2, width_max=0.8, duration_min=0.3 * t,
        duration_max=0.6 * t, cop_x_max=0.2, cop_y_max=0.1,
    )  # fmt: skip
    config = replace(
        CONFIG, mpc_velocity=CONFIG.mpc_velocity * t**2, mpc_jerk=CONFIG.mpc_jerk * t**6,
        mpc_step=CONFIG.mpc_step * t, touchdown_delay=DELAY * t, cop_margin_x=0.02, cop_margin_y=0.01,
    )  # fmt: skip
    for dcm in PUSHES:
        small = observe(0.1, dcm=dcm)
        large = 2.0 * small
        large[columns.ELAPSED], large[columns.COM_VELOCITY] = 0.1 * t, small[columns.COM_VELOCITY] * t
        one, two = rows_of(small), rows_of(large, config, limits, robot)
        np.testing.assert_allclose(two[STEP : STEP + 2], 2.0 * one[STEP : STEP + 2], atol=1e-8)
        np.testing.assert_allclose(two[COP : COP + 2], 2.0 * one[COP : COP + 2], atol=1e-8)


def test_the_dcm_at_touchdown_is_that_of_the_cop_held_until_then():
    observation = observe(0.2, dcm=(0.03, 0.02))
    row = rows_of(observation)
    cop, growth = row[COP : COP + 2], math.exp(OMEGA_LINEAR_MPC * row[PLAN_REMAINING])
    np.testing.assert_allclose(
        row[DCM_END : DCM_END + 2], cop + (observation[columns.DCM] - cop) * growth, atol=1e-12
    )
    np.testing.assert_allclose(row[OFFSET : OFFSET + 2], row[DCM_END : DCM_END + 2] - row[STEP : STEP + 2])


def test_a_held_step_stays_and_the_cop_does_not():
    config = replace(CONFIG, freeze=0.05)
    gait = nominal_gait(ROBOT, LIMITS, touchdown_delay=DELAY)
    observation = observe(gait.duration - 0.03, dcm=(0.04, 0.0))
    before = np.array([0.1, 0.25, gait.duration, 0.0, 0.0, 0.0, 0.0])
    observation[columns.PREVIOUS_ACTION] = LIMITS.to_action(before)
    row = rows_of(observation, config)
    np.testing.assert_allclose(row[STEP : DURATION + 1], before[:3], atol=1e-7)
    assert abs(row[COP]) > 0.01
    assert row[TARGET] == pytest.approx(row[STEP] + gait.offset_x, abs=1e-12)


def test_the_variant_has_a_fixed_time_and_an_upright_trunk():
    variant = make_policy("herdt", preset="biped")
    assert isinstance(variant, TwoStagePolicy)
    observation = observe(0.1, dcm=(0.1, 0.05))
    nominal = nominal_gait(variant.robot, variant.limits, touchdown_delay=variant.config.touchdown_delay)
    batch = np.stack([observation, observe(0.2), observation])
    plan, actions = variant.plan(observation), variant.predict(batch)[0]
    assert plan.duration == nominal.duration
    assert plan.status == "solved"
    assert (plan.trunk_acceleration == 0.0).all()
    np.testing.assert_array_equal(actions[0], actions[2])
    np.testing.assert_array_equal(actions[0], variant.predict(observation)[0])


def test_double_support_is_refused():
    with pytest.raises(
        InvalidValueError, match=r"^linear MPC plans no double support, got 0.1 s; set double"
    ):
        make_policy("herdt", preset="double-support")


def test_the_footstep_of_a_held_step_is_no_choice():
    config = replace(CONFIG, freeze=0.05)
    duration = nominal_gait(ROBOT, LIMITS, touchdown_delay=DELAY).duration
    seen, rows = observe(duration - 0.03), np.zeros((1, ROW_SIZE))
    seen[columns.PREVIOUS_ACTION] = LIMITS.to_action(np.array([0.1, 0.25, duration, 0, 0, 0, 0]))
    StepPlanner(ROBOT, LIMITS, config).plan(seen[None], rows)
    mpc = linear_mpc.LinearMpc(ROBOT, LIMITS, config)
    for axis, off in enumerate((0.1, 0.05)):  # from the nominal place: 0.1 - 0, 0.25 - 0.2
        qp = mpc.program(seen, rows[0], axis, mpc.horizon(0.05, duration + DELAY))
        row = linear_mpc.NODES
        assert (qp.lower[row], qp.upper[row]) == pytest.approx((off, off), abs=1e-6)


def test_the_first_interval_is_no_shorter_than_its_least():
    mpc = linear_mpc.LinearMpc(ROBOT, LIMITS, CONFIG)
    none, least = mpc.horizon(0.0, 0.45), mpc.horizon(CONFIG.first_interval_min, 0.45)
    for mine, theirs in zip(none, least, strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_a_program_that_is_not_solved_gives_no_plan(monkeypatch):
    def gives_up(problem, solver):
        nothing = np.full(problem.f.size, np.nan), np.full(problem.lower.size, np.nan)
        return QpSolution(*nothing, "failed", 0)

    monkeypatch.setattr(linear_mpc, "solve_qp", gives_up)
    with pytest.raises(PushRecoveryError, match="the program of axis 0 is failed"):
        rows_of(observe(0.2, dcm=(0.03, 0.02)))
