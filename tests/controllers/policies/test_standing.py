"""When a standing robot may stay, against the closed form of the margin in place."""

import math

import numpy as np
import pytest
from push_recovery.controllers.model.gait_box import COP, GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm
from push_recovery.controllers.model.observation import (
    COM,
    COMMAND,
    DCM,
    PUSH_ESTIMATE,
    SWING_CONTACT,
    SWING_POSITION,
    TRUNK_ANGLE,
    TRUNK_RATE,
)
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.model.standing import (
    HULL_COLUMNS,
    HULL_ROWS,
    Feet,
    standing_margin,
)
from push_recovery.controllers.policies.standing import margin_in_place, was_thrown
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.stage_1 import OFFSET, ROW_SIZE


@pytest.mark.parametrize(
    ("variant", "soles", "flywheel"),
    [("two-stage", True, True), ("stage-1+cop", True, False), ("stage-1+momentum", False, True)],
)
def test_the_margin_is_that_of_what_the_variant_may_use(variant, soles, flywheel):
    """Without a CoP that it may move, it has the middle between the feet and not the line between them."""
    robot, rng = RobotModel(), np.random.default_rng(3)
    limits, policy = GaitLimits.of(robot), make_policy(variant, robot)
    seen, hull = np.zeros(36), np.empty((HULL_ROWS, HULL_COLUMNS))
    seen[0] = -1.0
    seen[SWING_POSITION][:2] = 0.05, robot.pelvis_width
    policy.predict(seen)
    stander = policy._standers[0]
    for _ in range(50):
        seen[DCM], seen[TRUNK_ANGLE] = rng.uniform(-0.2, 0.3, 2), rng.uniform(-0.5, 0.5, 2)
        seen[TRUNK_RATE] = rng.uniform(-1.0, 1.0, 2)
        expected = standing_margin(
            robot, limits, Feet((0.05, robot.pelvis_width)), seen[DCM], seen[TRUNK_ANGLE], seen[TRUNK_RATE],
            soles=soles, flywheel=flywheel,
        )  # fmt: skip
        found = margin_in_place(seen, stander._constants, stander._in_place.capture, hull)
        assert found == pytest.approx(expected, abs=1e-12)


def standing(dcm, other=(0.0, 0.2)):
    """Observation (36,) of a robot on both feet, at rest but for its DCM."""
    seen = np.zeros(36)
    seen[0], seen[DCM], seen[SWING_POSITION], seen[SWING_CONTACT] = -1.0, dcm, (*other, 0.0), 1.0
    return seen


def test_a_plan_is_the_same_whichever_foot_the_robot_is_seen_from():
    """From the other foot the origin is there, left and right exchange; place and time belong to the step."""
    policy, rng, steps = make_policy("two-stage", preset="biped"), np.random.default_rng(4), 0
    for _ in range(30):
        x = rng.uniform(-0.1, 0.1)
        seen = standing(rng.uniform((-0.3, -0.2), (0.3, 0.4)), (x, 0.2))
        seen[COM] = rng.uniform(-0.1, 0.1, 2)
        seen[TRUNK_ANGLE], seen[TRUNK_RATE] = rng.uniform(-0.2, 0.2, 2), rng.uniform(-1.0, 1.0, 2)
        seen[COMMAND] = rng.uniform(-0.2, 0.2, 2) * (rng.uniform() < 0.5)
        seen[PUSH_ESTIMATE] = rng.uniform(-0.4, 0.4, 2)
        other = seen.copy()
        other[DCM], other[COM] = (seen[1] - x, 0.2 - seen[2]), (seen[3] - x, 0.2 - seen[4])
        other[SWING_POSITION.start] = -x
        other[[6, 13, 16, 18, 26, 35]] *= -1.0  # speeds of CoM and foot, lean, its rate, command, push: aside
        gait, found = policy.plan(seen).gait.copy(), policy.plan(other).gait
        assert found[:3] == pytest.approx(gait[:3], abs=1e-9)
        assert found[3:] == pytest.approx([gait[3] - x, 0.2 - gait[4], gait[5], -gait[6]], abs=1e-8)
        steps += gait[2] < policy.limits.duration_max
    assert 5 < steps < 28


@pytest.mark.parametrize("dcm", [(0.0, 0.1), (0.05, 0.12), (-0.2, 0.1), (0.02, 0.25)])
def test_a_variant_without_a_cop_steps_at_once_about_the_middle_of_a_sole(dcm):
    plan = make_policy("stage-1").plan(standing(dcm))
    assert plan.duration < 1.0  # T_max asks for no step
    assert plan.cop.tolist() in ([0.0, 0.0], [0.0, 0.2])


def test_a_variant_without_momentum_keeps_its_trunk_upright_while_it_stands():
    seen = standing((0.0, 0.1))
    seen[TRUNK_ANGLE], seen[TRUNK_RATE] = (0.1, -0.05), (0.3, 0.2)
    plan = make_policy("stage-1+cop").plan(seen)
    assert plan.duration == 1.0
    assert plan.trunk_acceleration == pytest.approx([-4.7, -0.8])  # -20 lean - 9 rate


def test_whoever_steps_asks_for_less_than_the_longest_time():
    """A DCM beside the stance foot's centre wants the longest step; the other foot is off the floor."""
    seen = standing((0.0, 0.002))
    seen[SWING_CONTACT], seen[SWING_POSITION.start + 2] = 0.0, 0.05
    policy = make_policy("two-stage")
    assert policy.plan(seen).duration == pytest.approx(0.999)
    assert policy.predict(seen)[0][2] < 1.0


@pytest.mark.parametrize("command", [(0.0, 0.0), (0.2, -0.1)])
def test_a_shift_ends_where_a_nominal_step_begins_and_costs_what_stage_1_says(command):
    policy = make_policy("two-stage", preset="biped")
    c, omega, seen = policy.config, policy.robot.omega, standing((0.01, 0.1))
    seen[COMMAND], seen[PUSH_ESTIMATE] = command, (0.3, -0.2)
    policy.predict(seen)
    seen[0] = 0.0
    cops, costs, rows = policy._standers[0]._candidates(seen)
    gait = nominal_gait(policy.robot, policy.limits, command, c.touchdown_delay)
    start = step_start_dcm(gait, policy.robot.pelvis_width, omega, c.touchdown_delay)
    growth = np.exp(0.01 * omega * np.arange(len(cops)))[:, None]
    dcm = seen[DCM] + (1.0 - math.exp(-omega * c.push_carry)) * seen[PUSH_ESTIMATE]
    half = policy._standers[0]._half_sole
    free = (np.abs(cops[:, 0]) < 0.999 * half[0]) & (np.abs(cops[:, 1] - 0.1) < 0.1 + 0.999 * half[1])
    assert free.sum() > 20
    reached = growth * dcm - (growth - 1.0) * cops
    np.testing.assert_allclose(reached[free], np.tile(start, (free.sum(), 1)), atol=1e-9)
    step, offset = rows[:, :2] - [gait.length, gait.width], rows[:, OFFSET : OFFSET + 2] - gait.offset
    tau = np.exp(omega * rows[:, 2]) - math.exp(omega * gait.duration)
    squares = (step**2).sum(1), (offset**2).sum(1), tau**2
    expected = np.dot([c.alpha_step, c.alpha_offset, c.alpha_duration], squares)
    np.testing.assert_allclose(costs, expected, atol=1e-9)
    assert costs[0] > 1.0


def test_a_walker_beside_a_stander_gets_the_plan_that_it_gets_alone():
    policy, walker = make_policy("two-stage"), np.zeros(36)
    walker[0], walker[DCM] = 0.1, (0.15, 0.2)
    batch = np.stack([standing((0.0, 0.1)), walker, standing((0.03, 0.12))])
    together = policy.predict(batch)[0]
    assert np.abs(together[1, 3:5]).max() > 0.1  # stage 2 has used the CoP
    for one, row in zip(batch, together, strict=True):
        assert policy.predict(one)[0].tobytes() == row.tobytes()


def test_in_place_a_felt_push_counts_as_going_on_for_a_tenth_of_a_second():
    """It moves the DCM by (1 - exp(-w 0.1 s)) of what it is estimated at, from a threshold of 0.135 m on."""
    policy = make_policy("two-stage", preset="biped")
    share = 1.0 - math.exp(-0.1 * math.sqrt(9.81 / 0.8))
    push, dcm = np.array([0.15, -0.2]), np.array([0.01, 0.12])
    felt, moved = standing(dcm), standing(dcm + share * push)
    felt[PUSH_ESTIMATE] = push
    assert policy.plan(felt).gait[3:] == pytest.approx(policy.plan(moved).gait[3:], abs=1e-9)
    felt[PUSH_ESTIMATE] = 0.1, 0.08  # 0.128 m
    assert policy.plan(felt).gait.tolist() == policy.plan(standing(dcm)).gait.tolist()


def test_a_foot_lifts_after_the_shortest_shift_that_saves_all_but_a_hundredth(monkeypatch):
    """In costs of a DCM that is 2 mm off: 1 at best, so that 1 + 0.01 (1000 - 1) + 1 = 11.99 is enough."""
    policy, seen = make_policy("two-stage"), standing((0.0, 0.1))
    policy.predict(seen)
    stander, row = policy._standers[0], np.zeros(ROW_SIZE)
    assert stander._shifts == pytest.approx(np.linspace(0.0, 0.4, 41))
    costs = policy.config.alpha_offset * 0.002**2 * np.array([1000.0, 12.1, 11.9, 1.0])
    cops, rows = 0.01 * np.arange(8.0).reshape(4, 2), np.zeros((4, ROW_SIZE))
    monkeypatch.setattr(stander, "_candidates", lambda seen: (cops, costs, rows))
    stander._step(seen, row, False)
    assert row[COP : COP + 2].tolist() == cops[2].tolist()


@pytest.mark.parametrize("command", [(0.2, 0.0), (0.0, 0.1), (0.0, -0.1)])
def test_a_stander_that_is_to_walk_any_way_shifts_its_load(command):
    """At rest the CoP is under the DCM, in the middle; a step begins with the DCM elsewhere."""
    policy, seen = make_policy("two-stage"), standing((0.0, 0.1))
    assert policy.plan(seen).gait[COP : COP + 2] == pytest.approx([0.0, 0.1], abs=1e-9)
    seen[COMMAND] = command
    assert np.abs(policy.plan(seen).gait[COP : COP + 2] - [0.0, 0.1]).max() > 0.01


@pytest.mark.parametrize(
    ("height", "contact", "thrown"), [(0.021, 0.0, True), (0.019, 0.0, False), (0.021, 1.0, False)]
)
def test_a_foot_is_thrown_from_two_centimetres_on_and_without_load(height, contact, thrown):
    seen = standing((0.0, 0.1))
    seen[SWING_CONTACT], seen[SWING_POSITION.start + 2] = contact, height
    assert bool(was_thrown(seen)) is thrown
