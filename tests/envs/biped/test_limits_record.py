"""Which bounds a biped meets, each by the smallest change that meets it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import preset_config
from push_recovery.controllers.stage_1 import swing_time
from push_recovery.controllers.whole_body import limits as bits
from push_recovery.controllers.whole_body.gait_machine import landing_error
from push_recovery.controllers.whole_body.kinematics import sole_position
from push_recovery.controllers.whole_body.limits import limits_met, make_bounds
from push_recovery.envs.biped import limits_record as record_of
from push_recovery.envs.biped.core import BIPED, BIPED_BOUNDS, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

BOUNDS = BIPED_BOUNDS
EPISODES = BipedEpisodes(2)
FINAL = EPISODES.core.gait_settings.commit
EDGES = EPISODES.core.limits_record.edges
PLAN_LIMITS = record_of.PlanLimits(*EDGES.tolist())
MIDDLE = np.array([0.1, 0.25, 0.45, 0.0, 0.0, 0.0, 0.0])
OBSERVATION = np.zeros(36)
OBSERVATION[[0, 9, 10]] = 0.1, -0.1, 0.2  # elapsed, swing foot


def plan_bits(changes=(), observation=OBSERVATION, before=0):
    plan = MIDDLE.copy()
    for index, value in changes:
        plan[index] = value
    return record_of.plan_limits_met(observation, plan, before, EDGES)


@pytest.mark.parametrize(
    ("index", "bound", "sign", "bit"),
    [
        (0, BIPED_LIMITS.length_max, 1, bits.STEP_LENGTH),
        (0, BIPED_LIMITS.length_min, -1, bits.STEP_LENGTH),
        (1, BIPED_LIMITS.width_max, 1, bits.STEP_WIDTH),
        (1, BIPED_LIMITS.width_min, -1, bits.STEP_WIDTH),
        (3, PLAN_LIMITS.cop_x_max, 1, bits.COP_EDGE),
        (4, -PLAN_LIMITS.cop_y_max, -1, bits.COP_EDGE),
        (5, BIPED_LIMITS.trunk_acceleration_max, 1, bits.TRUNK_TORQUE),
        (6, -BIPED_LIMITS.trunk_acceleration_max, -1, bits.TRUNK_TORQUE),
    ],
)
def test_a_plan_meets_the_bound_that_it_lies_on_and_no_other(index, bound, sign, bit):
    assert plan_bits() == 0
    assert plan_bits([(index, bound)]) == bit
    assert plan_bits([(index, bound - sign * 0.02)]) == 0


def test_without_a_waist_no_bound_of_a_trunk_is_met():
    leaning, bent = OBSERVATION.copy(), MIDDLE.copy()
    leaning[15:17] = 1.0
    bent[5:] = BIPED_LIMITS.trunk_acceleration_max
    met = bits.TRUNK_TORQUE | bits.TRUNK_LEAN
    for waist, expected in (((False, False), 0), ((True, False), met), ((False, True), met)):
        robot = replace(BIPED, trunk_pitch=waist[0], trunk_roll=waist[1])
        edges = record_of.plan_limits(robot, BIPED_LIMITS, preset_config("biped"), FINAL)
        assert record_of.plan_limits_met(leaning, bent, 0, edges) == expected


def test_the_step_is_as_soon_as_the_swing_foot_allows():
    distance = math.hypot(MIDDLE[0] - OBSERVATION[9], MIDDLE[1] - OBSERVATION[10])
    soonest = OBSERVATION[0] + swing_time(distance, 0.0, PLAN_LIMITS.swing_acceleration)
    assert soonest > BIPED_LIMITS.duration_min
    assert plan_bits([(2, soonest)]) == bits.STEP_TIME
    assert plan_bits([(2, soonest + 0.005)]) == 0
    at_target = OBSERVATION.copy()
    at_target[9:11] = MIDDLE[:2]
    assert plan_bits([(2, soonest)], at_target) == 0
    at_target[0] = 0.5 * BIPED_LIMITS.duration_min  # long before the step is final
    assert plan_bits([(2, BIPED_LIMITS.duration_min)], at_target) == bits.STEP_TIME


def test_a_final_step_keeps_what_its_last_decision_met():
    late = OBSERVATION.copy()
    late[0] = MIDDLE[2] - 0.5 * FINAL
    before = bits.STEP_TIME | bits.COP_EDGE
    assert PLAN_LIMITS.final == FINAL
    assert plan_bits((), late, before) == bits.STEP_TIME
    assert plan_bits((), OBSERVATION, before) == 0


def test_gravity_takes_its_share_of_the_torque_of_a_leaning_trunk():
    leaning = OBSERVATION.copy()
    leaning[15] = 0.6
    most = (
        BIPED.trunk_torque_max - preset_config(EPISODES.preset).trunk_gravity * math.sin(0.6)
    ) / BIPED.trunk_inertia
    assert plan_bits([(5, -most)], leaning) == bits.TRUNK_TORQUE
    assert plan_bits([(5, -most + 0.1)], leaning) == 0
    leaning[15] = -0.96 * BIPED.trunk_angle_max
    assert plan_bits((), leaning) == bits.TRUNK_LEAN


@pytest.mark.parametrize(
    ("wrench", "first_torque", "met"),
    [
        ((0, 0, 600, 0, 0, 0), 0.0, 0),
        ((0, 0, 600, 0, -600 * BOUNDS.cop_x_max, 0), 0.0, bits.SOLE_EDGE),
        ((0, 0, 600, 600 * BOUNDS.cop_y_max, 0, 0), 0.0, bits.SOLE_EDGE),
        ((600 * BOUNDS.friction, 0, 600, 0, 0, 0), 0.0, bits.CONTACT),
        ((0, 0, 600, 0, 0, -600 * BOUNDS.yaw_friction), 0.0, bits.CONTACT),
        ((0, 0, BOUNDS.force_min, 0, 0, 0), 0.0, bits.CONTACT),
        ((0, 0, 600, 0, 0, 0), 1.0, bits.JOINT_TORQUE),
        ((0, 0, 600, 0, -600 * BOUNDS.cop_x_max, 0), -1.0, bits.SOLE_EDGE | bits.JOINT_TORQUE),
    ],
)
def test_the_bounds_of_whole_body_control(wrench, first_torque, met):
    motors = biped().motors
    bounds, _memory = make_bounds(BOUNDS, motors)
    bounds.torque_range[:] = -motors[0], motors[0]
    torque = np.zeros(14)
    torque[0] = first_torque * motors[0, 0]
    numbers = np.array(wrench, dtype=np.float64)
    assert limits_met(numbers, torque, (1.0, 0.0), (0.0, 0.0), bounds) == met
    inside = numbers * [0.98, 0.98, 1.01, 0.98, 0.98, 0.98]
    assert limits_met(inside, 0.98 * torque, (1.0, 0.0), (0.0, 0.0), bounds) == 0


@pytest.mark.parametrize("stance", [0, 1])
def test_a_landing_is_judged_by_place_and_time(random_state, robot_in, stance):
    core, _ = robot_in(*random_state(np.random.default_rng(0)), stance)
    old, new = (np.array(sole_position(core.physics, 0, foot)) for foot in (stance, 1 - stance))
    sign = -1.0 if stance == 0 else 1.0
    place = [new[0] - old[0], sign * (new[1] - old[1])]
    for offset, late, met in [(0, 0, 0), (0.02, 0.02, 0), (0.04, 0, 1), (0, 0.04, 1), (0, -0.04, 1)]:
        core.gait.plan[0, :3] = place[0] + 0.6 * offset, place[1] - 0.8 * offset, 0.4
        core.gait.elapsed[0] = 0.4 + late
        assert landing_error(core.physics, core.gait, 0) == met * bits.TOUCHDOWN_ERROR


def run(force):
    """What a robot and its mirror image have met 0.5 s after a push of `force` [N] to the left at 1 s."""
    policy = make_policy("two-stage", EPISODES.robot, EPISODES.limits, EPISODES.preset)
    scenario = Scenario("a", (Push((0.0, force, 0.0), 0.1, 1.0),), settle_time=0.5)
    EPISODES.begin(0, scenario)
    EPISODES.begin(1, scenario.mirrored())
    while not EPISODES.step(policy.predict(EPISODES.core.observation)[0]).truncated.any():
        assert not EPISODES.core.limits_met(0).met or EPISODES.core.gait.time[0] >= 1.0
    return [EPISODES.core.limits_met(k) for k in range(2)]


def test_an_undisturbed_gait_meets_no_limit():
    assert run(0.1) == [({}, {}), ({}, {})]


def test_a_push_meets_bounds_from_its_start_on_and_left_is_as_right():
    left, right = run(150.0)
    assert 0 < len(left.met) < len(bits.LIMIT_NAMES)
    assert list(left.met) == list(left.shares) == sorted(left.met, key=lambda name: left.met[name])
    assert min(left.met.values()) >= 1.0
    assert all(0.0 < share <= 1.0 for share in left.shares.values())
    assert left.met == pytest.approx(right.met, abs=0.02)
    EPISODES.begin(0, Scenario("b"))
    assert EPISODES.core.limits_met(0) == ({}, {})


def test_a_report_tells_limits_in_the_order_in_which_they_were_met():
    record = record_of.empty_record(1, EDGES)
    starts = np.array([2.0, 1.0])
    record_of.note_limits(record, 0, bits.COP_EDGE, starts, 0.5, 0.1)  # before any push
    record_of.note_limits(record, 0, bits.DCM_TRACKING, starts, 1.0, 0.5)
    record_of.note_limits(record, 0, bits.DCM_TRACKING | bits.COP_EDGE | bits.STEP_WIDTH, starts, 1.5, 0.5)
    report = record_of.report_limits(record, 0, 1.0, 3.0)
    assert list(report.met.items()) == [("dcm_tracking", 1.0), ("step_width", 1.5), ("cop", 1.5)]
    assert report.shares == {"dcm_tracking": 0.5, "step_width": 0.25, "cop": 0.25}
    # met all the time, and a rounding error longer; the push began one second into the episode
    assert record_of.report_limits(record, 0, 2.0, 3.0).shares["dcm_tracking"] == 1.0
    record_of.clear_record(record, 0)
    assert record_of.report_limits(record, 0, 1.0, 3.0) == ({}, {})
