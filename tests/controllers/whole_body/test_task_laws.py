"""What the tasks ask for, written out by hand on a robot that stands straight and moves a little."""

import math

import numpy as np
import pytest
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.whole_body.inverse_dynamics import (
    Task,
    base_angular_acceleration,
    com_force,
    stance_acceleration,
    swing_acceleration,
)
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY, PELVIS, SoleMotion
from push_recovery.envs.biped.core import BIPED
from push_recovery.envs.biped.core import BIPED_GAINS as G
from push_recovery.envs.robots.biped import biped_model

MODEL = biped_model()
ZERO = (0.0, 0.0, 0.0)
OMEGA, SPEED = (0.1, -0.2, 0.3), (0.4, -0.5, 0.6)  # [rad/s], [m/s]
YAW = (0.02, 0.05, 0.7)  # beyond the heading [rad], its rate, its acceleration
SMALL = 1e-3  # [rad]


def task(swing=None, facing=(1.0, 0.0), height=ZERO, swing_yaw=ZERO, pelvis_yaw=ZERO, com=(0.0, 0.0)) -> Task:
    return Task(
        0, com, height, facing, np.zeros(9) if swing is None else swing, (0.0, 0.0), swing_yaw, pelvis_yaw
    )


@pytest.fixture
def upright(robot_in):
    """The robot with all joints at zero, and a function that leans one of its bodies."""
    core, _ = robot_in(MODEL.qpos0.copy(), np.zeros(MODEL.nv))
    straight = np.eye(3)

    def lean(body: int, rotation: np.ndarray) -> None:
        core.physics.xmat[0, body] = (rotation @ straight).ravel()

    for body in (PELVIS, *FOOT_BODY):
        lean(body, straight)
    return core.physics, lean


def turned(axis: int, angle: float) -> np.ndarray:
    """Rotation about a world axis."""
    cos, sin = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i], out[i, j], out[j, i], out[j, j] = cos, -sin, sin, cos
    return out


def test_the_pelvis_is_turned_against_its_lean_and_its_rate(upright):
    phys, lean = upright
    found = base_angular_acceleration(phys, 0, OMEGA, task(pelvis_yaw=YAW), G)
    heading = G.heading_kp * 0.02 - G.heading_kd * (0.3 - 0.05) + 0.7
    np.testing.assert_allclose(found, [-0.1 * G.pelvis_kd, 0.2 * G.pelvis_kd, heading], atol=1e-12)
    for axis, gain in enumerate((G.pelvis_kp, G.pelvis_kp, G.heading_kp)):
        lean(PELVIS, turned(axis, SMALL))
        expected = np.zeros(3)
        expected[axis] = -gain * SMALL
        np.testing.assert_allclose(base_angular_acceleration(phys, 0, ZERO, task(), G), expected, atol=1e-3)


def test_the_heading_is_that_of_the_task(upright):
    phys, _ = upright
    facing = (math.cos(0.3), math.sin(0.3))  # to the left of where the pelvis faces
    found = base_angular_acceleration(phys, 0, ZERO, task(facing=facing), G)
    np.testing.assert_allclose(found, [0.0, 0.0, 0.3 * G.heading_kp], atol=1e-12)


def test_the_stance_foot_is_braked_and_levelled_and_does_not_turn_back(upright):
    phys, lean = upright
    foot = SoleMotion(ZERO, SPEED, OMEGA, ZERO, ZERO)
    linear, angular = stance_acceleration(phys, 0, foot, task(), G)
    np.testing.assert_allclose(linear, -G.stance_kd * np.array(SPEED), atol=1e-12)
    np.testing.assert_allclose(angular, -G.stance_kd * np.array(OMEGA), atol=1e-12)
    still = SoleMotion(ZERO, ZERO, ZERO, ZERO, ZERO)
    for axis, gain in enumerate((G.stance_kp, G.stance_kp, 0.0)):
        lean(FOOT_BODY[0], turned(axis, SMALL))
        expected = np.zeros(3)
        expected[axis] = -gain * SMALL
        np.testing.assert_allclose(stance_acceleration(phys, 0, still, task(), G)[1], expected, atol=1e-3)


def test_the_swing_sole_follows_its_reference(upright):
    phys, lean = upright
    reference = np.array([0.01, -0.02, 0.03, 0.1, 0.2, -0.1, 1.0, -2.0, 3.0])
    foot = SoleMotion((0.02, 0.01, 0.0), (0.3, 0.1, 0.2), OMEGA, ZERO, ZERO)
    linear, angular = swing_acceleration(phys, 0, foot, task(reference, swing_yaw=YAW), G)
    kp, kd = G.swing_kp, G.swing_kd
    expected = [1.0 - 0.01 * kp - 0.2 * kd, -2.0 - 0.03 * kp + 0.1 * kd, 3.0 + 0.03 * kp - 0.3 * kd]
    assert math.hypot(*expected[:2]) < G.swing_max
    np.testing.assert_allclose(linear, expected, atol=1e-12)
    kp, kd = G.swing_turn_kp, G.swing_turn_kd
    np.testing.assert_allclose(angular, [-0.1 * kd, 0.2 * kd, 0.02 * kp - 0.25 * kd + 0.7], atol=1e-12)
    lean(FOOT_BODY[1], turned(1, SMALL))
    found = swing_acceleration(phys, 0, foot, task(reference, swing_yaw=YAW), G)[1]
    np.testing.assert_allclose(np.subtract(found, angular), [0.0, -kp * SMALL, 0.0], atol=1e-3)


def test_what_is_asked_of_the_swing_sole_is_bounded_sideways_alone(upright):
    phys, _ = upright
    reference = np.zeros(9)
    reference[6:] = 3.0 * G.swing_max, -4.0 * G.swing_max, 5.0 * G.swing_max
    still = SoleMotion(ZERO, ZERO, ZERO, ZERO, ZERO)
    linear, _ = swing_acceleration(phys, 0, still, task(reference), G)
    np.testing.assert_allclose(linear, np.array([0.6, -0.8, 5.0]) * G.swing_max, rtol=1e-12)


def test_the_force_on_the_com_carries_it_and_brings_it_to_its_height(upright):
    phys, _ = upright
    com = phys.com[0, 0, 2]
    asked = task(height=(com - 0.1 + 0.02, 0.3, 0.5), com=(1.0, -2.0))
    found = com_force(phys, 0, asked, (0.0, 0.0, 0.1), 0.2, G)  # the sole is 0.1 m up, the CoM climbs
    lift = 0.5 + 0.02 * G.height_kp + (0.3 - 0.2) * G.height_kd
    np.testing.assert_allclose(found, BIPED.mass * np.array([1.0, -2.0, GRAVITY + lift]), rtol=1e-9)
