"""`PushRecovery/BipedJoint-v0`: a walk given as targets, judged as the others; mirror, threads, sensors."""

from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.joint_control import to_canonical
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.gait_machine import FAILURES
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.period_end import REWARD_TERMS
from push_recovery.envs.joint.env import FROM_GAIT, JOINT_REWARD_TERMS, JointEpisodes
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")


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


def test_robots_do_not_depend_on_each_other_nor_on_threads(run, pushed):
    scenarios, rng = pushed(4), np.random.default_rng(0)
    actions = rng.uniform(-0.2, 0.2, (60, 4, 14)).astype(np.float32)
    together, threaded = (run(JointEpisodes(4, threads=n), scenarios, actions) for n in (1, 2))
    assert together.tobytes() == threaded.tobytes()
    for k, scenario in enumerate(scenarios):
        alone = run(JointEpisodes(1), [scenario], actions[:, k : k + 1])
        assert alone[:, 0].tobytes() == together[:, k].tobytes()


@pytest.mark.parametrize("sensing", ["exact", "onboard"])
def test_the_mirrored_scenario_gives_the_mirrored_walk(run, pushed, sensing):
    """The same actions on the other foot: what is seen and earned is the same, the CoM goes the other way."""
    scenario = replace(pushed(2)[1], sensing=sensing)
    actions = np.random.default_rng(1).uniform(-0.15, 0.15, (60, 1, 14)).astype(np.float32)
    episodes = JointEpisodes(1)
    one, other = (run(episodes, [side], actions)[:, 0] for side in (scenario, scenario.mirrored()))
    np.testing.assert_allclose(one[:, 41:], other[:, 41:], atol=1e-5)
    np.testing.assert_allclose(one[:, 1], -other[:, 1], atol=1e-6)


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
