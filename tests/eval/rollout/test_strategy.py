"""Ankles, hips or a step: of observations written by hand, and of robots that are pushed."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.observation import DCM, ELAPSED, SWING_POSITION, TRUNK_ANGLE, TRUNK_RATE
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import AT_REST, Scenario
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.rollout.strategy import StrategyMeter, strategy_of

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)
SWING = 0.0, 0.2
SIDE = LIMITS.cop_y_max + 0.1  # of the hull of both soles, from the middle at y = 0.1 m


def trunk_gives() -> float:
    """The closed form of an upright trunk: (tau / m g) (1 - exp(-omega t))^2, t = sqrt(theta j / tau)."""
    time = math.sqrt(ROBOT.trunk_angle_max * ROBOT.trunk_inertia / ROBOT.trunk_torque_max)
    arm = ROBOT.trunk_torque_max / (ROBOT.mass * 9.81)
    return arm * (1.0 - math.exp(-ROBOT.omega * time)) ** 2


@pytest.fixture
def stander():
    """A meter of two robots, and a function that writes where one of them is."""
    core = SimpleNamespace(truth=np.zeros((2, 36)), command=np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)))

    def put(k, dcm, elapsed=-1.0, lean=0.0):
        core.truth[k, ELAPSED], core.truth[k, DCM], core.truth[k, TRUNK_ANGLE] = elapsed, dcm, (lean, 0.0)
        core.truth[k, SWING_POSITION][:2] = SWING

    put(0, (0.0, 0.1))
    put(1, (0.0, 0.1))
    meter = StrategyMeter(SimpleNamespace(n=2, core=core, robot=ROBOT, limits=LIMITS))
    meter.begin(0)
    meter.begin(1)
    return meter, put, core


def test_the_ankles_hold_what_stays_over_the_soles(stander):
    meter, put, _ = stander
    for dcm in ((0.02, 0.1), (0.9 * LIMITS.cop_x_max, 0.0), (0.0, 0.1 - 0.9 * SIDE)):
        put(0, dcm)
        meter.look()
    assert meter.strategy(0) == "ankle"
    assert meter.stance.soles[0] == pytest.approx(min(0.1 * LIMITS.cop_x_max, 0.1 * SIDE))


@pytest.mark.parametrize(
    ("dcm", "beyond"),
    [
        ((LIMITS.cop_x_max + 0.01, 0.1), 0.01),
        ((0.0, 0.1 + SIDE + 0.02), 0.02),
        ((-LIMITS.cop_x_max - 0.03, 0.1), 0.03),
    ],
)
def test_the_hips_hold_what_leaves_them(stander, dcm, beyond):
    meter, put, _ = stander
    put(1, dcm)
    meter.look()
    put(1, (0.0, 0.1))  # back again
    meter.look()
    assert (meter.strategy(0), meter.strategy(1)) == ("ankle", "hip")
    assert meter.stance.soles[1] == pytest.approx(-beyond)


def test_what_the_trunk_has_taken_over_counts(stander):
    """A trunk that leans by theta and turns at theta' gives the DCM back j / (m g) (w theta' + w^2 theta)."""
    meter, put, core = stander
    lean, rate, omega = 0.2, 0.5, ROBOT.omega
    given = ROBOT.trunk_inertia / (ROBOT.mass * 9.81) * (omega * rate + omega**2 * lean)
    put(0, (0.0, 0.1), lean=lean)
    core.truth[0, TRUNK_RATE] = rate, 0.0
    meter.look()
    assert meter.stance.soles[0] == pytest.approx(LIMITS.cop_x_max - given)
    put(1, (0.0, 0.1))
    core.truth[1, TRUNK_ANGLE], core.truth[1, TRUNK_RATE] = (0.0, -lean), (0.0, -rate)
    meter.look()
    assert meter.stance.soles[1] == pytest.approx(min(LIMITS.cop_x_max, SIDE - given))


@pytest.mark.parametrize("past", [-0.02, 0.02])
def test_a_step_is_needless_where_the_trunk_could_still_have_caught_the_dcm(stander, past):
    """Of the DCM at the end of the period before, on which the step was decided."""
    meter, put, _ = stander
    put(0, (LIMITS.cop_x_max + trunk_gives() + past, 0.1))
    meter.look()
    put(0, (0.0, 0.1), elapsed=0.0)
    meter.look()
    assert meter.strategy(0) == "step"
    assert meter.stance.lift_off[0] == pytest.approx(-past)
    put(0, (0.0, 0.1), elapsed=0.3)
    meter.look()
    assert meter.stance.lift_off[0] == pytest.approx(-past)


def test_the_most_needless_lift_off_counts_and_a_new_episode_forgets_it(stander):
    meter, put, _ = stander
    for place in (0.3, 0.0, 0.3):
        put(0, (place, 0.1))
        meter.look()
        put(0, (place, 0.1), elapsed=0.0)
        meter.look()
    assert meter.stance.lift_off[0] == pytest.approx(LIMITS.cop_x_max + min(trunk_gives(), SIDE), abs=0.2)
    assert meter.stance.lift_off[0] > 0.0
    put(0, (0.0, 0.1))
    meter.begin(0)
    assert (meter.strategy(0), meter.stance.lift_off[0]) == ("ankle", -math.inf)


def test_a_robot_that_is_told_to_walk_takes_no_strategy(stander):
    meter, put, core = stander
    core.command[:, 3] = 0.0
    put(0, (0.0, 0.1))
    meter.look()
    put(0, (0.0, 0.1), elapsed=0.1)
    meter.look()
    assert meter.stance.lift_off[0] == -math.inf
    meter.begin(1)
    assert meter.strategy(1) is None


def test_measures_name_the_strategy():
    assert strategy_of(None, None) is None
    assert strategy_of(0.01, None) == "ankle"
    assert strategy_of(-0.01, None) == "hip"
    assert strategy_of(0.01, 0.02) == strategy_of(-0.3, -0.1) == "step"


@pytest.mark.parametrize(("share", "strategy"), [(0.35, "ankle"), (0.8, "hip"), (1.2, "step")])
def test_harder_pushes_take_more(share, strategy):
    """Forward, of F*_stand of 450 N, of which the soles alone catch 249 N; what walks has no such measure."""
    with make_env("PushRecovery/Pendulum-v0@paper") as env:
        policy = load_policy("two-stage", env)
        push = Push((share * 450.0, 0.0, 0.0), 0.1, 0.5)
        measures = rollout(env, policy, Scenario("pushed", (push,), AT_REST), "two-stage").measures
        walked = rollout(env, policy, Scenario("pushed", (push,), duration=1.0), "two-stage").measures
    assert strategy_of(measures["soles_margin"], measures["lift_off_margin"]) == strategy
    assert (measures["soles_margin"] < 0.0) == (share > 249.0 / 450.0)
    assert measures["lift_off_margin"] is None or measures["lift_off_margin"] < 0.0
    assert "soles_margin" not in walked
