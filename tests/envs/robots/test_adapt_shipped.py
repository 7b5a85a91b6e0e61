"""G1, T1 and JVRC-1: what their packages say they are, as environments, and that they walk."""

from importlib.util import find_spec

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import KNEE, sole_position
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.biped.model_errors import altered_model
from push_recovery.envs.robots.compiled_robot import compiled_robot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.robots.model_files import PACKAGES
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario

MISSING = [name for name in PACKAGES if find_spec(name) is None]
pytestmark = pytest.mark.skipif(
    bool(MISSING), reason=f"needs pip install 'push-recovery[robots]': {', '.join(MISSING)} not there"
)
# mass [kg], waist, degrees of freedom of the joints that control knows and of the held ones
ABOUT = {
    "g1": (33.341, (True, True), 14, 9),
    "t1": (31.614, (False, False), 12, 9),
    "jvrc1": (62.4, (True, True), 14, 9),
}
NAMES = {"g1": "G1", "t1": "T1", "jvrc1": "JVRC1"}


@pytest.mark.parametrize("name", ABOUT)
def test_it_is_the_robot_of_its_package(name):
    mass, waist, moving, held = ABOUT[name]
    body = compiled_robot(robot_description(name))
    assert body.robot.mass == pytest.approx(mass, abs=1e-3)
    assert (body.robot.trunk_pitch, body.robot.trunk_roll) == waist
    assert body.model.nv == 6 + moving + held
    assert body.model.nmesh == 0
    floor = body.model.geom("floor").id
    assert [body.model.pair_geom1[i] for i in range(2)] == [floor, floor]


@pytest.mark.parametrize(("name", "joint", "torque", "speed"), [
    ("g1", "left_knee_joint", 139.0, 20.0), ("g1", "right_ankle_roll_joint", 50.0, 37.0),
    ("t1", "Left_Knee_Pitch", 60.0, 14.76), ("t1", "Right_Ankle_Roll", 15.0, 12.57),
])  # fmt: skip
def test_its_motors_are_those_of_the_table(name, joint, torque, speed):
    body = compiled_robot(robot_description(name))
    place = [body.model.actuator(i).name if i >= 0 else "" for i in body.indices.motors].index(joint)
    assert body.motors[:, place].tolist() == [torque, speed]


@pytest.mark.parametrize("name", ABOUT)
def test_it_is_drawn_with_the_same_joints(name):
    body = compiled_robot(robot_description(name))
    joints = [[model.joint(i).name for i in range(model.njnt)] for model in (body.model, body.picture)]
    assert joints[0] == joints[1]
    assert body.picture.ngeom > body.model.ngeom + 10
    assert not body.picture.geom_contype.any()


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version.*", "ignore:.*Box obs.*")
@pytest.mark.parametrize("name", ABOUT)
def test_the_checkers_of_gymnasium_and_stable_baselines_pass(name):
    env = gym.make(f"push_recovery:PushRecovery/{NAMES[name]}-v0")
    check_env(env.unwrapped, skip_render_check=True)
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(env, warn=False, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("form", ["", "Residual", "Joint", "JointResidual"])
def test_robots_of_a_vector_are_those_alone(form):
    env_id = f"push_recovery:PushRecovery/G1{form}-v0"
    vector = gym.make_vec(env_id, num_envs=2, vectorization_mode="vector_entry_point", threads=2)
    alone = [gym.make(env_id) for _ in range(2)]
    together, _ = vector.reset(seed=5)  # and 6
    for k, env in enumerate(alone):
        assert env.reset(seed=5 + k)[0].tobytes() == together[k].tobytes()
    rng = np.random.default_rng(0)
    for _ in range(10):
        actions = rng.uniform(-0.2, 0.2, vector.action_space.shape).astype(np.float32)
        together = vector.step(actions)[0]
        for k, env in enumerate(alone):
            assert env.step(actions[k])[0].tobytes() == together[k].tobytes()
    vector.close()


@pytest.mark.parametrize("name", ABOUT)
def test_it_walks_in_all_directions(name):
    commands = [Command(), Command(0.3), Command(-0.2), Command(0.0, 0.1), Command(0.0, -0.1)]
    episodes = BipedEpisodes(len(commands), robot=name)
    policy = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    for k, command in enumerate(commands):
        episodes.begin(k, Scenario(f"walk-{k}", (), command))
    for _ in range(400):
        episodes.step(policy.predict(episodes.core.observation)[0].astype(np.float32))
    assert not episodes.failure().any()
    gone = episodes.core.com
    assert gone[1, 0] > 0.6
    assert gone[2, 0] < -0.4
    assert gone[3, 1] - gone[4, 1] > 0.4


@pytest.mark.parametrize(
    ("name", "mass", "sole"), [("berkeley", 16.057, (0.16, 0.055)), ("op3", 3.147, (0.127, 0.078))]
)
def test_small_robots_walk_too(name, mass, sole):
    """The Berkeley Humanoid, whose feet lean with all joints at 0, and OP3, whose joints have no ranges."""
    episodes = BipedEpisodes(3, robot=name)
    assert episodes.robot.mass == pytest.approx(mass, abs=1e-3)
    assert (episodes.robot.foot_length, episodes.robot.foot_width) == pytest.approx(sole)
    policy = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    for k, command in enumerate((Command(), Command(0.15), Command(-0.1))):
        episodes.begin(k, Scenario(f"walk-{k}", (), command))
    for _ in range(400):
        episodes.step(policy.predict(episodes.core.observation)[0].astype(np.float32))
    assert not episodes.failure().any()
    gone = episodes.core.com[:, 0]
    assert abs(gone[0]) < 0.1
    assert gone[1] > 0.4
    assert gone[2] < -0.25


def test_g1_brings_back_a_foot_that_was_thrown_as_far_as_its_leg_is_long():
    """The punch takes the knee beyond straight; a knee held there let the foot rise to 0.8 m behind it."""
    episodes = BipedEpisodes(1, robot="g1")
    policy = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    ankle = (-0.026505, 0.0, 0.016425)
    punch = Push((-347.134, -281.672, -135.435), 0.08, 2.2854, "right_foot", ankle)
    episodes.begin(0, Scenario("thrown", (punch,), Command(0.011827463367421825)))
    heights, straightest = [], np.inf
    knee = int(episodes.core.body.indices.legs_qpos[1][KNEE])
    while episodes.motion().time[0] < 4.5 and not episodes.failure().any():
        episodes.step(policy.predict(episodes.core.observation)[0].astype(np.float32))
        state = episodes.core.true_state(0)
        heights.append(sole_position(state, 0, 1)[2])
        straightest = min(straightest, float(episodes.core.simulations.data[0].qpos[knee]))
    assert not episodes.failure().any()
    assert straightest < -0.05
    assert max(heights) < 0.25


@pytest.mark.parametrize("name", ABOUT)
def test_its_posture_stands_on_both_soles(name):
    env = gym.make(f"push_recovery:PushRecovery/{NAMES[name]}-v0").unwrapped
    env.reset(options={"scenario": Scenario("stand")})
    body, data = env.core.body, env.core.simulations.data[0]
    mujoco.mj_kinematics(body.model, data)
    for site in body.indices.soles:
        assert abs(data.site_xpos[site, 2]) < 1e-9
        np.testing.assert_allclose(data.site_xmat[site].reshape(3, 3), np.eye(3), atol=1e-8)
    assert data.subtree_com[0, 2] == pytest.approx(body.robot.com_height, abs=1e-9)


@pytest.mark.parametrize("roll", [-0.2618, 0.2618])
@pytest.mark.parametrize("side", ["left", "right"])
def test_g1_bends_its_ankles_as_far_as_they_go_where_legs_collide(side, roll):
    """A link lies between foot and shank, so that MuJoCo does not take one for the other's parent."""
    body = compiled_robot(robot_description("g1"))
    model = altered_model(body, ModelErrors(collisions=True))
    assert model is not None
    data = mujoco.MjData(model)
    data.qpos[:] = body.in_reference_posture().qpos
    data.qpos[2] += 1.0
    data.joint(f"{side}_ankle_pitch_joint").qpos[0] = model.joint(f"{side}_ankle_pitch_joint").range[0]
    data.joint(f"{side}_ankle_roll_joint").qpos[0] = roll
    mujoco.mj_forward(model, data)
    assert not data.ncon
    data.qpos[:] = body.in_reference_posture().qpos
    data.joint(f"{side}_hip_roll_joint").qpos[0] = -0.3 if side == "left" else 0.3
    mujoco.mj_forward(model, data)
    met = {tuple(sorted(model.body(model.geom_bodyid[g]).name for g in one.geom)) for one in data.contact}
    other = "right" if side == "left" else "left"
    assert tuple(sorted((f"{side}_ankle_roll_link", f"{other}_knee_link"))) in met
