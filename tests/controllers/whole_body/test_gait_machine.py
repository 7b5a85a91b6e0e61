"""Touchdown, reach and pushes of the biped's gait machine.

Touchdown, footholds and the CoM's lever, off heading 0 and on soles of different height.
"""

import math

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.whole_body import gait_machine
from push_recovery.controllers.whole_body.kinematics import PELVIS, TRUNK, sole_position
from push_recovery.controllers.whole_body.limits import LANDED_LATE, LANDED_OFF, TOUCHDOWN_ERROR, make_bounds
from push_recovery.envs.biped.core import BIPED_BOUNDS, BIPED_GAIT, BIPED_LIMITS
from push_recovery.envs.biped.posture import posture
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.scenario.model_errors import CONTROL_STEP
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario

SETTINGS = BIPED_GAIT


def run(core, begin, scenario: Scenario, seconds: float) -> np.ndarray:
    """External forces (steps, bodies, 6) of a robot that walks the nominal gait."""
    gait, forces = begin(core, 0, scenario), []
    core.after_physics_step = lambda: forces.append(core.physics.xfrc[0].copy())
    action = BIPED_LIMITS.to_action(gait).astype(np.float64)[None]
    for _ in range(round(seconds / (core.substeps * CONTROL_STEP))):
        core.step(gait[None], action)
    core.after_physics_step = None
    return np.array(forces)


@pytest.mark.parametrize("control_hz", [20, 25, 50, 100, 125, 250, 500])
@pytest.mark.parametrize(("start", "duration"), [(0.1, 0.1), (0.0, 0.05), (0.12345, 0.0301), (0.2, 0.0004)])
def test_the_impulse_on_the_body_is_force_times_duration(biped_core, begin, control_hz, start, duration):
    core, push = biped_core(1, control_hz), Push((37.0, -45.0, 7.0), duration, start)
    forces = run(core, begin, Scenario("a", (push,)), 0.4)
    np.testing.assert_allclose(forces[:, PELVIS, :3].sum(axis=0) * CONTROL_STEP, push.impulse, atol=1e-9)
    np.testing.assert_allclose(core.pushes.delivered[0, 0], push.impulse, atol=1e-9)
    forces[:, PELVIS, :3] = 0.0
    assert not forces.any()  # no torque, and nothing on another body


def test_two_pushes_on_two_bodies_add_up_and_nothing_else_writes_forces(biped_core, begin):
    pushes = (
        Push((30.0, 0.0, 0.0), 0.1, 0.05),
        Push((0.0, 20.0, 0.0), 0.06, 0.1, "trunk"),
        Push((-10.0, 5.0, 0.0), 0.1, 0.1),
    )
    forces = run(biped_core(), begin, Scenario("a", pushes), 0.4)
    dt = CONTROL_STEP
    np.testing.assert_allclose(forces[:, TRUNK, :3].sum(axis=0) * dt, pushes[1].impulse, atol=1e-9)
    both = np.add(pushes[0].impulse, pushes[2].impulse)
    np.testing.assert_allclose(forces[:, PELVIS, :3].sum(axis=0) * dt, both, atol=1e-9)
    times = np.arange(len(forces)) * dt
    pushed = np.abs(forces).sum(axis=(1, 2)) > 0
    assert pushed[(times > 0.05) & (times < 0.199)].all()
    assert not pushed[(times < 0.047) | (times > 0.201)].any()
    rest = np.delete(forces, (PELVIS, TRUNK), axis=1)
    assert not rest.any()


def test_an_offset_turns_the_body(biped_core, begin):
    push = Push((40.0, 0.0, 0.0), 0.1, 0.0, "trunk", (0.0, 0.1, 0.2))
    forces = run(biped_core(), begin, Scenario("a", (push,)), 0.02)
    # the trunk is upright at the start: torque = offset x force
    np.testing.assert_allclose(forces[0, TRUNK, 3:], np.cross(push.offset, push.force), atol=1e-9)
    assert forces[0, TRUNK, 4] > 0  # forwards over the CoM pitches forwards


def test_nothing_of_a_push_is_left_after_a_reset(biped_core, begin):
    core = biped_core()
    run(core, begin, Scenario("a", (Push((60.0, 20.0, 0.0), 1.0, 0.05, "trunk", (0.0, 0.1, 0.0)),)), 0.2)
    assert core.physics.xfrc.any()
    forces = run(core, begin, Scenario("b"), 0.4)
    assert not forces.any()
    assert not core.pushes.delivered.any()


def test_a_gait_event_starts_in_its_step(biped_core, begin):
    core, event = biped_core(), GaitEvent(1, "right", 0.3)
    gait = begin(core, 0, Scenario("a", (Push((5.0, 0.0, 0.0), 0.05, event),)))
    action = BIPED_LIMITS.to_action(gait).astype(np.float64)[None]
    starts = {}
    while core.gait.steps[0] < 2 and core.gait.time[0] < 2.0:
        core.step(gait[None], action)
        starts.setdefault(int(core.gait.steps[0]), core.gait.time[0] - core.gait.elapsed[0])
    assert core.pushes.start[0, 0] == pytest.approx(starts[1] + 0.3 * gait[2], abs=1e-9)


def test_a_foot_lands_near_the_end_of_its_step_or_under_heavy_load():
    duration, s = 0.5, SETTINGS
    late, near, mid = duration - 0.5 * s.early, duration - 2.0 * s.early, 0.5 * s.forced_phase * duration
    assert gait_machine.has_landed(1.01 * s.early_load, late, duration, s)
    assert not gait_machine.has_landed(0.99 * s.early_load, late, duration, s)
    assert gait_machine.has_landed(1.01 * s.forced_load, near, duration, s)
    assert not gait_machine.has_landed(0.99 * s.forced_load, near, duration, s)
    assert not gait_machine.has_landed(1e4, mid, duration, s)


@pytest.mark.parametrize(("remaining", "held"), [(2.0, 0), (0.5, 3)])
def test_place_and_time_of_a_step_are_final_shortly_before_it_ends(biped_core, begin, remaining, held):
    """Within `commit` of touchdown a new foothold and duration are not taken over; CoP and trunk are."""
    core = biped_core()
    plan = begin(core, 0, Scenario("a"))
    core.gait.elapsed[0] = plan[2] - remaining * SETTINGS.commit
    asked, action, previous = plan + 0.01, np.full(7, 0.5), np.zeros(7)
    gait_machine.accept(core.gait, 0, SETTINGS, asked, action, previous)
    np.testing.assert_array_equal(core.gait.plan[0], np.where(np.arange(7) < held, plan, asked))
    np.testing.assert_array_equal(previous, np.where(np.arange(7) < held, 0.0, action))


def test_a_final_step_gives_way_to_one_that_is_far_from_landing(biped_core, begin):
    core = biped_core()
    plan = begin(core, 0, Scenario("a"))
    core.gait.elapsed[0] = plan[2] - 0.5 * SETTINGS.commit
    asked = plan + np.array([0.0, 0.2, 0.6 * SETTINGS.commit, 0.0, 0.0, 0.0, 0.0])
    gait_machine.accept(core.gait, 0, SETTINGS, asked, np.zeros(7), np.zeros(7))
    np.testing.assert_array_equal(core.gait.plan[0], asked)


@pytest.mark.parametrize("stance", [0, 1])
def test_touchdown_exchanges_the_feet_and_mirrors_the_plan(random_state, robot_in, stance):
    core, _ = robot_in(*random_state(np.random.default_rng(0)), stance)
    core.gait.plan[0] = [0.1, 0.2, 0.5, 0.02, 0.01, 3.0, 4.0]
    core.gait.elapsed[0] = 0.5
    gait_machine.touch_down(core.physics, core.gait, 0)
    assert (core.gait.stance[0], core.gait.steps[0], core.gait.elapsed[0]) == (1 - stance, 1, 0.0)
    np.testing.assert_array_equal(core.gait.plan[0], [0.1, 0.2, 0.5, 0.0, 0.0, 3.0, -4.0])
    np.testing.assert_array_equal(core.gait.swing[0, :3], sole_position(core.physics, 0, stance))
    assert not core.gait.swing[0, 3:].any()


@pytest.mark.parametrize("stance", [0, 1])
def test_in_double_support_the_cop_waits_on_the_foot_that_stood(random_state, robot_in, stance):
    core, _ = robot_in(*random_state(np.random.default_rng(0)), stance)
    core.gait.heading[0] = 0.3
    gait_machine.touch_down(core.physics, core.gait, 0, 0.1)
    old, new = (np.array(sole_position(core.physics, 0, leg)[:2]) for leg in (stance, 1 - stance))
    heading, outward = core.gait.heading[0], -1.0 if stance == 1 else 1.0  # left stance: y to the right
    ahead = np.array([math.cos(heading), math.sin(heading)])
    aside = outward * np.array([-ahead[1], ahead[0]])
    cop = core.gait.plan[0, 3:5]
    np.testing.assert_allclose(new + cop[0] * ahead + cop[1] * aside, old, atol=1e-12)
    assert cop[1] > 0.0


def test_the_com_is_lowered_until_both_legs_reach(random_state, robot_in):
    """At the height found, leg^2 = above^2 + aside^2 <= reach^2 for the foothold as it was moved."""
    s, rng = SETTINGS, np.random.default_rng(1)
    core, data = robot_in(*random_state(rng, 0.01))
    sole, hips = sole_position(core.physics, 0, 0), data.xanchor[[3, 9]]
    com = data.subtree_com[0]
    heights = []
    for length in (0.0, 0.3, 0.5, 1.0):
        target, travel = (sole[0] + length, sole[1] - 0.2), (0.5 * length, 0.0)
        height, target = gait_machine.reach_height(core.physics, 0, 0, sole, target, travel, 0.0, s)
        above = height + hips[1, 2] - com[2] - 0.06
        aside = np.hypot(*(np.array(target) - hips[1, :2] - travel))
        assert np.hypot(above, aside) <= s.reach + 1e-9
        assert s.com_height - s.height_drop <= height <= s.com_height
        heights.append(height)
    assert np.all(np.diff(heights) <= 0)
    assert heights[-1] == pytest.approx(s.com_height - s.height_drop)


HEADING, TURNED = 0.7, 0.2
OUTWARD = {0: -1.0, 1: 1.0}  # sign of the swing side of a stance foot, to the left


@pytest.fixture
def landed(random_state, robot_in):
    """A robot at a heading, soles at different heights, whose swing foot is where and when it was planned."""

    def make(stance: int):
        core, _ = robot_in(*random_state(np.random.default_rng(stance)), stance)
        core.gait.heading[0], core.gait.elapsed[0] = HEADING, 0.5
        sole, foot = (np.array(sole_position(core.physics, 0, leg)) for leg in (stance, 1 - stance))
        assert abs(foot[2] - sole[2]) > 0.01
        ahead = np.array([math.cos(HEADING), math.sin(HEADING)])
        aside = OUTWARD[stance] * np.array([-ahead[1], ahead[0]])
        step = (foot - sole)[:2]
        core.gait.plan[0] = [step @ ahead, step @ aside, 0.5, 0.02, 0.01, 3.0, 4.0]
        return core, sole, foot

    return make


@pytest.mark.parametrize("stance", [0, 1])
@pytest.mark.parametrize("entry", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_foot_lands_off_its_plan_from_three_centimetres_on(landed, stance, entry, sign):
    core, _, _ = landed(stance)
    assert gait_machine.landing_error(core.physics, core.gait, 0) == 0
    core.gait.plan[0, entry] += sign * 0.99 * LANDED_OFF
    assert gait_machine.landing_error(core.physics, core.gait, 0) == 0
    core.gait.plan[0, entry] += sign * 0.02 * LANDED_OFF
    assert gait_machine.landing_error(core.physics, core.gait, 0) == TOUCHDOWN_ERROR


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_foot_lands_off_its_time(landed, sign):
    core, _, _ = landed(0)
    core.gait.elapsed[0] = 0.5 + sign * 0.99 * LANDED_LATE
    assert gait_machine.landing_error(core.physics, core.gait, 0) == 0
    core.gait.elapsed[0] = 0.5 + sign * 1.01 * LANDED_LATE
    assert gait_machine.landing_error(core.physics, core.gait, 0) == TOUCHDOWN_ERROR


@pytest.mark.parametrize("stance", [0, 1])
def test_at_touchdown_neither_the_com_nor_a_yaw_jumps(landed, stance):
    """Heights count from the sole that has landed, yaws from the heading that it has."""
    core, old, new = landed(stance)
    core.gait.height[0] = [0.8, 0.1, -0.2, old[2]]
    core.gait.yaw[0] = [TURNED, 0.3, 0.1, 0.12, 0.4, 0.2, TURNED]
    gait_machine.touch_down(core.physics, core.gait, 0)
    assert (core.gait.stance[0], core.gait.elapsed[0]) == (1 - stance, 0.0)
    assert core.gait.height[0, 0] + new[2] == pytest.approx(0.8 + old[2], abs=1e-12)
    np.testing.assert_array_equal(core.gait.height[0, 1:3], [0.1, -0.2])
    assert core.gait.heading[0] == pytest.approx(HEADING + TURNED)
    np.testing.assert_allclose(
        core.gait.yaw[0], [-TURNED, 0.0, 0.0, 0.12 - TURNED, 0.4, 0.2, 0.0], atol=1e-15
    )
    np.testing.assert_array_equal(core.gait.swing[0], [*old, *[0.0] * 6])
    np.testing.assert_array_equal(core.gait.plan[0, 3:], [0.0, 0.0, 3.0, -4.0])


@pytest.mark.parametrize("stance", [0, 1])
def test_with_the_missing_cmp_the_dcm_lands_where_stepping_in_place_has_it(stance):
    """xi(t) = cmp + e^(w t) (xi - cmp) meets u_T + b: ahead the foothold, aside W (1 - 1 / (1 + e^(w T)))."""
    s, sign, remaining = BIPED_GAIT, OUTWARD[stance], 0.2
    plan = np.array([0.15, 0.25, 0.45, 0.03, -0.02, 1.5, -2.0])
    place, speed = (0.04, 0.06), (0.3, -0.2)
    growth = math.exp(s.omega * remaining)
    offset, missing = gait_machine.com_cmp_offset_and_deficit(place, speed, plan, sign, growth, s)
    planned = np.array([0.03 + s.cmp_gain * 1.5, sign * (-0.02 - s.cmp_gain * 2.0)])
    np.testing.assert_allclose(offset, place - planned, atol=1e-15)
    cmp, dcm = planned + missing, np.array(place) + np.array(speed) / s.omega
    width = sign * 0.25
    goal = [0.15, width - width / (1.0 + math.exp(s.omega * 0.45))]
    np.testing.assert_allclose(cmp + growth * (dcm - cmp), goal, atol=1e-12)


@pytest.mark.parametrize("stance", [0, 1])
def test_a_step_from_two_feet_may_begin_on_the_other_one_without_a_jump(landed, stance):
    """The CoP is on the other sole, which becomes the one that heights and yaws count from."""
    core, old, new = landed(stance)
    core.gait.plan[0, 3:5] = core.gait.plan[0, :2]
    core.gait.height[0] = [0.8, 0.1, -0.2, old[2]]
    core.gait.yaw[0] = [TURNED, 0.0, 0.0, 0.12, 0.0, 0.0, 0.0]
    gait_machine.lift_off(core.physics, core.gait, 0)
    assert (core.gait.stance[0], core.gait.elapsed[0]) == (1 - stance, 0.0)
    assert core.gait.height[0, 0] + new[2] == pytest.approx(0.8 + old[2], abs=1e-12)
    assert core.gait.heading[0] == pytest.approx(HEADING + TURNED)
    assert core.gait.yaw[0, [0, 3]] == pytest.approx([-TURNED, 0.12 - TURNED])
    np.testing.assert_array_equal(core.gait.swing[0, :3], old)
    np.testing.assert_allclose(core.gait.plan[0, 3:], [0.0, 0.0, 3.0, -4.0], atol=1e-12)


@pytest.mark.parametrize(("ahead", "stands"), [(0.07, True), (0.09, False)])  # the hull less its margin: 0.08
def test_it_may_stand_whatever_its_heading(robot_in, ahead, stands):
    soles = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
    qpos, qvel = posture(biped(), np.array([ahead, 0.0, 0.78]), np.zeros(3), soles)
    quat, turned = np.empty(4), qpos.copy()
    mujoco.mju_axisAngle2Quat(quat, np.array([0.0, 0.0, 1.0]), math.pi / 2)
    mujoco.mju_mulQuat(turned[3:7], quat, qpos[3:7].copy())
    turned[:2] = -qpos[1], qpos[0]
    core, _ = robot_in(turned, qvel)
    core.gait.heading[0], core.gait.stand[0] = math.pi / 2, 1.0
    bounds = BIPED_BOUNDS._replace(cop_x_max=0.1, cop_y_max=0.05)
    both, _memory = make_bounds(bounds, biped().motors, two_feet=True)
    assert gait_machine.may_stand(core.physics, core.gait, 0, SETTINGS, both) is stands


@pytest.mark.parametrize(
    ("com", "dcm", "stands"),
    [
        ((0.0, 0.0), (0.07, 0.0), True),
        ((0.0, 0.0), (0.09, 0.0), False),
        ((0.05, 0.0), (-0.04, 0.0), True),
        ((0.0, 0.05), (0.0, 0.14), False),
        ((0.0, 0.05), (0.0, -0.04), True),
    ],
)
def test_it_may_stand_where_its_dcm_is_over_the_feet(robot_in, com, dcm, stands):
    """Soles of 0.2 x 0.1 m, 0.2 m apart, less 2 cm."""
    soles = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
    velocity = SETTINGS.omega * np.subtract(dcm, com)
    core, _ = robot_in(*posture(biped(), np.array([*com, 0.78]), np.array([*velocity, 0.0]), soles))
    core.gait.stand[0] = 1.0
    bounds = BIPED_BOUNDS._replace(cop_x_max=0.1, cop_y_max=0.05)
    both, _memory = make_bounds(bounds, biped().motors, two_feet=True)
    assert gait_machine.may_stand(core.physics, core.gait, 0, SETTINGS, both) is stands


@pytest.mark.parametrize("heading", [math.pi / 2, -2.0])
def test_a_standers_torques_do_not_hang_on_its_heading(biped_core, begin, heading):
    soles = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
    qpos, qvel = posture(biped(), np.array([0.03, 0.02, 0.78]), np.array([0.05, -0.04, 0.0]), soles)
    cos, sin, quat = math.cos(heading), math.sin(heading), np.empty(4)
    spin, turned, moving = np.array([[cos, -sin], [sin, cos]]), qpos.copy(), qvel.copy()
    mujoco.mju_axisAngle2Quat(quat, np.array([0.0, 0.0, 1.0]), heading)
    mujoco.mju_mulQuat(turned[3:7], quat, qpos[3:7].copy())
    turned[:2], moving[:2] = spin @ qpos[:2], spin @ qvel[:2]
    core, torques = biped_core(1, 500.0), []
    core.after_physics_step = lambda: torques.append(core.physics.ctrl[0].copy())
    for yaw, state in ((0.0, (qpos, qvel)), (heading, (turned, moving))):
        begin(core, 0, Scenario("a", command=Command(stand=True)))
        core.put(0, *state)
        core.gait.heading[0] = yaw
        core.step(np.array([[0.0, 0.2, 1.0, 0.02, 0.07, 1.5, -1.0]]), np.ones((1, 7)))
    assert core.gait.elapsed[0] == -1.0
    np.testing.assert_allclose(torques[1], torques[0], atol=1e-9)


@pytest.mark.parametrize("rise", [0.12, -0.12])
def test_on_a_step_the_com_is_half_way_up_or_as_high_as_the_lower_leg_lets_it(random_state, robot_in, rise):
    core, data = robot_in(*random_state(np.random.default_rng(1), 0.01))
    sole, hips, com = sole_position(core.physics, 0, 0), data.xanchor[[3, 9]], data.subtree_com[0]
    below = float(hips[1, 0]), float(hips[1, 1])

    def height(s):
        return gait_machine.reach_height(core.physics, 0, 0, sole, below, (0.0, 0.0), rise, s)[0]

    assert height(SETTINGS._replace(reach=2.0)) == pytest.approx(0.8 + 0.5 * rise)
    up = height(SETTINGS) + hips[:, 2] - com[2] - 0.06 - [0.0, rise]
    aside = math.hypot(sole[0] - hips[0, 0], sole[1] - hips[0, 1]), 0.0
    assert np.hypot(up, aside).max() == pytest.approx(SETTINGS.reach)  # one leg is straight


@pytest.mark.parametrize(("rise", "lower"), [(0.1, 0.0), (0.0, 0.0), (-0.1, 0.05)])
def test_down_a_step_the_com_may_sink_by_half_of_it_more_and_up_one_as_far_as_ever(rise, lower):
    least = SETTINGS.com_height - SETTINGS.height_drop - lower
    assert gait_machine.lowest_height(rise, SETTINGS) == pytest.approx(least)


@pytest.mark.parametrize("rise", [0.1, -0.1])
def test_a_foothold_too_far_on_a_step_is_drawn_in_to_where_a_lowered_robot_reaches_it(
    random_state, robot_in, rise
):
    s = SETTINGS
    core, data = robot_in(*random_state(np.random.default_rng(1), 0.01))
    sole, hips, com = sole_position(core.physics, 0, 0), data.xanchor[[3, 9]], data.subtree_com[0]
    far = float(hips[1, 0]) + 2.0, float(hips[1, 1])
    _, target = gait_machine.reach_height(core.physics, 0, 0, sole, far, (0.0, 0.0), rise, s)
    hip = s.com_height - s.height_drop + hips[1, 2] - com[2] - 0.06 - rise  # over the ankle on that floor
    away = math.hypot(target[0] - hips[1, 0], target[1] - hips[1, 1])
    assert away == pytest.approx(math.sqrt(s.reach**2 - hip**2))
