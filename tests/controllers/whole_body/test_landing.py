"""Touchdown, footholds and the CoM's lever, off heading 0 and on soles of different height."""

import math

import numpy as np
import pytest
from push_recovery.controllers.whole_body.gait_machine import landing_error, lever_and_missing, touch_down
from push_recovery.controllers.whole_body.kinematics import sole_position
from push_recovery.controllers.whole_body.limits import LANDED_LATE, LANDED_OFF, TOUCHDOWN_ERROR
from push_recovery.envs.biped.core import BIPED_GAIT

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
    assert landing_error(core.physics, core.gait, 0) == 0
    core.gait.plan[0, entry] += sign * 0.99 * LANDED_OFF
    assert landing_error(core.physics, core.gait, 0) == 0
    core.gait.plan[0, entry] += sign * 0.02 * LANDED_OFF
    assert landing_error(core.physics, core.gait, 0) == TOUCHDOWN_ERROR


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_foot_lands_off_its_time(landed, sign):
    core, _, _ = landed(0)
    core.gait.elapsed[0] = 0.5 + sign * 0.99 * LANDED_LATE
    assert landing_error(core.physics, core.gait, 0) == 0
    core.gait.elapsed[0] = 0.5 + sign * 1.01 * LANDED_LATE
    assert landing_error(core.physics, core.gait, 0) == TOUCHDOWN_ERROR


@pytest.mark.parametrize("stance", [0, 1])
def test_at_touchdown_neither_the_com_nor_a_yaw_jumps(landed, stance):
    """Heights count from the sole that has landed, yaws from the heading that it has."""
    core, old, new = landed(stance)
    core.gait.height[0] = [0.8, 0.1, -0.2, old[2]]
    core.gait.yaw[0] = [
        TURNED,
        0.3,
        0.1,
        0.12,
        0.4,
        0.2,
        TURNED,
    ]
    touch_down(core.physics, core.gait, 0)
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
    lever, missing = lever_and_missing(place, speed, plan, sign, growth, s)
    planned = np.array([0.03 + s.cmp_gain * 1.5, sign * (-0.02 - s.cmp_gain * 2.0)])
    np.testing.assert_allclose(lever, place - planned, atol=1e-15)
    cmp, dcm = planned + missing, np.array(place) + np.array(speed) / s.omega
    width = sign * 0.25
    goal = [0.15, width - width / (1.0 + math.exp(s.omega * 0.45))]
    np.testing.assert_allclose(cmp + growth * (dcm - cmp), goal, atol=1e-12)
