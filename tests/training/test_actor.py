"""What only the value network sees: the impulse to come in the canonical frame, and the sensors' errors."""

import dataclasses
import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.training.actor import check_critic, impulse_to_come, sensing_error
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
