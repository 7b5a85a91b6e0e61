"""PD torques and residuals, held against their formulas on robots in random states."""

import numpy as np
import pytest
from push_recovery.controllers.joint_control import (
    add_residual,
    count_effort,
    follow_targets,
    joint_constants,
)
from push_recovery.controllers.whole_body.limits import JOINT_TORQUE, NEVER, driving_share
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.joint.core import JointCore, JointResidualCore
from push_recovery.envs.robots.biped import biped


@pytest.fixture(scope="module")
def targets():
    return JointCore(1, BIPED, BIPED_LIMITS)


@pytest.fixture(scope="module")
def residual():
    core = JointResidualCore(1, BIPED, BIPED_LIMITS)
    core.scale_residual(0.5)
    return core


def put(core, random_state, seed, spread=0.2):
    """Put the robot in a random state; its joint angles and rates (14,)."""
    core.put(0, *random_state(np.random.default_rng(seed), spread))
    return core.physics.qpos[0, 7:].copy(), core.physics.qvel[0, 6:].copy()


def ranges(rates):
    """Least and largest torque of every motor at these rates, (14,) each."""
    top, free = biped().motors
    low = [-t * driving_share(-v, f) for t, v, f in zip(top, rates, free, strict=True)]
    high = [t * driving_share(v, f) for t, v, f in zip(top, rates, free, strict=True)]
    return np.array(low), np.array(high)


def test_an_action_of_one_asks_for_the_full_torque_of_each_motor_that_is_there():
    motors = np.array([[150.0, 80.0, NEVER], [20.0, 10.0, NEVER]])
    largest, stiffness, damping = joint_constants(motors)
    np.testing.assert_array_equal(largest, [150.0, 80.0, 0.0])
    np.testing.assert_array_equal(stiffness * 1.0, largest)  # over 1 rad
    np.testing.assert_allclose(damping, [3.0, 1.6, 0.0])


@pytest.mark.parametrize("seed", range(4))
def test_torques_are_those_of_pd_control_within_the_motors_range(targets, random_state, seed):
    angles, rates = put(targets, random_state, seed)
    joints, wanted = targets.joints, np.random.default_rng(seed).uniform(-1.0, 1.0, 14)
    joints.held[0] = wanted
    asked = joints.stiffness * (joints.posture + wanted - angles) - joints.damping * rates
    low, high = ranges(rates)
    met = follow_targets(targets.physics, 0, joints, targets._bounds[0][0])
    np.testing.assert_allclose(targets.physics.ctrl[0], np.clip(asked, low, high), atol=1e-10)
    assert bool(met) == bool(((asked <= low) | (asked >= high)).any())


def test_a_robot_at_its_targets_and_at_rest_is_asked_for_nothing(targets, random_state):
    qpos, qvel = random_state(np.random.default_rng(0))
    qpos[7:], qvel[6:] = targets.joints.posture, 0.0
    targets.put(0, qpos, qvel)
    targets.joints.held[0] = 0.0
    assert follow_targets(targets.physics, 0, targets.joints, targets._bounds[0][0]) == 0
    np.testing.assert_array_equal(targets.physics.ctrl[0], np.zeros(14))


def test_without_a_residual_torques_keep_their_bits_even_beyond_the_range(residual, random_state):
    put(residual, random_state, 1)
    torque = np.random.default_rng(2).normal(0.0, 500.0, 14)
    residual.physics.ctrl[0], residual.joints.held[0] = torque, 0.0
    assert add_residual(residual.physics, 0, residual.joints, residual._bounds[0][0]) == 0
    assert residual.physics.ctrl[0].tobytes() == torque.tobytes()


@pytest.mark.parametrize(("share", "met"), [(0.1, 0), (1.0, JOINT_TORQUE)])
def test_a_residual_is_a_share_of_the_largest_torque_and_the_sum_stays_in_range(
    residual, random_state, share, met
):
    _, rates = put(residual, random_state, 3, 0.01)
    low, high = ranges(rates)
    residual._bounds[0][0].torque_range[:] = low, high
    torque = 0.6 * high
    residual.physics.ctrl[0], residual.joints.held[0] = torque, share
    assert add_residual(residual.physics, 0, residual.joints, residual._bounds[0][0]) == met
    expected = np.minimum(torque + share * 0.5 * biped().motors[0], high)
    np.testing.assert_allclose(residual.physics.ctrl[0], expected, atol=1e-12)


def test_effort_is_the_mean_square_of_the_shares_of_the_torques(residual):
    residual.joints.effort[0] = 0.0
    for share in (0.5, 1.0):
        residual.physics.ctrl[0] = share * biped().motors[0] * np.where(np.arange(14) % 2, 1.0, -1.0)
        count_effort(residual.physics, 0, residual.joints, 0.5)
    assert residual.joints.effort[0] == pytest.approx(14 * 0.5 * (0.25 + 1.0))
