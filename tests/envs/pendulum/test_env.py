import math
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario

import push_recovery  # noqa: F401

ENV_ID = "PushRecovery/Pendulum-v0"


@pytest.fixture
def env():
    made = gym.make(ENV_ID)
    yield made
    made.close()


def play(env, policy, scenario):
    obs, info = env.reset(options={"scenario": scenario})
    trace, total, done = [obs], 0.0, False
    while not done:
        obs, reward, terminated, truncated, info = env.step(policy.predict(obs)[0])
        trace.append(obs)
        total += reward
        done = terminated or truncated
        assert reward == pytest.approx(sum(info["reward_terms"].values()))
    return np.array(trace), total, terminated, info


def pushed(force, psi_deg, side="left", **kw):
    return Scenario("p", (polar_push(force, math.radians(psi_deg), 0.1, GaitEvent(4, side)),), **kw)


def test_both_checkers_pass():
    with warnings.catch_warnings():
        warnings.simplefilter("error", category=DeprecationWarning)
        check_env(gym.make(ENV_ID, render_mode="rgb_array").unwrapped)
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    sb3.check_env(gym.make(ENV_ID).unwrapped)


def test_vector_form_and_spec():
    envs = gym.make_vec(ENV_ID, num_envs=2)
    obs, _ = envs.reset(seed=1)
    assert obs.shape == (2, 36)
    assert "autoreset_mode" in envs.metadata
    envs.close()
    env = gym.make(ENV_ID, control_hz=50.0, push_distribution={"impulse_max": 20.0})
    assert env.spec is not None
    assert env.spec.to_json()
    assert env.unwrapped.push_distribution.impulse_max == 20.0
    env.reset(seed=0)
    assert env.step(np.zeros(7, np.float32))[4]["time"] == pytest.approx(0.02)


@pytest.mark.parametrize(
    "command", [(0.0, 0.0), (0.5, 0.0), (-0.25, 0.0), (0.0, 0.2), (0.0, -0.2), (0.3, 0.1)]
)
@pytest.mark.parametrize("name", ["stage-1", "two-stage", "two-stage-paper"])
def test_walks_at_the_commanded_speed_and_counts_as_recovered(env, name, command):
    duration = 4.0 if name == "two-stage-paper" else 10.0
    _, _, fell, info = play(
        env, make_policy(name), Scenario("w", command=Command(*command), duration=duration)
    )
    assert not fell
    assert info["recovered_at"] is not None
    assert env.unwrapped.monitor.state.speed_error[0] < 0.03
    assert env.unwrapped.monitor.state.error[0].max() < 0.01


def test_bit_identical_in_any_order(env):
    policy = make_policy("two-stage")
    first = play(env, policy, pushed(300, -60))
    play(env, policy, pushed(700, 20))
    again = play(gym.make(ENV_ID), make_policy("two-stage"), pushed(300, -60))
    assert np.array_equal(first[0], again[0])
    assert first[1] == again[1]


def test_mirrored_scenario_gives_the_mirrored_outcome(env):
    policy = make_policy("two-stage")
    scenario = pushed(350, -40, command=Command(0.2, 0.1))
    one = play(env, policy, scenario)
    com = env.unwrapped.core.state.com[0].copy()
    two = play(env, policy, scenario.mirrored())
    assert two[0] == pytest.approx(one[0], abs=1e-9)
    assert env.unwrapped.core.state.com[0] == pytest.approx(com * [1, -1], abs=1e-9)


def test_push_is_delivered_whole_and_forgotten_after_reset(env):
    scenario = pushed(200, 30)
    _, _, _, info = play(env, make_policy("two-stage"), scenario)
    core = env.unwrapped.core
    assert core.pushes.delivered[0, 0] == pytest.approx(np.array(scenario.pushes[0].impulse), abs=1e-9)
    assert info["push"]["start"] == pytest.approx(4 * 0.65, abs=1e-3)
    assert info["push"]["impulse_per_kg"] == pytest.approx(20 / 60)
    assert info["time"] == pytest.approx(4 * 0.65 + 0.1 + 4.0, abs=0.011)
    quiet = play(env, make_policy("two-stage"), Scenario("q", duration=5.0))[0]
    fresh = play(gym.make(ENV_ID), make_policy("two-stage"), Scenario("q", duration=5.0))[0]
    assert np.array_equal(quiet, fresh)


@pytest.mark.parametrize("psi", range(0, 360, 45))
def test_two_stage_beats_the_point_foot_and_no_push_beyond_the_limit_is_survived(env, psi):
    robot = RobotModel()
    limit = max_recoverable_force(robot, math.radians(psi))
    point = max_recoverable_force(robot, math.radians(psi), foot=False, flywheel=False)
    policy = make_policy("two-stage")
    _, _, fell, info = play(env, policy, pushed(0.8 * limit, psi))
    assert not fell
    assert info["recovered_at"] is not None
    assert play(env, policy, pushed(1.03 * limit, psi))[2]
    stage_1 = make_policy("stage-1")
    assert not play(env, stage_1, pushed(0.97 * point, psi))[2]
    assert play(env, stage_1, pushed(1.03 * point, psi))[2]


def test_a_fall_has_a_reason_and_no_recovery(env):
    trace, _, fell, info = play(env, make_policy("passive"), pushed(300, 90))
    assert fell
    assert info["failure_reason"] == "dcm_diverged"
    assert info["recovered_at"] is None
    assert info["capture_margin"] < 0
    assert np.isfinite(trace).all()
    with pytest.raises(InvalidValueError, match="reset"):
        env.unwrapped.step(np.zeros(7, np.float32))


def test_capture_margin_never_rises_from_below_zero_without_a_push(env):
    """The margin is exact: once negative, no policy gets out of it."""
    for name, seed in (("random", 0), ("stage-1", 1), ("two-stage", 2)):
        policy = make_policy(name)
        obs, info = env.reset(seed=seed, options={"scenario": pushed(420, 90)})
        lost, done = False, False
        while not done:
            obs, _, terminated, truncated, info = env.step(policy.predict(obs)[0])
            done = terminated or truncated
            if lost:
                assert info["capture_margin"] < 1e-9
            lost = lost or (info["capture_margin"] < -1e-9 and info["time"] > 2.75)


@pytest.mark.parametrize(
    "bad", [np.zeros(6), np.full(7, np.nan), np.full(7, np.inf), "abc", None, np.zeros((1, 7))]
)
def test_bad_actions(env, bad):
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match="action"):
        env.unwrapped.step(bad)


@pytest.mark.parametrize(
    ("kwargs", "error"),
    [
        ({"control_hz": 0}, InvalidValueError),
        ({"control_hz": math.nan}, InvalidValueError),
        ({"preset": "nope"}, UnknownNameError),
        ({"render_mode": "ansi"}, UnknownNameError),
        ({"push_distribution": {"impulse": 3}}, PushRecoveryError),
    ],
)
def test_bad_arguments(kwargs, error):
    from push_recovery.envs.pendulum.env import PendulumEnv

    with pytest.raises(error):
        PendulumEnv(**kwargs)


@pytest.mark.parametrize("options", [{"scenario": "x"}, {"scenaro": None}])
def test_bad_options(env, options):
    with pytest.raises(PushRecoveryError):
        env.unwrapped.reset(options=options)


def test_step_before_reset():
    from push_recovery.envs.pendulum.env import PendulumEnv

    with pytest.raises(InvalidValueError, match="reset"):
        PendulumEnv().step(np.zeros(7))


def test_renders_without_a_display():
    env = gym.make(ENV_ID, render_mode="rgb_array")
    env.reset(options={"scenario": pushed(200, 0)})
    first = env.render()
    for _ in range(30):
        env.step(np.zeros(7, np.float32))
    assert first.shape == (480, 640, 3)
    assert first.dtype == np.uint8
    assert not np.array_equal(first, env.render())
