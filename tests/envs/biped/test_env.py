"""`PushRecovery/Biped-v0` as a user meets it.

The biped starts, walks at the commanded speed, stops, and stays where it is.
"""

import math
from dataclasses import asdict, replace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model import observation as layout
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.gait_machine import FAILURES
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedConfig, BipedEpisodes
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, CommandChange, Scenario

ID = "push_recovery:PushRecovery/Biped-v0"


@pytest.fixture(scope="module")
def env():
    made = gym.make(ID).unwrapped
    yield made
    made.close()


def play(env, scenario: Scenario, name: str = "two-stage"):
    """Observations, CoM positions, summed reward and the last step's (terminated, truncated, info)."""
    policy = make_policy(name, env.robot, env.limits, env.preset)
    observation, _ = env.reset(options={"scenario": scenario})
    observations, coms, total = [observation], [env.core.physics.com[0, 0].copy()], 0.0
    end = (False, False, {})
    while not (end[0] or end[1]):
        action, _ = policy.predict(observations[-1])
        observation, reward, *end = env.step(action)
        observations.append(observation)
        coms.append(env.core.physics.com[0, 0].copy())
        total += reward
    return np.array(observations), np.array(coms), total, end


@pytest.mark.parametrize(
    ("vx", "vy"), [(0.0, 0.0), (0.5, 0.0), (-0.25, 0.0), (0.0, 0.2), (0.0, -0.2), (0.3, 0.1)]
)
def test_it_walks_at_the_commanded_speed(env, vx, vy):
    """Five seconds without a fall; mean velocity over whole strides within 15 % of the command."""
    observations, coms, _, (terminated, truncated, info) = play(
        env, Scenario("walk", command=Command(vx, vy), duration=6.0)
    )
    assert not terminated
    assert truncated
    assert info["failure_reason"] is None
    assert info["time"] == pytest.approx(6.0, abs=1e-9)
    begins = np.flatnonzero(np.diff(observations[:, layout.ELAPSED]) < 0) + 1
    begins = begins[len(begins) % 2 :][2:]  # whole strides, without the first
    first, last = begins[0], begins[-1]
    velocity = (coms[last] - coms[first])[:2] / ((last - first) * env.dt)
    assert np.hypot(*(velocity - [vx, vy])) < max(0.15 * math.hypot(vx, vy), 0.02)
    yaw = np.abs(observations[:, layout.HEADING_ERROR])
    assert yaw.max() < math.radians(10)
    assert yaw[-1] < math.radians(5)


def test_a_fall_ends_the_episode_with_a_reason(env):
    push = Push((0.0, 1500.0, 0.0), 0.2, GaitEvent(1, "right", 0.2))
    _, coms, total, (terminated, truncated, info) = play(env, Scenario("fall", (push,)))
    assert terminated
    assert not truncated
    assert info["failure_reason"] in FAILURES[1:]
    assert info["recovered_at"] is None
    assert coms[-1, 2] < env.robot.com_height
    assert math.isfinite(total)
    with pytest.raises(InvalidValueError, match="reset"):
        env.step(np.zeros(7, np.float32))


def test_a_time_limit_truncates_four_seconds_after_the_push(env):
    push = Push((20.0, 0.0, 0.0), 0.1, 0.4)
    _, _, _, (terminated, truncated, info) = play(env, Scenario("small", (push,)))
    assert (terminated, truncated) == (False, True)
    assert info["time"] == pytest.approx(4.5, abs=env.dt)
    with pytest.raises(InvalidValueError, match="reset"):
        env.step(np.zeros(7, np.float32))


def test_a_fresh_environment_wants_a_reset():
    fresh = gym.make(ID).unwrapped
    with pytest.raises(InvalidValueError, match="reset"):
        fresh.step(np.zeros(7, np.float32))


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.full(7, np.nan), "finite"),
        (np.array([0, 0, 0, 0, 0, 0, np.inf]), "finite"),
        (np.zeros(6), r"\(7,\).*\(6,\)"),
        (np.zeros((1, 7)), r"\(7,\).*\(1, 7\)"),
        ("forward", "array of numbers"),
        (None, "array of numbers"),
    ],
)
def test_bad_actions_are_refused_and_change_nothing(env, action, words):
    env.reset(seed=0)
    before = env.core.physics.qpos[0].copy()
    with pytest.raises(InvalidValueError, match=words):
        env.step(action)
    np.testing.assert_array_equal(env.core.physics.qpos[0], before)
    env.step(np.zeros(7, np.float32))  # the episode goes on


def test_actions_outside_the_box_are_clipped(env):
    ends = []
    for size in (1.0, 5.0):
        observation, _ = env.reset(options={"scenario": Scenario("clip")})
        for _ in range(10):
            observation, *_ = env.step(np.full(7, size, np.float32))
        ends.append(observation)
    assert ends[0].tobytes() == ends[1].tobytes()


@pytest.mark.parametrize("rate", [30, 60, 240.0, 99.9, 333])
def test_a_rate_that_does_not_divide_the_physics_rate_is_refused(rate):
    with pytest.raises(InvalidValueError, match=rf"500 Hz.*{rate}"):
        gym.make(ID, control_hz=rate)


@pytest.mark.parametrize("rate", [0, -100, 1e9, math.nan, "fast", None])
def test_an_impossible_rate_is_refused(rate):
    with pytest.raises(InvalidValueError, match="control_hz"):
        gym.make(ID, control_hz=rate)


def test_unknown_names_list_the_valid_ones(env):
    with pytest.raises(UnknownNameError, match="default"):
        gym.make(ID, preset="tuned")
    with pytest.raises(UnknownNameError, match="rgb_array"):
        type(env)(render_mode="ansi")
    with pytest.raises(UnknownNameError, match="scenario"):
        env.reset(options={"scenari": Scenario("a")})
    with pytest.raises(InvalidValueError, match="Scenario"):
        env.reset(options={"scenario": "quick-3"})


def test_info_tells_the_push_the_world_points_and_the_contacts(env):
    push = Push((30.0, 40.0, 0.0), 0.1, 0.3)
    policy = make_policy("two-stage", env.robot, env.limits, env.preset)
    observation, info = env.reset(options={"scenario": Scenario("told", (push,))})
    reward = 0.0
    for _ in range(35):
        observation, reward, _, _, info = env.step(policy.predict(observation)[0])
    assert info["scenario_id"] == "told"
    told = info["push"]
    assert (told["force"], told["duration"], told["body"]) == (push.force, 0.1, "pelvis")
    assert told["start"] == pytest.approx(0.3)
    assert told["impulse_per_kg"] == pytest.approx(5.0 / 60.0)
    assert told["direction"] == pytest.approx(math.atan2(40.0, 30.0))
    assert set(info["contacts"]) == {"left", "right"}
    assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-12)
    com, velocity = observation[layout.COM], observation[layout.COM_VELOCITY]
    dcm = com + velocity / env.robot.omega
    core = env.core
    sole = core.physics.com[0, 0, :2] - com * [1.0, -1.0 if info["stance_side"] == "left" else 1.0]
    expected = sole + dcm * [1.0, -1.0 if info["stance_side"] == "left" else 1.0]
    np.testing.assert_allclose(info["dcm"], expected, atol=1e-9)
    # within the sole, and the CMP away from it by the trunk's share of the plan
    assert np.all(np.abs(info["cop"] - sole) <= [0.1 + 1e-3, 0.05 + 1e-3])
    share = core.gait_settings.cmp_gain * core.gait.plan[0, 5:7]
    np.testing.assert_allclose(np.abs(info["cmp"] - info["cop"]), np.abs(share), atol=1e-9)


def test_the_same_scenario_and_seed_give_the_same_bits(env):
    push = Push((50.0, 60.0, 0.0), 0.1, GaitEvent(2, "left", 0.4))
    first = play(env, Scenario("again", (push,), settle_time=1.0))
    again = play(gym.make(ID).unwrapped, Scenario("again", (push,), settle_time=1.0))
    assert first[0].tobytes() == again[0].tobytes()
    assert first[2] == again[2]
    drawn = [env.reset(seed=11)[1]["push"] for _ in range(2)]
    assert drawn[0] == drawn[1]


def test_planning_rates_walk_alike(env):
    """The CoM after two nominal seconds hardly depends on the planning rate."""
    ends = []
    for rate in (50.0, 100.0, 250.0):
        other = gym.make(ID, control_hz=rate).unwrapped
        _, coms, _, (terminated, *_) = play(other, Scenario("rate", command=Command(0.2), duration=2.0))
        assert not terminated
        ends.append(coms[-1])
    assert np.ptp(np.array(ends), axis=0).max() < 0.05


COMMANDS = (Command(0.5), Command(-0.25), Command(0.0, 0.2), Command(0.0, -0.2))
START, STOP, END = 1.0, 5.0, 9.0  # [s]
PERIODS = 100  # a second


@pytest.fixture(scope="module")
def walk():
    """Bipeds that are told to walk at START and to stop at STOP: episodes, CoM (periods + 1, n, 2)."""
    episodes = BipedEpisodes(len(COMMANDS))
    policy = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
    for k, command in enumerate(COMMANDS):
        changes = CommandChange(START, command), CommandChange(STOP, Command())
        episodes.begin(k, Scenario(f"{k}", changes=changes, duration=100.0))
    com = [episodes.motion().com.copy()]
    for _ in range(round(PERIODS * END)):
        episodes.step(policy.predict(episodes.core.observation)[0])
        com.append(episodes.motion().com.copy())
    return episodes, np.array(com)


def mean_velocity(com: np.ndarray, first: float, last: float) -> np.ndarray:
    """(n, 2) [m/s]."""
    return (com[round(PERIODS * last)] - com[round(PERIODS * first)]) / (last - first)


def test_nobody_falls_and_all_count_as_recovered_from_the_stop(walk):
    episodes, _ = walk
    assert not episodes.failure().any()
    assert all(STOP < episodes.monitor.recovered_at(k) < STOP + 2.0 for k in range(len(COMMANDS)))


def test_the_speed_settles_to_the_command(walk):
    """Two steps, over which the sway cancels, take 0.76 s in place and forward, 0.63 s sideways."""
    commanded = np.array([[command.vx, command.vy] for command in COMMANDS])
    found = mean_velocity(walk[1], START + 1.5, STOP)
    np.testing.assert_allclose(found[:2], commanded[:2], atol=0.02)
    np.testing.assert_allclose(found[2:], commanded[2:], atol=0.025)


def test_after_the_stop_it_steps_in_place(walk):
    found = mean_velocity(walk[1], STOP + 1.5, END)
    np.testing.assert_allclose(found, 0.0, atol=0.02)
    way = walk[1][round(PERIODS * END)] - walk[1][round(PERIODS * STOP)]
    speeds = [np.hypot(command.vx, command.vy) for command in COMMANDS]
    assert (np.hypot(*way.T) < np.multiply(speeds, 0.8) + 0.05).all()  # in the way of 0.8 s, and the sway


def test_a_config_is_passed_whole_or_by_its_fields():
    config = BipedConfig(control_hz=50.0, profile="hardware", sensing="exact", variant="two-stage")
    whole, changed = BipedEpisodes(2, config, threads=2), BipedEpisodes(2, config, sensing="onboard")
    assert (whole.config.preset, whole.config.robot) == (
        "biped",
        whole.description,
    )  # what defaults stand for
    assert whole.clone(3).config == whole.config == BipedEpisodes(1, **asdict(config)).config
    assert changed.core.senses.onboard.all()
    assert not whole.core.senses.onboard.any()
    assert changed.config == replace(whole.config, sensing="onboard")
    with pytest.raises(InvalidValueError, match="config must be a BipedConfig, got 'biped'"):
        BipedEpisodes(1, "biped")
    with pytest.raises(TypeError, match="speed"):
        gym.make(ID, speed=1.0)
