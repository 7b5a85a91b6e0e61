"""`PushRecovery/BipedJointResidual-v0`: action zero is the planner bit for bit; what a residual does."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.joint.env import JointResidualEpisodes
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario

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
    assert plan.core.bounds_met(0) == residual.core.bounds_met(0)


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


def test_robots_do_not_depend_on_each_other_nor_on_threads(run, pushed):
    scenarios, rng = pushed(4), np.random.default_rng(0)
    actions = rng.uniform(-0.5, 0.5, (60, 4, 14)).astype(np.float32)
    together, threaded = (
        run(JointResidualEpisodes(4, threads=n, gate=None), scenarios, actions) for n in (1, 2)
    )
    assert together.tobytes() == threaded.tobytes()
    for k, scenario in enumerate(scenarios):
        alone = run(JointResidualEpisodes(1, gate=None), [scenario], actions[:, k : k + 1])
        assert alone[:, 0].tobytes() == together[:, k].tobytes()


def test_the_mirrored_scenario_gives_the_mirrored_walk(run, pushed):
    scenario = replace(pushed(2)[1], sensing="exact")
    actions = np.random.default_rng(1).uniform(-0.3, 0.3, (80, 1, 14)).astype(np.float32)
    episodes = JointResidualEpisodes(1, gate=None)
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
    assert gated.alike(2).gate.band == gated.gate.band == (0.03, 0.1)
    assert free.alike(2).gate is None


@pytest.mark.parametrize("gate", [(0.1, 0.1), (-0.1, 0.2), (0.1,), "wide"])
def test_an_impossible_gate_is_refused(gate):
    with pytest.raises(InvalidValueError, match="a residual gate is two numbers"):
        JointResidualEpisodes(1, gate=gate)


@pytest.mark.parametrize("scale", [-0.1, 1.5, float("nan"), "much", None])
def test_an_impossible_scale_is_refused(scale):
    with pytest.raises(InvalidValueError, match="scale must be"):
        JointResidualEpisodes(1, scale=scale)


def test_an_unknown_planner_is_refused():
    with pytest.raises(UnknownNameError, match="two-stage"):
        JointResidualEpisodes(1, policy="three-stage")


def test_other_actions_are_refused():
    env = gym.make("PushRecovery/BipedJointResidual-v0")
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match=r"action must have shape \(14,\), got \(7,\)"):
        env.step(np.zeros(7))
