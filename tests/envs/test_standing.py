"""Robots that stand: at rest, caught in place or by a step, and on their way into a walk and back."""

import json
import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.observation import ON_BOTH_FEET, SWING_CONTACT, SWING_POSITION
from push_recovery.controllers.model.standing import max_standing_force
from push_recovery.controllers.policies import two_stage
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY, LEG_JOINT, PELVIS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import GaitEvent, Kick, Push
from push_recovery.envs.scenario.scenario import HARDWARE, Command, CommandChange, Scenario

from push_recovery import make_policy

STAND = Command(stand=True)
PENDULUM, BIPED = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0"
ROBOTS = [PENDULUM, BIPED, "PushRecovery/G1-v0", "PushRecovery/T1-v0", "PushRecovery/JVRC1-v0"]


@pytest.fixture(scope="module")
def stage():
    """An environment and its planner by id and name, made once."""
    made = {}

    def get(name, policy="two-stage"):
        if name not in made:
            made[name] = gym.make(name).unwrapped
        if (name, policy) not in made:
            made[name, policy] = make_policy(policy, made[name])
        return made[name], made[name, policy]

    yield get
    for env in made.values():
        if isinstance(env, gym.Env):
            env.close()


def walked(env, policy, scenario):
    """Observation and DCM in the world after every period, and whether the robot fell."""
    seen, _ = env.reset(options={"scenario": scenario})
    observations, dcm, over = [seen], [], False
    while not over:
        seen, _, fell, late, _ = env.step(policy.predict(seen)[0])
        observations.append(seen)
        dcm.append(env.core.world[0, :2].copy())
        over = fell or late
    return np.array(observations), np.array(dcm), fell


def pushed(force, psi, command=STAND, **changes):
    vector = force * math.cos(psi), force * math.sin(psi), 0.0
    return Scenario("pushed", (Push(vector, 0.1, 0.5),), command, duration=5.0, **changes)


@pytest.mark.parametrize("command", [STAND, Command()])
def test_a_kicked_robot_steps_to_the_end_of_its_box_and_stays_up(stage, command):
    """And whatever it plans, its environment means the same step."""
    env, policy = stage("PushRecovery/G1-v0")
    kicks, errors = (Kick((2.0, 0.0, 0.0), 0.5),), ModelErrors(collisions=True)
    scenario = Scenario("kick", (), command, duration=4.0, kicks=kicks, errors=errors)
    seen, _ = env.reset(options={"scenario": scenario})
    longest, over = 0.0, False
    while not over:
        plan = policy.plan(seen)
        seen, _, fell, late, _ = env.step(policy.predict(seen)[0])
        over, held = fell or late, env.core.gait.plan[0]
        if plan.duration - seen[0] > 0.1 and seen[0] > 0.0:
            assert held[:3] == pytest.approx(plan.gait[:3], abs=1e-6)
            longest = max(longest, plan.step[0])
    assert longest == pytest.approx(env.limits.length_max, abs=1e-6)
    assert not fell


def test_the_box_of_steps_is_within_the_reach_of_both_legs(stage):
    """Hips as low as the CoM may sink, each leg as far ahead, behind or aside as it is long."""
    env, _ = stage("PushRecovery/G1-v0")
    env.reset(options={"scenario": Scenario("stand", (), STAND)})
    s, state, limits = env.core.gait_settings, env.core.true_state(0), env.limits
    above_com = state.xanchor[0, LEG_JOINT[0], 2] - state.com[0, 0, 2]
    hip = s.com_height - s.height_drop + above_com - state.ankle_height[0]
    reach = 2.0 * math.sqrt(s.reach**2 - hip**2)
    assert 0.8 * reach < limits.length_max < reach
    assert -reach < limits.length_min < -0.7 * reach
    assert 0.7 * reach < limits.width_max - env.episodes.robot.pelvis_width < reach


@pytest.mark.parametrize("name", ROBOTS)
def test_nothing_moves_at_rest(stage, name):
    env, policy = stage(name)
    observations, dcm, fell = walked(env, policy, Scenario("rest", (), STAND, duration=5.0))
    assert not fell
    assert (observations[:, 0] == ON_BOTH_FEET).all()
    assert (observations[1:, SWING_CONTACT] == 1.0).all()
    assert np.abs(dcm - dcm[0]).max() < 2e-3
    middle = 0.5 * env.episodes.robot.pelvis_width
    assert observations[-1, SWING_POSITION][:2] == pytest.approx([0.0, 2.0 * middle], abs=2e-3)


def test_noise_and_delay_make_no_step(stage):
    env, policy = stage(BIPED)
    scenario = HARDWARE.applied(Scenario("rest", (), STAND, duration=5.0, noise_seed=3))
    observations, dcm, fell = walked(env, policy, scenario)
    assert not fell
    assert (observations[:, 0] == ON_BOTH_FEET).all()
    assert np.abs(dcm - dcm[0]).max() < 0.02


@pytest.mark.parametrize(
    ("name", "degrees"),
    # aside the paper's step box reaches no farther than the hull of two soles
    [*((BIPED, d) for d in (0, 65, 90, 180, 270)), *((PENDULUM, d) for d in (0, 30, 180, 200))],
)
def test_a_push_within_the_limit_is_caught_in_place_and_a_larger_one_by_steps(stage, name, degrees):
    env, policy = stage(name)
    psi = math.radians(degrees)
    limit = max_standing_force(env.episodes.robot, psi)
    observations, _, fell = walked(env, policy, pushed(0.85 * limit, psi))
    assert not fell
    assert (observations[:, 0] == ON_BOTH_FEET).all()
    observations, dcm, fell = walked(env, policy, pushed(1.15 * limit, psi))
    assert not fell
    steps = (observations[:, 0] >= 0.0).sum()
    assert 0 < steps < 300
    assert observations[-1, 0] == ON_BOTH_FEET  # it stands again, somewhere else
    assert np.hypot(*(dcm[-1] - dcm[0])) > 0.05


@pytest.mark.parametrize("name", [PENDULUM, BIPED])
def test_what_each_part_may_use_decides_what_it_catches(stage, name):
    """Soles and trunk, soles alone, steps alone: 0.85 of the limit of both, forward."""
    env, _ = stage(name)
    force = 0.85 * max_standing_force(env.episodes.robot, 0.0)
    stepped = {}
    for part in ("two-stage", "stage-1+cop", "stage-1"):
        observations, _, _ = walked(env, stage(name, part)[1], pushed(force, 0.0))
        stepped[part] = (observations[:, 0] >= 0.0).any()
    assert stepped == {"two-stage": False, "stage-1+cop": True, "stage-1": True}


@pytest.mark.parametrize("name", [PENDULUM, BIPED])
def test_mirrored_pushes_have_mirrored_answers(stage, name):
    env, policy = stage(name)
    robot = env.episodes.robot
    one = pushed(1.2 * max_standing_force(robot, 0.5), 0.5)
    (left, dcm, _), (right, other, _) = walked(env, policy, one), walked(env, policy, one.mirrored())
    assert right == pytest.approx(left, abs=2e-3)
    assert other[:, 0] == pytest.approx(dcm[:, 0], abs=2e-3)
    assert other[:, 1] == pytest.approx(-dcm[:, 1], abs=2e-3)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(("degrees", "stays"), [(90.0, 1), (-90.0, 0)])
def test_a_push_aside_is_answered_by_the_foot_on_its_far_side(stage, side, degrees, stays):
    env, policy = stage(BIPED)
    psi = math.radians(degrees)
    force = 1.2 * max_standing_force(env.episodes.robot, psi)
    seen, _ = env.reset(options={"scenario": pushed(force, psi, stance_side=side)})
    while seen[0] < 0.0:
        seen, *_ = env.step(policy.predict(seen)[0])
    assert env.episodes.motion().side[0] == stays


@pytest.mark.parametrize("name", [PENDULUM, BIPED])
def test_it_starts_walks_and_stands_again(stage, name):
    env, policy = stage(name)
    walk = CommandChange(1.0, Command(vx=0.3)), CommandChange(5.0, STAND)
    turn = CommandChange(9.0, Command()), CommandChange(12.0, STAND)  # to step in place, and back
    scenario = Scenario("tour", (), STAND, changes=walk + turn, duration=15.0)
    observations, dcm, fell = walked(env, policy, scenario)
    assert not fell
    stands = observations[1:, 0] == ON_BOTH_FEET
    time = 0.01 * (np.arange(len(stands)) + 1.0)
    for start, end, standing in ((0.0, 1.0, True), (2.0, 5.0, False), (7.0, 9.0, True), (9.5, 12.0, False)):
        inside = stands[(time > start + 0.005) & (time < end)]
        assert inside.all() if standing else not inside.any()
    assert stands[-1]
    speed = (dcm[490, 0] - dcm[290, 0]) / 2.0
    assert speed == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize(
    ("side", "body", "stays"), [("left", "left", 1), ("left", "right", 0), ("right", "left", 1)]
)
def test_a_foot_that_is_thrown_off_the_floor_steps_whichever_was_the_stance_foot(stage, side, body, stays):
    env, policy = stage(BIPED)
    push = Push((0.0, 0.0, 700.0), 0.08, 0.5, f"{body}_foot", (0.0, 0.0, 0.0))
    scenario = Scenario("thrown", (push,), STAND, duration=4.0, stance_side=side)
    seen, _ = env.reset(options={"scenario": scenario})
    while seen[0] < 0.0:
        seen, *_ = env.step(policy.predict(seen)[0])
    assert env.episodes.motion().side[0] == stays
    observations, _, fell = walked(env, policy, scenario)
    assert not fell
    assert observations[-1, 0] == ON_BOTH_FEET


def test_a_robot_that_is_asked_for_a_step_lifts_the_foot_that_the_cop_is_away_from(stage):
    env, _ = stage(PENDULUM)
    half = env.episodes.limits.cop_y_max
    for share, side in ((-0.9, 0), (0.9, 1)):  # towards the stance foot, the left one, and away from it
        env.reset(options={"scenario": Scenario("rest", (), STAND, duration=5.0)})
        action = np.array([0.0, 0.0, -1.0, 0.0, share, 0.0, 0.0], np.float32)
        seen, *_ = env.step(action)
        assert seen[0] == pytest.approx(0.01)
        assert env.core.state.side[0] == side
        cop = env.core.state.cop[0] - env.core.state.stance[0]
        assert abs(cop[1]) <= half + 1e-12
        if side == 0:  # the frame stays, and y points to the right
            middle = 0.5 * env.episodes.robot.pelvis_width
            asked = middle + share * (middle + half)
            assert cop[1] == pytest.approx(np.clip(-asked, -half, half))


def test_a_command_to_stand_has_no_velocity_and_stays_in_its_file():
    with pytest.raises(
        InvalidValueError, match=r"Command.stand needs vx = vy = turn = 0, got Command\(vx=0.1"
    ):
        Command(0.1, stand=True)
    with pytest.raises(InvalidValueError, match=r"Command\.stand must be"):
        Command(stand=1)
    scenario = pushed(100.0, 0.0)
    text = json.dumps(scenario.to_dict())
    assert Scenario.from_dict(json.loads(text)) == scenario
    assert "stand" not in json.dumps(pushed(100.0, 0.0, Command()).to_dict()["command"])
    assert scenario.mirrored().command.stand


def test_joint_environments_step_in_place_where_they_are_to_stand():
    """Bit for bit as under the scenario of steps in place, and again from a snapshot."""
    told = replace(
        pushed(100.0, 0.0), stride=0.1, changes=(CommandChange(0.1, Command(0.2)), CommandChange(0.2, STAND))
    )
    stepping = replace(
        told,
        command=Command(),
        stride=0.0,
        changes=(CommandChange(0.1, Command(0.2)), CommandChange(0.2, Command())),
    )
    actions = np.random.default_rng(3).uniform(-0.1, 0.1, (20, 14)).astype(np.float32)

    def motion(scenario, back=None):
        """Observations after each action; `back`: a scenario in which the robot is put back half-way."""
        env = gym.make("PushRecovery/BipedJoint-v0").unwrapped
        seen = [env.reset(options={"scenario": scenario})[0]]
        for i, action in enumerate(actions):
            if back is not None and i == 10:
                env.episodes.restore(0, env.episodes.state_snapshot(0), back)
            seen.append(env.step(action)[0])
        env.close()
        return np.array(seen)

    wanted = motion(stepping)
    np.testing.assert_array_equal(motion(told), wanted)
    np.testing.assert_array_equal(motion(told, told), wanted)


def test_corrections_of_torques_act_in_the_steps_of_a_stander_alone(stage):
    """On both feet the planner's motion passes bit for bit, under an action of 1 in every entry."""
    env, policy = stage(BIPED)
    corrected = gym.make("PushRecovery/BipedJointResidual-v0").unwrapped
    scenario = pushed(650.0, 0.3)
    seen, _ = env.reset(options={"scenario": scenario})
    corrected.reset(options={"scenario": scenario})
    feet, equal = [], []
    for _ in range(100):
        feet.append(seen[0] == ON_BOTH_FEET)
        seen = env.step(policy.predict(seen)[0])[0]
        corrected.step(np.ones(14, np.float32))
        qpos = [one.core.simulations.data[0].qpos for one in (env, corrected)]
        equal.append(np.array_equal(*qpos))
    lifts = feet.index(False)
    assert lifts > 50
    assert all(equal[:lifts])
    assert not equal[-1]
    corrected.close()


def test_soles_do_not_stay_turned_by_a_push_beside_the_com(stage):
    """They stay turned by 25 degrees if a sole at its corner is trusted to resist yaw; the robot stoops."""
    env, policy = stage(BIPED)
    push = Push((268.4, 209.4, 0.0), 0.0994, 0.5924, "pelvis", (0.0075, 0.0994, 0.0368))
    scenario = Scenario("beside", (push,), STAND, "left", stride=0.1886)
    seen, _ = env.reset(options={"scenario": scenario})
    yaws, over = [], False
    while not over:
        seen, _, fell, late, info = env.step(policy.predict(seen)[0])
        if seen[0] < 0.0:
            axes = env.core.physics.xmat[0, FOOT_BODY].reshape(2, 9)
            yaws.append(np.arctan2(axes[:, 3], axes[:, 0]))
        over = fell or late
    assert not fell
    assert info["recovered_at"] is not None
    assert np.abs(yaws[-1]).max() < math.radians(5.0)


def test_at_rest_the_cop_is_under_the_com(stage):
    env, policy = stage(BIPED)
    walked(env, policy, Scenario("rest", (), STAND, duration=1.0))
    assert env.core.world[0, 2:4] == pytest.approx(env.core.world[0, :2], abs=0.01)


@pytest.mark.parametrize("yaw", [0.2, -0.2])
def test_the_pelvis_of_a_stander_points_between_its_soles(stage, yaw):
    env, policy = stage(BIPED)
    seen, _ = env.reset(options={"scenario": Scenario("rest", (), STAND, duration=5.0)})
    env.core.gait.yaw[0, 0] = yaw  # the other sole counts as turned by so much
    for _ in range(150):
        seen, *_ = env.step(policy.predict(seen)[0])
    axes = env.core.physics.xmat[0, PELVIS]
    assert math.atan2(axes[3], axes[0]) == pytest.approx(0.5 * yaw, abs=0.02)


def test_a_step_that_begins_has_begun_for_a_stander_and_goes_no_further():
    episodes = BipedEpisodes(3)
    for k, event in enumerate((GaitEvent(0, "left"), GaitEvent(0, "left", 0.5), GaitEvent(1, "right"))):
        push = Push((5.0, 0.0, 0.0), 0.1, event)
        episodes.begin(k, Scenario(str(k), (push,), STAND, duration=9.0))
    policy = two_stage.make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    for _ in range(20):
        episodes.step(policy.predict(episodes.core.observation)[0])
    assert episodes.core.pushes.start[:, 0].tolist() == [0.0, np.inf, np.inf]


STAY = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]], np.float32)  # T at its upper bound: no step


def test_a_late_cop_stays_where_it_was_asked_for():
    """In the middle of both feet, also once the robot steps off its stance foot with a CoP at the other."""
    episodes = PendulumEpisodes(1)
    late = Scenario("late", (), STAND, errors=ModelErrors(delay=0.02), duration=5.0)
    episodes.begin(0, late)
    for _ in range(4):
        episodes.step(STAY)
    middle = episodes.core.state.cop[0].copy()
    episodes.step(np.array([[0.0, 0.0, -1.0, 0.0, 0.9, 0.0, 0.0]], np.float32))
    state = episodes.core.state
    assert state.side[0] == 1
    half = 0.05  # of the sole's width: as near to where it was as the sole that stands allows
    nearest = np.clip(middle[1], state.stance[0, 1] - half, state.stance[0, 1] + half)
    assert state.cop[0, 1] == pytest.approx(nearest)


def test_a_step_goes_no_further_for_a_standing_pendulum():
    episodes = PendulumEpisodes(2)
    for k, fraction in enumerate((0.0, 0.5)):
        push = Push((5.0, 0.0, 0.0), 0.1, GaitEvent(0, "left", fraction))
        episodes.begin(k, Scenario("e", (push,), STAND, duration=9.0))
    for _ in range(80):
        episodes.step(np.repeat(STAY, 2, axis=0))
    assert episodes.core.pushes.start[:, 0].tolist() == [0.0, np.inf]


def test_a_late_cop_stays_where_it_was_asked_for_between_feet_astride():
    """The other foot stands at (0.1, -0.2), the CoP between both, along its sole and 5 cm beside it."""
    episodes = PendulumEpisodes(1)
    errors = ModelErrors(delay=0.02)
    episodes.begin(0, Scenario("late", (), STAND, errors=errors, duration=5.0, stride=0.1))
    for _ in range(4):
        episodes.step(STAY)
    state = episodes.core.state
    np.testing.assert_allclose(state.cop[0], [0.05, -0.1], atol=1e-9)
    episodes.step(np.array([[0.0, 0.0, -1.0, 0.0, 0.9, 0.0, 0.0]], np.float32))
    assert state.side[0] == 1
    np.testing.assert_allclose(state.cop[0], [0.05, -0.15], atol=1e-9)
