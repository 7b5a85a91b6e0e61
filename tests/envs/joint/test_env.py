"""Reward terms under joint targets, on values worked out by hand.

Actions on the joints of other robots: axes in another order, joints that are held or missing.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from push_recovery.controllers.model.observation import (
    COM_VELOCITY,
    COMMAND,
    ELAPSED,
    HEADING_ERROR,
    SWING_POSITION,
)
from push_recovery.envs.episode.period_end import REWARD_TERMS
from push_recovery.envs.joint.env import (
    CLEARANCE,
    FROM_GAIT,
    JOINT_REWARD_TERMS,
    JointEpisodes,
    JointResidualEpisodes,
    effort,
    heading,
    smoothness,
    swing,
    velocity,
    write_rewards,
)
from push_recovery.envs.robots.biped import HELD_VARIANTS, NO_WAIST_ROLL, VARIANTS
from push_recovery.envs.scenario.scenario import Command, Scenario

APEX, T = 0.05, 0.4


def seen(**entries):
    obs = np.zeros(36)
    for name, value in entries.items():
        obs[{"heading": HEADING_ERROR, "elapsed": ELAPSED, "height": SWING_POSITION.start + 2}[name]] = value
    return obs


def test_velocity_is_held_against_the_command_on_both_axes():
    obs = np.zeros(36)
    obs[COM_VELOCITY], obs[COMMAND] = (0.5, -0.3), (0.2, 0.1)
    assert velocity(obs, False) == pytest.approx(math.exp(-(0.3**2 + 0.4**2) / 0.25))
    assert velocity(obs, True) == 0.0
    obs[COMMAND] = obs[COM_VELOCITY]
    assert velocity(obs, False) == 1.0


@pytest.mark.parametrize(("angle", "value"), [(0.0, 0.0), (-0.5, -0.25), (0.5, -0.25), (2.0, -1.0)])
def test_heading(angle, value):
    assert heading(seen(heading=angle)) == pytest.approx(value)


@pytest.mark.parametrize(
    ("elapsed", "height", "value"),
    [
        (0.0, 0.0, 1.0),
        (0.2, APEX, 1.0),
        (0.2, APEX - CLEARANCE, math.exp(-1.0)),
        (0.2, APEX + CLEARANCE, math.exp(-1.0)),
        (0.1, APEX * math.sqrt(0.5), 1.0),
        (0.45, 0.0, 1.0),
        (0.45, CLEARANCE, math.exp(-1.0)),
        (0.51, 0.0, 0.0),
    ],
)
def test_a_swing_foot_earns_by_rising_and_landing_in_time(elapsed, height, value):
    assert swing(seen(elapsed=elapsed, height=height), T, APEX, False) == pytest.approx(value)
    assert swing(seen(elapsed=elapsed, height=height), T, APEX, True) == 0.0


def test_effort_and_changes_cost():
    assert effort(2.0) == pytest.approx(-0.1)
    assert smoothness(np.array([0.5, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])) == pytest.approx(-0.02 * 4.25)


def test_terms_are_written_by_name_and_their_sum_is_the_reward():
    gait = np.arange(14.0).reshape(2, 7)
    truth, plan = np.zeros((2, 36)), np.full((2, 7), T)
    truth[:, HEADING_ERROR] = 0.1, 0.2
    held, before = np.ones((2, 14)), np.zeros((2, 14))
    terms, total = np.full((2, 10), np.nan), np.full(2, np.nan)
    failed, squares = np.array([False, True]), np.array([1.0, 2.0])
    write_rewards(gait, truth, plan, squares, held, before, APEX, failed, terms, total)
    for k in range(2):
        row = dict(zip(JOINT_REWARD_TERMS, terms[k], strict=True))
        assert all(row[name] == gait[k, REWARD_TERMS.index(name)] for name in FROM_GAIT)
        assert row["velocity"] == row["swing"] == float(not failed[k])
        assert row["heading"] == pytest.approx([-0.01, -0.04][k])
        assert row["effort"] == pytest.approx([-0.05, -0.1][k])
        assert row["smoothness"] == pytest.approx(-0.28)
        assert total[k] == pytest.approx(sum(row.values()))
    np.testing.assert_array_equal(before, held)


@pytest.mark.parametrize("description", [*VARIANTS, *HELD_VARIANTS], ids=lambda description: description.name)
@pytest.mark.parametrize(
    "kind", [JointEpisodes, partial(JointResidualEpisodes, gate=None)], ids=["targets", "residual"]
)
def test_left_and_right_are_one_problem(run, pushed, kind, description):
    scenario = replace(pushed(1)[0], command=pushed(2)[1].command)
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (25, 1, 14)).astype(np.float32)
    episodes = kind(1, robot=description)
    size = episodes.observation_size + 1  # with the reward, what lies behind the state
    one, other = (run(episodes, [side], actions)[:, 0] for side in (scenario, scenario.mirrored()))
    np.testing.assert_allclose(one[:, -size:], other[:, -size:], atol=1e-5)
    assert np.abs(one[-1, 3:7] - one[0, 3:7]).max() > 1e-4


def test_a_joint_that_is_missing_gives_no_torque_and_costs_none(run, pushed):
    episodes = JointEpisodes(1, robot=NO_WAIST_ROLL)
    missing = np.flatnonzero(episodes.core.joints.largest == 0.0)
    np.testing.assert_array_equal(missing, [1])  # the waist's roll
    action = np.zeros((1, 1, 14), np.float32)
    action[0, 0, 1] = 1.0
    rewards = [run(episodes, [pushed(1)[0]], actions)[0, 0, -1] for actions in (0.0 * action, action)]
    assert episodes.core.physics.ctrl[0, 1] == 0.0
    assert rewards[0] - rewards[1] == pytest.approx(0.02)  # the change of the action


def test_a_robot_that_turns_is_paid_for_its_own_command():
    episodes = JointEpisodes(1)
    for side, aside in (("left", 0.1), ("right", -0.1)):  # canonical y is to the right on the left foot
        turning = Scenario("turn", command=Command(0.3, -0.1, 0.5), stance_side=side, duration=9.0)
        episodes.begin(0, turning)
        terms = episodes.step(np.zeros((1, 14), np.float32)).reward.terms[0]
        x, y = episodes.core.truth[0, COM_VELOCITY]
        wanted = math.exp(-((x - 0.3) ** 2 + (y - aside) ** 2) / 0.25)
        assert terms[JOINT_REWARD_TERMS.index("velocity")] == pytest.approx(wanted)


@pytest.mark.parametrize(("share", "value"), [(1.249, 1.0), (1.251, 0.0)])
def test_a_swing_foot_on_the_floor_earns_until_a_quarter_after_its_time(share, value):
    assert swing(seen(elapsed=share * T), T, APEX, False) == value
