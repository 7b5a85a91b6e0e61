"""CoP and CMP against the contacts that MuJoCo finds.

`PushRecovery/BipedJointResidual-v0`: action zero is the planner bit for bit; what a residual does.

`PushRecovery/BipedJoint-v0`: a walk given as targets, judged as the others; mirror, threads, sensors.
"""

from dataclasses import replace
from functools import partial

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError
from push_recovery.controllers.joint_control import to_canonical
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body import gait_machine
from push_recovery.controllers.whole_body.gait_machine import FAILURES
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.period_end import REWARD_TERMS
from push_recovery.envs.joint.core import write_floor_points
from push_recovery.envs.joint.env import FROM_GAIT, JOINT_REWARD_TERMS, JointEpisodes, JointResidualEpisodes
from push_recovery.envs.joint.full_body import FullBodyEpisodes
from push_recovery.envs.robots.biped import NO_WAIST, biped, biped_model
from push_recovery.envs.scenario.disturbances import Impactor
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario

FLOOR = biped_model().geom("floor").id


def floor_forces(data):
    """Points (m, 3) [m] and forces (m, 3) [N] of the contacts between floor and robot."""
    points, forces, force = [], [], np.empty(6)
    for i, contact in enumerate(data.contact):
        if FLOOR in contact.geom:
            mujoco.mj_contactForce(biped_model(), data, i, force)
            up = 1.0 if contact.geom[0] == FLOOR else -1.0
            points.append(contact.pos.copy())
            forces.append(up * contact.frame.reshape(3, 3).T @ force[:3])
    return np.array(points), np.array(forces)


@pytest.mark.parametrize("seed", range(4))
def test_the_moment_about_the_cop_is_vertical_and_the_force_points_from_the_cmp_to_the_com(
    robot_in, random_state, seed
):
    rng = np.random.default_rng(seed)
    qpos, qvel = random_state(rng, 0.005)
    qpos[2] -= 0.004  # both feet stand
    core, data = robot_in(qpos, qvel)
    core.judged.com[0, 0] = data.subtree_com[0]
    points, forces = floor_forces(data)
    assert len(points) >= 3
    world, total = np.full(6, np.nan), forces.sum(axis=0)
    write_floor_points(core.judged, core.gait, 0, data.qfrc_constraint.copy(), world)
    arms = points - [*world[2:4], 0.0]  # of points a little under the floor
    moment = np.cross(arms, forces).sum(axis=0)
    np.testing.assert_allclose(moment[:2], 0.0, atol=1e-6 * np.abs(forces).sum())
    line = data.subtree_com[0] - [*world[4:6], 0.0]
    np.testing.assert_allclose(np.cross(line, total), 0.0, atol=1e-6 * np.linalg.norm(total))


def test_in_flight_both_stay(robot_in, random_state):
    core, _ = robot_in(*random_state(np.random.default_rng(0)))
    world = np.arange(6.0)
    write_floor_points(core.judged, core.gait, 0, np.zeros(20), world)
    np.testing.assert_array_equal(world, np.arange(6.0))


POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
ZERO = np.zeros((1, 14), np.float32)


@pytest.mark.parametrize("profile", ["exact", "hardware"])
def test_action_zero_is_the_planner_bit_for_bit(profile):
    plan, residual = BipedEpisodes(1, profile=profile), JointResidualEpisodes(1, profile=profile)
    push = Push((60.0, 150.0, 0.0), 0.1, GaitEvent(1, "right", 0.3))
    scenario = plan.profile.applied(Scenario("pushed", (push,), Command(0.2, turn=0.2), noise_seed=3))
    for episodes in (plan, residual):
        episodes.begin(0, scenario)
    for _ in range(250):
        ends = plan.step(POLICY.predict(plan.core.observation)[0]), residual.step(ZERO)
        for name in ("qpos", "qvel"):
            states = [getattr(episodes.core.simulations.data[0], name) for episodes in (plan, residual)]
            assert states[0].tobytes() == states[1].tobytes()
        assert plan.seen.tobytes() == residual.seen[:, :36].tobytes()
        assert ends[0].reward.terms.tobytes() == ends[1].reward.terms.tobytes()
        if ends[0].failed[0]:
            break
    assert plan.core.gait.steps[0] >= 3
    assert plan.core.limits_met(0) == residual.core.limits_met(0)


def test_a_residual_adds_its_share_of_the_motors_torque():
    """In the first physics step of an episode, where nothing else differs; mirrored with the stance."""
    for side, sign in (("left", biped().mirror), ("right", np.ones(14))):
        torques = []
        for action in (ZERO, np.full((1, 14), 0.25, np.float32)):
            episodes = JointResidualEpisodes(1, scale=0.2, control_hz=500.0, gate=None)
            episodes.begin(0, Scenario("walk", stance_side=side))
            episodes.step(action)
            torques.append(episodes.core.physics.ctrl[0].copy())
        added = torques[1] - torques[0]
        np.testing.assert_allclose(added, 0.25 * 0.2 * biped().motors[0] * sign, atol=1e-9)


@pytest.mark.parametrize("kind", [JointEpisodes, JointResidualEpisodes])
def test_effort_is_the_mean_over_the_physics_steps_of_a_period_whether_looked_at_or_not(kind):
    plain, watched, torques = kind(1, control_hz=50.0), kind(1, control_hz=50.0), []
    core = watched.core
    core.after_physics_step = lambda: torques.append(core.physics.ctrl[0].copy())
    for episodes in (plain, watched):
        episodes.begin(0, Scenario("walk", command=Command(0.1)))
    rng = np.random.default_rng(4)
    for _ in range(4):
        torques.clear()
        action = rng.uniform(-0.2, 0.2, (1, 14)).astype(np.float32)
        plain.step(action)
        watched.step(action)
        assert len(torques) == 10
        shares = np.array(torques) / biped().motors[0]
        assert core.joints.effort[0] == pytest.approx((shares**2).sum(axis=1).mean(), rel=1e-12)
        assert core.joints.effort[0] == plain.core.joints.effort[0]


UNGATED = partial(JointResidualEpisodes, gate=None)


@pytest.mark.parametrize(("kind", "largest"), [(UNGATED, 0.5), (JointEpisodes, 0.2)])
def test_robots_do_not_depend_on_each_other_nor_on_threads(run, pushed, kind, largest):
    scenarios, rng = pushed(4), np.random.default_rng(0)
    actions = rng.uniform(-largest, largest, (60, 4, 14)).astype(np.float32)
    together, threaded = (run(kind(4, threads=n), scenarios, actions) for n in (1, 2))
    assert together.tobytes() == threaded.tobytes()
    for k, scenario in enumerate(scenarios):
        alone = run(kind(1), [scenario], actions[:, k : k + 1])
        assert alone[:, 0].tobytes() == together[:, k].tobytes()


@pytest.mark.parametrize(
    ("kind", "largest", "periods", "sensing"),
    [(UNGATED, 0.3, 80, "exact"), (JointEpisodes, 0.15, 60, "exact"), (JointEpisodes, 0.15, 60, "onboard")],
)
def test_the_mirrored_scenario_gives_the_mirrored_walk(run, pushed, kind, largest, periods, sensing):
    """The same actions on the other foot: what is seen and earned is the same, the CoM goes the other way."""
    scenario = replace(pushed(2)[1], sensing=sensing)
    actions = np.random.default_rng(1).uniform(-largest, largest, (periods, 1, 14)).astype(np.float32)
    episodes = kind(1)
    one, other = (run(episodes, [side], actions)[:, 0] for side in (scenario, scenario.mirrored()))
    np.testing.assert_allclose(one[:, 41:], other[:, 41:], atol=1e-5)
    np.testing.assert_allclose(one[:, 1], -other[:, 1], atol=1e-6)


def test_info_tells_of_the_planner_once_it_has_planned():
    env = gym.make("PushRecovery/BipedJointResidual-v0")
    observation, info = env.reset(seed=0)
    assert "baseline_action" not in info
    planned = POLICY.predict(observation[:36])[0]
    info = env.step(ZERO[0])[4]
    np.testing.assert_array_equal(info["baseline_action"], planned)
    assert info["qp_status"] == "solved"
    kept = info["baseline_action"].copy()
    env.step(ZERO[0])
    np.testing.assert_array_equal(info["baseline_action"], kept)
    assert "baseline_action" not in env.reset(seed=1)[1]


def test_the_vector_form_masks_the_planner_out_where_a_robot_was_reset():
    vector = gym.make_vec(
        "PushRecovery/BipedJointResidual-v0", num_envs=2, vectorization_mode="vector_entry_point"
    )
    _, info = vector.reset(seed=0)
    assert not info["_baseline_action"].any()
    info = vector.step(np.zeros((2, 14), np.float32))[4]
    assert info["_baseline_action"].all()
    assert info["_qp_status"].all()
    assert vector.metadata["autoreset_mode"] is gym.vector.AutoresetMode.NEXT_STEP


def test_while_the_gate_is_shut_the_planners_walk_passes_bit_for_bit():
    """Full residuals change nothing until a push opens the gate; then they act by its opening."""
    scenario = Scenario("pushed", (Push((0.0, 600.0, 0.0), 0.1, 1.0),), Command(0.3))
    plan, gated, free = BipedEpisodes(1), JointResidualEpisodes(1), JointResidualEpisodes(1, gate=None)
    for episodes in (plan, gated, free):
        episodes.begin(0, scenario)
    action = np.random.default_rng(0).uniform(-1.0, 1.0, (1, 14)).astype(np.float32)
    opened = []
    for i in range(115):
        opening = gated.gate(gated.core.observation).item()
        plan.step(POLICY.predict(plan.core.observation)[0])
        gated.step(action)
        free.step(ZERO if i < 100 else action)
        opened.append(opening)
        np.testing.assert_allclose(gated.core.joints.asked, np.float32(opening) * action)
        if i < 100:
            assert opening == 0.0
            assert gated.core.physics.qpos.tobytes() == plan.core.physics.qpos.tobytes()
    assert max(opened) == 1.0
    assert (gated.core.physics.qpos != plan.core.physics.qpos).any()
    assert gated.clone(2).gate.band == gated.gate.band == (0.03, 0.1)
    assert free.clone(2).gate is None


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        *(("gate", bad, "a residual gate is two") for bad in ((0.1, 0.1), (-0.1, 0.2), (0.1,), "wide")),
        *(("scale", bad, "scale must be") for bad in (-0.1, 1.5, float("nan"), "much", None)),
        ("policy", "three-stage", "two-stage"),
    ],
)
def test_impossible_arguments_are_refused(name, value, told):
    with pytest.raises(PushRecoveryError, match=told):
        JointResidualEpisodes(1, **{name: value})


def test_other_actions_are_refused():
    env = gym.make("PushRecovery/BipedJointResidual-v0")
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match=r"action must have shape \(14,\), got \(7,\)"):
        env.step(np.zeros(7))


def as_targets(walk, joints):
    """Targets (14,) under which PD control gives the torques of whole-body control, robot's own order."""
    angles, rates = walk.physics.qpos[0, 7:21], walk.physics.qvel[0, 6:20]
    return angles + joints.damping / joints.stiffness * rates - joints.posture


@pytest.fixture(scope="module")
def walks():
    """3 s of the planner's walk, and of the same walk as joint targets, a physics step a period.

    For every step the two cores, whether they stepped down in it, and their terms of the reward.
    """
    plan, targets = BipedEpisodes(1, control_hz=500.0), JointEpisodes(1, control_hz=500.0)
    scenario = Scenario("walk", command=Command(0.2), duration=4.0)
    for episodes in (plan, targets):
        episodes.begin(0, scenario)
    joints, found, apart, reached = targets.core.joints, [], [], 0.0
    canonical = np.empty(14)
    for i in range(1500):
        own = as_targets(plan.core, joints)
        if i % 5 == 0:
            action = POLICY.predict(plan.core.observation)[0]
        terms = [plan.step(action).reward.terms[0].copy()]
        own += plan.core.physics.ctrl[0] / joints.stiffness
        to_canonical(own, targets.core.physics.mirror, targets.core.gait.stance.item(0), canonical)
        reached = max(reached, np.abs(canonical).max())
        terms.append(targets.step(canonical[None].astype(np.float32)).reward.terms[0].copy())
        found.append([(e.core.gait.steps.item(0), e.core.gait.stance.item(0)) for e in (plan, targets)])
        found[-1] += terms
        apart.append(np.abs(plan.core.physics.qpos - targets.core.physics.qpos).max())
    return plan, targets, found, np.array(apart), reached


def test_a_walk_given_as_targets_is_the_same_walk(walks):
    *_, apart, reached = walks
    assert apart.max() < 1e-5
    assert 0.2 < reached < 1.0


def test_its_steps_are_told_by_the_contacts_as_the_gait_machine_tells_them(walks):
    _, _, found, *_ = walks
    assert [row[0] for row in found] == [row[1] for row in found]
    assert found[-1][0][0] >= 8


def test_it_counts_as_recovered_from_the_same_moment(walks):
    plan, targets, *_ = walks
    assert plan.monitor.recovered_at(0) == targets.monitor.recovered_at(0) is not None


def test_terms_that_the_gait_has_too_are_the_same(walks):
    _, _, found, *_ = walks
    for name in FROM_GAIT:
        gait, joint = REWARD_TERMS.index(name), JOINT_REWARD_TERMS.index(name)
        np.testing.assert_allclose(
            [row[2][gait] for row in found], [row[3][joint] for row in found], atol=1e-4
        )
    swing = np.array([row[3][JOINT_REWARD_TERMS.index("swing")] for row in found])
    assert swing.mean() > 0.8


def test_nothing_that_acts_reads_the_true_state(run, pushed):
    """Whatever physics has told of itself is overwritten once the sensors have read it."""
    scenario = replace(pushed(1)[0], sensing="onboard")
    actions = np.random.default_rng(2).uniform(-0.1, 0.1, (40, 1, 14)).astype(np.float32)
    episodes = JointEpisodes(1)
    clean = run(episodes, [scenario], actions)
    core = episodes.core
    own = {id(field) for field in core.physics}
    true = [field for field in core.judged if id(field) not in own]
    wrong = [field.copy() for field in true]

    def poison():
        for field, value in zip(true, wrong, strict=True):
            field[:] = value
        for name in ("sensordata", "qfrc_constraint", "xpos", "xmat", "xanchor", "xaxis"):
            getattr(core.simulations.data[0], name)[:] = 1e3

    core.after_physics_step = poison
    poisoned = run(episodes, [scenario], actions)
    np.testing.assert_array_equal(poisoned[..., :-1], clean[..., :-1])
    assert (poisoned[..., -1] != clean[..., -1]).any()  # the judge has seen the poison


def test_it_falls_by_the_same_rules():
    """A robot that stands still falls over, and one with limp knees sinks."""
    episodes, reasons = JointEpisodes(2), []
    for k in range(2):
        episodes.begin(k, Scenario("stands", (Push((0.0, 400.0, 0.0), 0.1, 0.1),) if k == 0 else ()))
    action = np.zeros((2, 14), np.float32)
    action[1, [5, 11]] = 0.9  # both knees
    for _ in range(300):
        period = episodes.step(action)
        reasons.append(tuple(FAILURES[f] for f in episodes.failure()))
    assert period.failed.all()
    assert set(reasons[-1]) <= {"com_height", "pelvis_tilt"}
    assert episodes.monitor.recovered_at(0) is None


@pytest.mark.parametrize("profile", ["exact", "hardware"])
def test_a_robot_that_holds_a_posture_does_not_shake(profile):
    """One leg lifted: torques change from one control step to the next by a small share of what they are."""
    episodes = JointEpisodes(1, profile=profile, control_hz=500.0)
    episodes.begin(0, episodes.profile.applied(Scenario("lifts", duration=2.0)))
    action = np.zeros((1, 14), np.float32)
    action[0, 10:13] = -0.4, 0.8, -0.4  # the swing leg's hip, knee and ankle
    torques = []
    for _ in range(300):
        episodes.step(action)
        torques.append(episodes.core.physics.ctrl[0].copy())
    changes = np.diff(torques[100:], axis=0).std(axis=0)
    assert (changes < 0.1 * episodes.core.joints.largest).all()


def test_at_a_reset_the_joints_have_been_asked_for_nothing():
    episodes = JointEpisodes(2)
    joints = episodes.core.joints
    for field in (joints.asked, joints.held, joints.effort, joints.lifted, joints.air):
        field[:] = 3
    episodes.begin(1, Scenario("a"))
    for field in (joints.asked, joints.held, joints.effort, joints.lifted, joints.air):
        assert not field[1].any()
        assert (field[0] == 3).all()  # the other robot's stay


def test_a_joint_that_a_robot_does_not_have_is_asked_for_nothing():
    """Without a waist the first two of the 14 joints have no motor, no angle and no reach."""
    core = JointEpisodes(1, robot=NO_WAIST).core
    moved = core.joints.largest > 0.0
    assert moved.tolist() == [False] * 2 + [True] * 12
    np.testing.assert_array_equal(core.joints.reach > 0.0, moved)
    assert not core.joints.posture[~moved].any()
    assert len(set(core.joints.reach[moved].tolist())) == 1


@pytest.mark.parametrize("robots", [JointEpisodes, JointResidualEpisodes])
def test_an_impactor_hits_any_robot(robots):
    episodes, hit = robots(2), Impactor(8.0, 3.0, 0.1, direction=1.0)
    for k, parts in enumerate(((hit,), ())):
        episodes.begin(k, Scenario(str(k), disturbances=parts, duration=5.0))
    for _ in range(25):
        episodes.step(np.zeros((2, episodes.action_size), np.float32))
    delivered = episodes.core.pushes.delivered[:, 0]
    assert np.linalg.norm(delivered[0]) > 8.0 * 3.0 * 0.6
    assert not delivered[1].any()
    gained = episodes.core.physics.qvel[0, :2] - episodes.core.physics.qvel[1, :2]
    assert gained @ [np.cos(1.0), np.sin(1.0)] > 0.2


def test_cop_and_cmp_lie_on_a_floor_that_is_higher(robot_in, random_state):
    """One force at a point of a floor 0.2 m up: its CoP is there, its CMP on the line through the CoM."""
    core, data = robot_in(*random_state(np.random.default_rng(0)))
    com = core.judged.com[0, 0] = data.subtree_com[0]
    force, point, wrench = np.array([40.0, -30.0, 500.0]), np.array([0.3, -0.1, 0.2]), np.zeros(20)
    wrench[:3] = force
    wrench[3:6] = data.xmat[1].reshape(3, 3).T @ np.cross(point - data.xpos[1], force)
    core.gait.height[0, gait_machine.FLOOR] = 0.2
    world = np.full(6, np.nan)
    write_floor_points(core.judged, core.gait, 0, wrench, world)
    np.testing.assert_allclose(world[2:4], point[:2], atol=1e-9)
    np.testing.assert_allclose(world[4:6], com[:2] + (0.2 - com[2]) * force[:2] / force[2], atol=1e-9)


@pytest.mark.parametrize("kind", [JointEpisodes, FullBodyEpisodes])
def test_of_the_limits_only_the_motors_are_recorded_where_nothing_is_planned(kind):
    episodes = kind(1)
    episodes.begin(0, Scenario("a", (Push((0.0, 600.0, 0.0), 0.1, 0.0),)))
    for i in range(20):
        episodes.step(np.full((1, 14), 1.0 if i % 4 < 2 else -1.0, np.float32))
    assert np.isfinite(episodes.core.limits_record.first[0]).sum() > 1  # the DCM kept to no plan, too
    report = episodes.core.limits_met(0)
    assert list(report.met) == list(report.shares) == ["joint_torque"]
