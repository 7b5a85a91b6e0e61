"""What the CoP at the edge of the sole keeps, and how far."""

import math

import numpy as np
import pytest
from push_recovery.controllers.whole_body.inverse_dynamics import Task, whole_body_torque
from push_recovery.controllers.whole_body.kinematics import (
    NU,
    base_angular_velocity,
    sole_motion,
    sole_position,
)
from push_recovery.controllers.whole_body.limits import (
    SHARE_OF_GRIP,
    centre_of_pressure,
    full_sole_force,
    kept_cop,
    make_bounds,
    missing_cmp,
    share_within,
)
from push_recovery.envs.biped.core import BIPED, BIPED_BOUNDS, BIPED_GAINS
from push_recovery.envs.scenario.scenario import Scenario

EDGE = 0.065
FAR = 1.0  # [m], more than any CoP may move
SETTINGS = BIPED_BOUNDS._replace(
    cop_x_max=EDGE, cop_y_max=1.0, yaw_friction=1e6, friction=10.0, force_min=-1e9
)
BOUNDS, _MEMORY = make_bounds(SETTINGS, np.full((2, NU), 1e9))


@pytest.mark.parametrize(("dcm", "goal", "cmp", "time"), [(0.3, 0.4, 0.1, 0.2), (-0.2, 0.1, -0.3, 0.4)])
def test_with_what_is_missing_the_dcm_meets_its_goal(dcm, goal, cmp, time):
    growth = math.exp(BIPED.omega * time)
    moved = cmp + missing_cmp(dcm, goal, cmp, growth)
    assert moved + (dcm - moved) * growth == pytest.approx(goal)


def test_at_touchdown_nothing_can_be_missing_without_bound():
    assert math.isfinite(missing_cmp(0.3, 0.1, 0.0, 1.0))


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
    foot = sole_motion(core.physics, 0, 1, base_angular_velocity(core.physics, 0))
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
    (before, aside), after = (centre_of_pressure(wrench, (1.0, 0.0)) for wrench in (back, kept))
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
    bounds, _memory = make_bounds(SETTINGS._replace(friction=0.5), np.full((2, NU), 1e9))
    fx, fy = full_sole_force(wrench, (1.0, 0.0), (EDGE, 0.0), (FAR, 0.0), 0.8, bounds)
    assert (wrench[0] + fx, fy) == pytest.approx((-SHARE_OF_GRIP * 0.5 * 600.0, 0.0))
    bounds.grip[0] = 0.4
    assert full_sole_force(wrench, (1.0, 0.0), (EDGE, 0.0), (FAR, 0.0), 0.8, bounds) == (0.0, 0.0)
    bounds.grip[0] = 0.8
    assert full_sole_force(wrench, (1.0, 0.0), (EDGE, 0.0), (FAR, 0.0), 0.8, bounds)[0] == pytest.approx(
        -600.0 / 0.8 * (EDGE + 30.0 / 600.0)
    )
    wrench[2] = -10.0
    assert full_sole_force(wrench, (1.0, 0.0), (EDGE, 0.0), (FAR, 0.0), 0.8, bounds) == (0.0, 0.0)
