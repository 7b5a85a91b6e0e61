"""Steps told by the loads under the feet, on histories of loads written by hand."""

import numpy as np
import pytest
from push_recovery.controllers.joint_control import LIFTED, follow_contacts, hold_nominal
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.model.observation import COMMAND
from push_recovery.controllers.whole_body.gait_machine import resting_gait
from push_recovery.envs.biped.core import BIPED, BIPED_GAIT, BIPED_LIMITS
from push_recovery.envs.joint.core import JointCore

T, DT = 0.3, 0.002
STANDS, SHARED, FREE = 590.0, 295.0, 0.0  # loads [N]


@pytest.fixture(scope="module")
def core():
    made = JointCore(1, BIPED, BIPED_LIMITS)
    qpos = np.zeros(21)
    qpos[2], qpos[3], qpos[7:] = 0.75, 1.0, made.joints.posture
    made.put(0, qpos, np.zeros(20))
    return made


def steps(core, loads, turn=0.0):
    """Times of touchdowns [s] under a history of loads (left, right) [N], a row a physics step."""
    gait, found = resting_gait(1), []
    gait.plan[0, 2], gait.turn[0] = T, turn
    core.joints.lifted[0], core.joints.air[0] = 0, 0
    for i, row in enumerate(loads):
        core.physics.load[0] = row
        before = gait.steps.item(0)
        follow_contacts(core.physics, gait, 0, BIPED_GAIT, core.joints)
        if gait.steps.item(0) != before:
            found.append(i * DT)
        gait.elapsed[0] += DT
    return found, gait


def held(left, right, seconds):
    return [(left, right)] * round(seconds / DT)


def test_a_robot_that_stands_on_both_feet_makes_no_steps(core):
    assert steps(core, held(SHARED, SHARED, 3.0))[0] == []


def test_a_foot_that_was_lifted_and_lands_near_t_ends_the_step(core):
    lands = held(SHARED, SHARED, 0.05) + held(STANDS, FREE, 0.25) + held(SHARED, SHARED, 0.5)
    found, gait = steps(core, lands)
    assert found == [pytest.approx(0.3)]
    assert gait.stance[0] == 1


def test_the_new_swing_foot_has_to_be_lifted_in_its_turn(core):
    one = held(STANDS, FREE, 0.3) + held(SHARED, SHARED, 0.1)
    two = held(FREE, STANDS, 0.25) + held(SHARED, SHARED, 0.5)
    assert steps(core, one + two)[0] == [pytest.approx(0.3), pytest.approx(0.65)]


def test_light_load_long_before_t_is_no_touchdown_and_heavy_load_late_is(core):
    graze, landing = 0.5 * BIPED_GAIT.forced_load, 2.0 * BIPED_GAIT.forced_load
    late = BIPED_GAIT.forced_phase * T
    rest = held(STANDS, FREE, 0.02)
    grazes = held(STANDS, FREE, 0.1) + held(STANDS, graze, 0.1) + rest
    assert steps(core, grazes)[0] == []
    early = held(STANDS, FREE, 0.1) + held(STANDS, landing, 0.2)
    assert steps(core, early)[0] == [pytest.approx(late, abs=DT)]


def test_a_foot_that_loses_its_load_for_a_moment_was_not_lifted(core):
    for count, made in ((LIFTED - 1, 0), (LIFTED, 1)):
        loads = held(SHARED, SHARED, 0.1) + [(STANDS, FREE)] * count + held(SHARED, SHARED, 0.5)
        assert len(steps(core, loads)[0]) == made


def test_a_robot_that_lifts_its_stance_foot_stands_on_the_other(core):
    found, gait = steps(core, held(SHARED, SHARED, 0.1) + held(FREE, STANDS, 0.4))
    assert found == [pytest.approx(BIPED_GAIT.forced_phase * T, abs=DT)]
    assert gait.stance[0] == 1


def test_the_heading_goes_on_by_what_the_command_asked_for_in_the_step(core):
    _, gait = steps(core, held(STANDS, FREE, 0.3) + held(SHARED, SHARED, 0.1), turn=0.5)
    assert gait.heading[0] == pytest.approx(0.15)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.4, 0.0), (-0.2, 0.1)])
def test_the_plan_that_is_held_is_the_nominal_gait_of_the_command(core, velocity):
    gait, observation = resting_gait(1), np.zeros(36)
    observation[COMMAND], gait.plan[0] = velocity, 1.0
    hold_nominal(gait, 0, observation, core.joints.gait)
    delay = core.joints.gait[2]
    nominal = nominal_gait(BIPED, BIPED_LIMITS, velocity, delay)
    expected = [nominal.length, nominal.width, nominal.duration, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(gait.plan[0], expected, atol=1e-15)
