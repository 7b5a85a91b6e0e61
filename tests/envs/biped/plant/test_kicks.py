"""A kick is an exact jump of the velocity of all bodies alike, and is carried and forgotten as a push is."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.biped.pushes import Kicks
from push_recovery.envs.episode.vector_env import GaitVectorEnv
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import Kick, Push
from push_recovery.envs.scenario.scenario import HARDWARE, Scenario
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
    with pytest.raises(InvalidValueError, match="kicks"):
        others.restore(snapshots[0], [0], replace(ROBOTS[0], kicks=()))


def test_recovery_and_limits_count_from_the_kick():
    envs = vector(
        Scenario("a", kicks=(Kick((0.0, 0.9, 0.0), 0.5),), settle_time=1.0), Scenario("b", duration=1.5)
    )
    act(envs, 149)
    met = envs.core.bounds_met(0)
    assert met.met
    assert min(met.met.values()) >= 0.5
    assert not envs.core.bounds_met(1).met
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
