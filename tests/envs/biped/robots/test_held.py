"""Joints that keep their angle while the robot walks."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.compiled_robot import CompiledRobot, compiled_robot
from push_recovery.envs.robots.indices import MISSING
from push_recovery.envs.robots.variants import ARMS_HELD, LEGS_BELOW_A_YAW
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

ELBOW = -1.2  # [rad]


def with_held(*held):
    return replace(ARMS_HELD, plan=replace(ARMS_HELD.plan, held=held))


def elbow_torque(angle, rate):
    """What the left elbow's motor gives, the robot being told nothing [N m]."""
    model = compiled_robot(ARMS_HELD).model
    data = mujoco.MjData(model)
    data.joint("left_elbow").qpos[0], data.joint("left_elbow").qvel[0] = angle, rate
    mujoco.mj_forward(model, data)
    return data.actuator("left_elbow").force[0]


def test_the_torque_is_that_of_a_critically_damped_spring_within_the_motors():
    """Forearm: 0.008 kg m^2 + 1.2 kg x (0.12 m)^2, rotor 0.01 kg m^2; 60 rad/s."""
    inertia = 0.008 + 1.2 * 0.12**2 + 0.01
    assert elbow_torque(ELBOW, 0.0) == pytest.approx(0.0, abs=1e-9)
    assert elbow_torque(ELBOW + 0.1, 0.0) == pytest.approx(-inertia * 60.0**2 * 0.1)
    assert elbow_torque(ELBOW, -2.0) == pytest.approx(2.0 * inertia * 60.0 * 2.0)
    assert elbow_torque(ELBOW - 1.0, 0.0) == 40.0


def test_arms_keep_their_angles_through_a_push():
    episodes = BipedEpisodes(1, robot=ARMS_HELD)
    policy = make_policy("two-stage", episodes.robot, episodes.limits, "biped")
    episodes.begin(0, Scenario("push", (Push((0.0, 400.0, 0.0), 0.1, 0.5, "trunk"),)))
    wanted, off = [angle for _, angle in ARMS_HELD.plan.held], 0.0
    for _ in range(300):
        episodes.step(policy.predict(episodes.core.observation)[0].astype(np.float32))
        off = max(off, np.abs(episodes.core.physics.qpos[0, 21:] - wanted).max())
    assert 1e-4 < off < 0.1
    assert episodes.core.gait.failure[0] == 0


def test_what_is_believed_of_a_robot_has_its_arms_where_they_are():
    episodes = BipedEpisodes(1, robot=ARMS_HELD)
    episodes.begin(0, Scenario("heavy", errors=ModelErrors(payload=5.0)))
    episodes.step(np.zeros((1, 7), np.float32))
    core = episodes.core
    model, data = core.body.model, mujoco.MjData(core.body.model)  # without the payload
    data.qpos[:], data.qvel[:] = core.simulations.data[0].qpos, core.simulations.data[0].qvel
    mujoco.mj_forward(model, data)
    for j, own in enumerate(core.body.indices.dof):
        if own != MISSING:
            assert core.physics.bias[0, j] == pytest.approx(data.qfrc_bias[own], abs=1e-9)
    assert abs(core.simulations.data[0].qfrc_bias[2] - data.qfrc_bias[2]) > 40.0  # the payload's weight


@pytest.mark.parametrize(
    ("held", "said"),
    [
        (ARMS_HELD.plan.held[:-1], r"joint 'right_elbow' has no role in the BodyPlan; name it in `held`"),
        ((*ARMS_HELD.plan.held[:-1], ("right_elbow", 3.0)), r"'right_elbow' .*\[-2.6.*, 2.6.*\] rad, got 3"),
        ((*ARMS_HELD.plan.held, ("root", 0.0)), "'root' must be a hinge"),
    ],
)
def test_what_cannot_be_held_is_refused(held, said):
    with pytest.raises(InvalidValueError, match=said):
        CompiledRobot(with_held(*held))


def test_a_held_joint_needs_a_motor_and_a_name_that_exists():
    def unpowered():
        model = ARMS_HELD.spec()
        model.delete(model.actuator("left_elbow"))
        return model

    with pytest.raises(InvalidValueError, match="joint 'left_elbow' must have one motor, got 0"):
        CompiledRobot(replace(ARMS_HELD, spec=unpowered))
    with pytest.raises(UnknownNameError, match="left_elbow"):
        CompiledRobot(with_held(*ARMS_HELD.plan.held, ("left_elbwo", 0.0)))


def test_a_push_on_the_trunk_of_a_robot_in_one_body_is_one_on_its_pelvis():
    """Both bodies are one, so that the same force at the same point has the same outcome, to the last bit."""
    episodes = BipedEpisodes(3, robot=LEGS_BELOW_A_YAW)
    force, offset = (60.0, 40.0, 0.0), (0.0, 0.1, 0.05)
    for k, body in enumerate(("pelvis", "trunk")):
        episodes.begin(k, Scenario("push", (Push(force, 0.1, 0.02, body, offset),)))
    episodes.begin(2, Scenario("none"))
    for _ in range(30):
        episodes.step(np.zeros((3, 7), np.float32))
    pelvis, trunk, none = episodes.core.physics.qpos
    np.testing.assert_array_equal(pelvis, trunk)
    assert np.abs(pelvis - none).max() > 1e-3
