"""What only the value network sees: the impulse to come in the canonical frame, and the sensors' errors."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.residual import ResidualRule
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.training.actor import (
    CRITIC,
    Actor,
    check_critic,
    critic_size,
    impulse_to_come,
    place_to_come,
    pushes_to_come,
    sensing_error,
)
from push_recovery.training.builders import completed, make_env, make_robots
from push_recovery.training.settings import TrainingSettings

NOTHING = np.zeros((1, 7), np.float32)
SETTINGS = TrainingSettings(n_envs=3, walks=3)


def pushed(psi, side="left", turn=0.0):
    """One biped at rest before a push of 50 N s towards psi [rad], 0.1 s long, in 0.01 s."""
    episodes = BipedEpisodes(1)
    push = polar_push(500.0, psi, 0.1, 0.01)
    episodes.begin(0, Scenario("x", pushes=(push,), stance_side=side, command=Command(turn=turn)))
    return episodes


@pytest.mark.parametrize(
    ("side", "psi", "expected"),
    [
        ("left", 0.0, (0.5, 0.0)),
        ("left", math.pi / 2, (0.0, -0.5)),  # to the left is inward on the left foot
        ("right", math.pi / 2, (0.0, 0.5)),
        ("right", math.pi, (-0.5, 0.0)),
    ],
)
def test_all_of_a_push_is_to_come_in_the_canonical_frame(side, psi, expected):
    np.testing.assert_allclose(impulse_to_come(pushed(psi, side))[0], expected, atol=1e-12)


def test_what_has_been_delivered_is_no_longer_to_come():
    """0.1 s of force from 0.01 s on, in periods of 0.01 s: a tenth less each from the second period on."""
    episodes = pushed(0.0)
    left = [impulse_to_come(episodes)[0, 0]]
    for _ in range(13):
        episodes.step(NOTHING)
        left.append(impulse_to_come(episodes)[0, 0])
    expected = [0.5, *np.linspace(0.5, 0.0, 11), 0.0, 0.0]
    np.testing.assert_allclose(left, expected, atol=1e-9)


def test_a_turned_robot_sees_the_push_in_its_own_frame():
    episodes = pushed(0.0, turn=0.3)
    episodes.robots.push_start[0, 0] = np.inf  # it waits
    for _ in range(150):
        episodes.step(NOTHING)
    heading = episodes.motion().heading[0]
    assert abs(heading) > 0.02
    outward = -1.0 if episodes.motion().side[0] == 0 else 1.0
    expected = 0.5 * math.cos(heading), -outward * 0.5 * math.sin(heading)
    np.testing.assert_allclose(impulse_to_come(episodes)[0], expected, atol=1e-12)


@pytest.mark.parametrize(("frame", "turned"), [("world", 1.0), ("heading", 0.0)])
def test_a_push_in_the_frame_of_the_heading_turns_with_the_robot_until_it_starts(frame, turned):
    episodes = BipedEpisodes(1)
    push = polar_push(500.0, 0.0, 0.1, 9.0, frame=frame)
    episodes.begin(0, Scenario("x", pushes=(push,), command=Command(turn=0.3)))
    for _ in range(150):
        episodes.step(NOTHING)
    heading = turned * episodes.motion().heading[0]
    outward = -1.0 if episodes.motion().side[0] == 0 else 1.0
    expected = 0.5 * math.cos(heading), -outward * 0.5 * math.sin(heading)
    np.testing.assert_allclose(impulse_to_come(episodes)[0], expected, atol=1e-12)


@pytest.mark.parametrize(("side", "outward"), [("left", -1.0), ("right", 1.0)])
def test_a_push_off_the_centre_of_the_trunk_comes_with_its_moment(side, outward):
    """40 N s forward and 30 N s to the left at 0.1, 0.2 and 0.3 m from the CoM: r x p by hand, over 10 N m s.

    In the world r x p = (-0.3 * 30, 0.3 * 40, 0.1 * 30 - 0.2 * 40) = (-9, 12, -5) N m s; the mirror keeps the
    moment about y alone. A push that is over counts no more, whatever its duration was.
    """
    episodes = BipedEpisodes(1)
    trunk = Push((400.0, 300.0, 0.0), 0.1, 0.5, "trunk", (0.1, 0.2, 0.3))
    pelvis = polar_push(100.0, 0.0, 0.3, 0.0)
    episodes.begin(0, Scenario("x", pushes=(pelvis, trunk), stance_side=side))
    canonical = np.array([0.4, outward * 0.3, -0.9 * outward, 1.2, -0.5 * outward])
    np.testing.assert_allclose(place_to_come(episodes)[0], [*canonical, 0.3], atol=1e-12)
    episodes.core.pushes.delivered[0, 0] = 100.0 * 0.3, 0.0, 0.0
    np.testing.assert_allclose(place_to_come(episodes)[0], [*canonical, 0.1], atol=1e-12)
    episodes.core.pushes.delivered[0, 1] = 40.0, 30.0, 0.0
    np.testing.assert_allclose(place_to_come(episodes)[0], np.zeros(6), atol=1e-12)


def test_later_pushes_are_counted_until_their_step_comes():
    """In steps 1 and 5, and one at a time, which waits for no step: over 4, two, one and five steps ahead."""
    episodes = BipedEpisodes(1)
    moments = (0.0, GaitEvent(1, "right", 0.5), GaitEvent(5, "right", 0.0))
    pushes = tuple(polar_push(1.0, 0.0, 0.1, moment) for moment in moments)
    episodes.begin(0, Scenario("x", pushes=pushes))
    np.testing.assert_allclose(pushes_to_come(episodes)[0], [2 / 4, 1 / 4, 5 / 4])
    planner = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    for step, expected in ((2, [1 / 4, 3 / 4, 3 / 4]), (5, [0.0, 0.0, 0.0])):
        for _ in range(200):
            episodes.walk(planner)
            if episodes.motion().steps[0] == step:
                break
        episodes.walk(planner)
        np.testing.assert_allclose(pushes_to_come(episodes)[0], expected)


def test_the_error_of_sensing_is_what_observation_and_truth_differ_by():
    """The true observation is the seen one and 0.05 times the error, on the robot's own sensors."""
    exact, onboard = BipedEpisodes(1), BipedEpisodes(1, sensing="onboard")
    for episodes in (exact, onboard):
        episodes.begin(0, Scenario("x", duration=1.0))
        for _ in range(20):
            episodes.step(NOTHING)
    assert not sensing_error(exact).any()
    error = sensing_error(onboard)
    assert np.abs(error[0, 1:3]).max() > 1e-3
    np.testing.assert_allclose(onboard.core.observation + 0.05 * error, onboard.core.truth, atol=1e-12)


def test_the_blocks_stand_behind_what_the_policy_sees():
    rows = {}
    for critic in ((), ("sensing", "push")):
        settings = dataclasses.replace(SETTINGS, critic=critic)
        env = make_env(settings)
        robots = make_robots(completed(settings, env), env, 0)
        rows[critic] = robots.reset()
        assert robots.observation_space.shape == rows[critic].shape[1:]
    plain, more = rows.values()
    assert (plain.shape, more.shape) == ((3, 45), (3, 83))
    np.testing.assert_array_equal(more[:, :45], plain)
    assert not more[:, 45:81].any()  # exact sensing
    assert (np.linalg.norm(more[:, 81:], axis=1) > 0.04).all()  # 5 N s at least


def test_what_there_is_not_is_refused(toy):
    with pytest.raises(UnknownNameError, match="unknown input of the value network 'truth'"):
        check_critic(["truth"])
    with pytest.raises(InvalidValueError, match="once each"):
        check_critic(["push", "push"])
    settings = TrainingSettings(kind="scratch", env_id=toy, critic=("push",))
    with pytest.raises(InvalidValueError, match="nothing is known of"):
        completed(settings, make_env(settings))


class Below:
    """A planner and a gate of one number each, the first two of the observation."""

    def __init__(self):
        self.scale = np.full(7, 0.5, np.float32)

    def predict(self, observations):
        return np.repeat(observations[:, :1], 7, axis=1).astype(np.float32), None


def two_robots(**parts):
    rule = ResidualRule(Below(), RobotModel(), GaitLimits(), np.full(7, 0.5, np.float32), None)
    rule.opening = lambda observations: observations[:, 1:2].astype(np.float32)
    core = SimpleNamespace(observation=np.zeros((2, 36)), truth=np.zeros((2, 36)))
    episodes = SimpleNamespace(
        n=2, core=core, robot=RobotModel(), limits=GaitLimits(), observation_size=36, seen=core.observation
    )
    return core, Actor(episodes, ("observation", "base", "gate"), rule, **parts)


def test_a_residual_is_added_to_what_was_seen_last_of_its_own_robot():
    """total = clip(base + 0.5 g a): robot 0 was seen with base 0.2 and g 1, then robot 1 with 0.4 and 0."""
    core, actor = two_robots()
    core.observation[:, :2] = (0.2, 1.0), (-0.8, 0.5)
    actor.look(np.arange(2))
    core.observation[:, :2] = (0.6, 0.0), (0.4, 0.0)
    actor.look(np.array([1]))  # robot 0 has ended, what it was is kept
    outputs = np.stack([np.full(7, 0.6), np.full(7, -1.0)]).astype(np.float32)
    np.testing.assert_allclose(actor.actions(outputs)[:, 3], [0.5, 0.4], atol=1e-6)
    assert actor.gate_closed.tolist() == [False, True]
    core.observation[:, :2] = (0.9, 1.0), (-0.8, 0.5)
    actor.look(np.arange(2))
    np.testing.assert_allclose(actor.actions(outputs)[:, 3], [1.0, -1.0], atol=1e-6)  # 1.2 and -1.05
    core.observation[:, 1] = 0.01, 0.0
    actor.look(np.arange(2))
    assert actor.gate_closed.tolist() == [False, True]  # however little it opens


def test_networks_see_the_observation_then_the_planner_then_the_gate_then_the_critics_own():
    core, actor = two_robots(critic=("sensing",))
    core.observation[:, :2] = (0.2, 1.0), (-0.8, 0.5)
    core.truth[:, 2] = 0.1, -0.05
    actor.look(np.arange(2))
    rows = actor.inputs()
    assert rows.shape == (2, actor.size) == (2, 36 + 7 + 1 + 36)
    np.testing.assert_allclose(rows[:, :2], [[0.2, 1.0], [-0.8, 0.5]], atol=1e-7)
    np.testing.assert_allclose(rows[:, [36, 42, 43]], [[0.2, 0.2, 1.0], [-0.8, -0.8, 0.5]], atol=1e-7)
    np.testing.assert_allclose(rows[:, 46], [2.0, -1.0], atol=1e-6)  # over 0.05


def test_a_network_that_acts_alone_is_kept_out_by_the_gate_of_its_robots_if_they_have_one():
    """Closed at 0 exactly, and open by the least above it."""
    core = SimpleNamespace(observation=np.array([[0.3, 0.0], [0.3, 1e-9]]))
    episodes = SimpleNamespace(
        n=2, core=core, robot=RobotModel(), limits=GaitLimits(), observation_size=2, gate=None
    )
    actor = Actor(episodes, ("observation",))
    assert actor.gate_closed.tolist() == [False, False]
    episodes.gate = lambda seen: seen[:, 1:]
    assert actor.gate_closed.tolist() == [True, False]
    outputs = np.full((2, 7), 0.5, np.float32)
    assert actor.actions(outputs) is outputs


@pytest.mark.parametrize("psi", [math.pi / 2, math.pi, -math.pi / 2])
def test_a_push_aside_or_from_the_front_takes_its_time_too(psi):
    np.testing.assert_allclose(place_to_come(pushed(psi))[0], [0, 0, 0, 0, 0, 0.1], atol=1e-12)


def test_a_push_later_in_the_first_step_waits_for_it():
    """One of them, no step ahead."""
    episodes = BipedEpisodes(1)
    push = polar_push(1.0, 0.0, 0.1, GaitEvent(0, "left", 0.5))
    episodes.begin(0, Scenario("x", pushes=(push,)))
    np.testing.assert_allclose(pushes_to_come(episodes)[0], [0.25, 0.0, 0.0])


@pytest.mark.parametrize("name", CRITIC)
def test_a_block_of_the_critic_is_as_long_as_it_says(name):
    size, block = CRITIC[name]
    assert block(pushed(0.0)).shape == (1, size) == (1, critic_size([name]))
