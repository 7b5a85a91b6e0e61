"""Actions on the joints of other robots: axes in another order, joints that are held or missing."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from push_recovery.envs.joint.env import JointEpisodes, JointResidualEpisodes
from push_recovery.envs.robots.variants import HELD_VARIANTS, NO_WAIST_ROLL, VARIANTS


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
