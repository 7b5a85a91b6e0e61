"""Motors: their torque-speed line, and that nothing passes it in a hard push.

Bounds of the stance wrench, off heading 0, at each of their sides.

What the CoP at the edge of the sole keeps, and how far.
"""

import math

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body import kinematics
from push_recovery.controllers.whole_body import limits as bounds_of
from push_recovery.controllers.whole_body.inverse_dynamics import Task, whole_body_torque
from push_recovery.controllers.whole_body.kinematics import NU, sole_motion, sole_position
from push_recovery.controllers.whole_body.limits import CONTACT, SOLE_EDGE, kept_cop, limits_met, share_within
from push_recovery.envs.biped.core import BIPED, BIPED_BOUNDS, BIPED_GAINS, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.biped import biped, biped_model
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Scenario

MODEL = biped_model()


@pytest.mark.parametrize(
    ("speed", "share"),
    [
        (-30.0, 1.0),
        (0.0, 1.0),
        (bounds_of.FULL_TORQUE_SHARE * 10.0, 1.0),
        (8.5, 0.5),
        (10.0, 0.0),
        (30.0, 0.0),
    ],
)
def test_a_motor_drives_with_less_torque_near_its_free_speed(speed, share):
    assert bounds_of.driving_share(speed, 10.0) == pytest.approx(share, abs=1e-12)


@pytest.mark.parametrize(
    ("share_of_free_speed", "least", "largest"),
    [
        (-1.2, 0.0, 1.0),
        (-0.85, -0.5, 1.0),
        (-0.3, -1.0, 1.0),
        (0.3, -1.0, 1.0),
        (0.85, -1.0, 0.5),
        (1.2, -1.0, 0.0),
    ],
)
def test_the_range_of_torques_ends_where_a_motor_would_drive_too_fast(
    robot_in, share_of_free_speed, least, largest
):
    """Against its motion a motor has its full torque."""
    limits, qvel = biped().motors, np.zeros(MODEL.nv)
    qvel[6:] = share_of_free_speed * limits[1]
    core, _ = robot_in(MODEL.qpos0.copy(), qvel)
    found = np.empty((2, MODEL.nu))
    bounds_of.write_torque_range(core.physics, 0, limits, found)
    np.testing.assert_allclose(found, [least * limits[0], largest * limits[0]], atol=1e-9)
    torque = 1000.0 * np.where(np.arange(MODEL.nu) % 2, 1.0, -1.0)
    bounds_of.clip_torque(torque, found)
    np.testing.assert_array_equal(torque, np.where(np.arange(MODEL.nu) % 2, found[1], found[0]))


def test_every_motor_has_both_limits_and_left_and_right_the_same():
    limits = biped().motors
    names = [MODEL.actuator(i).name for i in range(MODEL.nu)]
    assert (limits > 0).all()
    for name, column in zip(names, limits.T, strict=True):
        twin = names.index(name.replace("left", "right"))
        np.testing.assert_array_equal(column, limits[:, twin])


def test_no_motor_gives_more_than_it_can_at_its_speed_in_a_hard_push():
    """Torques are for the speeds before the physics step, so these are kept from one step to the next."""
    episodes, policy = BipedEpisodes(1), make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
    core, (top, free_speed) = episodes.core, biped().motors
    push = polar_push(900.0, math.pi, 0.1, GaitEvent(2, "left", 0.0))
    episodes.begin(0, Scenario("hard", (push,)))
    speeds, used = core.physics.qvel[0, 6:].copy(), []

    def look() -> None:
        torque = core.physics.ctrl[0]
        share = [
            bounds_of.driving_share(v * np.sign(t), v0)
            for v, t, v0 in zip(speeds, torque, free_speed, strict=True)
        ]
        used.append(np.abs(torque) - top * share)
        speeds[:] = core.physics.qvel[0, 6:]

    core.after_physics_step = look
    for _ in range(200):
        episodes.step(policy.predict(core.observation)[0])
    assert np.max(used) <= 1e-9
    assert np.max(used, axis=0).max() > -1e-9  # some motor was at its limit


S = BIPED_BOUNDS._replace(cop_x_max=0.06, cop_y_max=0.04, yaw_friction=0.02, friction=0.8, force_min=30.0)
HEADING, LOAD = 0.7, 600.0
AXIS = (math.cos(HEADING), math.sin(HEADING))
SMALL = 5e-3


def turned(x: float, y: float) -> np.ndarray:
    """A vector of the foot's axes in the world."""
    return np.array([AXIS[0] * x - AXIS[1] * y, AXIS[1] * x + AXIS[0] * y, 0.0])


def wrench_at(cop=(0.0, 0.0), force=(0.0, 0.0), yaw=0.0, load=LOAD) -> np.ndarray:
    """Wrench (6,) about the sole's centre of a force at a CoP and a yaw moment about it, foot's axes."""
    push = turned(*force) + [0.0, 0.0, load]
    return np.concatenate([push, np.cross(turned(*cop), push) + [0.0, 0.0, yaw]])


def judged(wrench, torque=None) -> tuple[bool, int]:
    bounds, _memory = bounds_of.make_bounds(S, np.full((2, NU), 1.0))
    bounds.torque_range[:] = [[-50.0] * NU, [80.0] * NU]
    torque = np.zeros(NU) if torque is None else torque
    x, y = bounds_of.centre_of_pressure(wrench, AXIS)
    cop = turned(np.clip(x, -S.cop_x_max, S.cop_x_max), np.clip(y, -S.cop_y_max, S.cop_y_max))
    return bounds_of.within_bounds(wrench, torque, AXIS, bounds), limits_met(
        wrench, torque, AXIS, (cop[0], cop[1]), bounds
    )


def test_the_cop_is_where_the_force_acts():
    wrench = wrench_at((0.03, -0.02), (40.0, -25.0), 3.0)
    assert bounds_of.centre_of_pressure(wrench, AXIS) == pytest.approx((0.03, -0.02), abs=1e-12)


YAW = S.yaw_friction * LOAD
CASES = [
    ("cop forward", lambda k: {"cop": (k * S.cop_x_max, 0.0)}, SOLE_EDGE),
    ("cop backward", lambda k: {"cop": (-k * S.cop_x_max, 0.0)}, SOLE_EDGE),
    ("cop left", lambda k: {"cop": (0.0, k * S.cop_y_max)}, SOLE_EDGE),
    ("cop right", lambda k: {"cop": (0.0, -k * S.cop_y_max)}, SOLE_EDGE),
    ("yaw", lambda k: {"yaw": k * YAW, "cop": (0.03, 0.02), "force": (50.0, 90.0)}, CONTACT),
    ("yaw back", lambda k: {"yaw": -k * YAW, "cop": (0.0, 0.03), "force": (90.0, 0.0)}, CONTACT),
    ("friction", lambda k: {"force": (0.6 * k * S.friction * LOAD, -0.8 * k * S.friction * LOAD)}, CONTACT),
    ("load", lambda k: {"load": (2.0 - k) * S.force_min}, CONTACT),
]


@pytest.mark.parametrize(("case", "meets"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_each_bound_of_the_wrench_ends_where_it_says(case, meets):
    assert judged(wrench_at(**case(1.0 - SMALL))) == (True, 0)
    within, met = judged(wrench_at(**case(1.0 + SMALL)))
    assert not within
    assert met & meets
    assert not met & bounds_of.JOINT_TORQUE


@pytest.mark.parametrize("motor", [0, NU - 1])
@pytest.mark.parametrize(("edge", "out"), [(-50.0, -1.0), (80.0, 1.0)])
def test_each_motor_has_a_least_and_a_largest_torque(motor, edge, out):
    torque = np.zeros(NU)
    torque[motor] = edge - 0.5 * out
    assert judged(wrench_at(), torque) == (True, 0)
    torque[motor] = edge + 0.5 * out
    assert judged(wrench_at(), torque) == (False, bounds_of.JOINT_TORQUE)


EDGE = 0.065
FAR = 1.0  # [m], more than any CoP may move
SETTINGS = BIPED_BOUNDS._replace(
    cop_x_max=EDGE, cop_y_max=1.0, yaw_friction=1e6, friction=10.0, force_min=-1e9
)
BOUNDS, _MEMORY = bounds_of.make_bounds(SETTINGS, np.full((2, NU), 1e9))


@pytest.mark.parametrize(("dcm", "goal", "cmp", "time"), [(0.3, 0.4, 0.1, 0.2), (-0.2, 0.1, -0.3, 0.4)])
def test_with_what_is_missing_the_dcm_meets_its_goal(dcm, goal, cmp, time):
    growth = math.exp(BIPED.omega * time)
    moved = cmp + bounds_of.missing_cmp(dcm, goal, cmp, growth)
    assert moved + (dcm - moved) * growth == pytest.approx(goal)


def test_at_touchdown_nothing_can_be_missing_without_bound():
    assert math.isfinite(bounds_of.missing_cmp(0.3, 0.1, 0.0, 1.0))


def test_the_cop_goes_to_the_edge_that_it_is_planned_at():
    assert kept_cop(EDGE, 0.02, EDGE, FAR) == pytest.approx(EDGE - 0.02)
    assert kept_cop(EDGE, -0.04, EDGE, FAR) == pytest.approx(EDGE + 0.04)
    assert kept_cop(1.5 * EDGE, 0.02, EDGE, FAR) == pytest.approx(EDGE - 0.02)  # no farther than the edge
    assert kept_cop(0.5 * EDGE, -0.01, EDGE, FAR) == pytest.approx(0.5 * (0.5 * EDGE + 0.01))


def test_the_cop_stays_where_the_tasks_have_it():
    assert kept_cop(EDGE, 0.08, EDGE, FAR) == 0.0  # it is there
    assert kept_cop(0.0, -0.03, EDGE, FAR) == kept_cop(0.0, 0.03, EDGE, -FAR) == 0.0  # none is planned
    assert kept_cop(EDGE, 0.0, EDGE, -0.01) == 0.0  # the DCM has its goal already
    assert kept_cop(EDGE, 0.0, EDGE, 0.01) == 0.01  # or lacks little


@pytest.mark.parametrize(
    ("planned", "cop", "missing"), [(0.06, -0.02, 0.3), (-0.03, 0.2, -0.01), (0.1, 0.0, -1)]
)
def test_forward_and_backward_are_alike(planned, cop, missing):
    assert kept_cop(-planned, -cop, EDGE, -missing) == -kept_cop(planned, cop, EDGE, missing)


def test_the_share_ends_at_the_circle():
    share = share_within(1.0, -2.0, 3.0, 4.0, 4.0)
    assert math.hypot(1.0 + 3.0 * share, -2.0 + 4.0 * share) == pytest.approx(4.0)
    assert share_within(1.0, -2.0, 0.3, 0.4, 4.0) == 1.0
    assert share_within(3.0, 3.0, -1.0, 0.0, 4.0) == share_within(1.0, 1.0, 0.0, 0.0, 4.0) == 0.0


def asked_of_the_sole(core, cop, missing, swing):
    """Wrench (6,) for a swing sole accelerating forward [m/s^2], the CoM resting."""
    foot = sole_motion(core.physics, 0, 1, kinematics.base_angular_velocity(core.physics, 0))
    reference = np.array([*foot.position, *foot.velocity, swing, 0.0, 0.0])
    height = core.physics.com[0, 0, 2] - sole_position(core.physics, 0, 0)[2]
    task = Task(
        0, (0.0, 0.0), (height, 0.0, 0.0), (1.0, 0.0), reference, (0.0, 0.0), cop=cop, missing=missing
    )
    wrench, gains = np.empty(6), BIPED_GAINS._replace(damping=0.0)
    whole_body_torque(core.physics, 0, task, 0.0, gains, BOUNDS, wrench, np.empty(NU))
    return wrench, height


def test_what_a_braking_leg_adds_brakes_the_com(biped_core, begin):
    core, plan = biped_core(1), 0.9 * EDGE
    begin(core, 0, Scenario("still"))
    back, height = asked_of_the_sole(core, (0.0, 0.0), (FAR, 0.0), -12.0)
    kept, _ = asked_of_the_sole(core, (plan, 0.0), (FAR, 0.0), -12.0)
    (before, aside), after = (bounds_of.centre_of_pressure(wrench, (1.0, 0.0)) for wrench in (back, kept))
    moved = kept_cop(plan, before, EDGE, FAR)
    assert moved > EDGE > 0.0 > before
    # the legs turn with the CoM, which moves the CoP by another 8 %
    assert after == pytest.approx((before + 1.08 * moved, aside), abs=0.02 * moved)
    assert kept[0] - back[0] == pytest.approx(-back[2] / height * moved)
    np.testing.assert_allclose(kept[1:3], back[1:3], atol=1e-6)
    enough, _ = asked_of_the_sole(core, (plan, 0.0), (0.01, 0.0), -12.0)
    assert enough[0] - back[0] == pytest.approx(-back[2] / height * 0.01)


def test_it_does_not_ask_for_more_friction_than_it_counts_on():
    wrench = np.array([-200.0, 0.0, 600.0, 0.0, 30.0, 0.0])
    bounds, _memory = bounds_of.make_bounds(SETTINGS._replace(friction=0.5), np.full((2, NU), 1e9))
    fx, fy = bounds_of.full_sole_force(wrench, (1.0, 0.0), (EDGE, 0.0), (FAR, 0.0), 0.8, bounds)
    assert (wrench[0] + fx, fy) == pytest.approx((-bounds_of.SHARE_OF_GRIP * 0.5 * 600.0, 0.0))
    bounds.grip[0] = 0.4
    assert bounds_of.full_sole_force(wrench, (1.0, 0.0), (EDGE, 0.0), (FAR, 0.0), 0.8, bounds) == (0.0, 0.0)
    bounds.grip[0] = 0.8
    assert bounds_of.full_sole_force(wrench, (1.0, 0.0), (EDGE, 0.0), (FAR, 0.0), 0.8, bounds)[
        0
    ] == pytest.approx(-600.0 / 0.8 * (EDGE + 30.0 / 600.0))
    wrench[2] = -10.0
    assert bounds_of.full_sole_force(wrench, (1.0, 0.0), (EDGE, 0.0), (FAR, 0.0), 0.8, bounds) == (0.0, 0.0)
