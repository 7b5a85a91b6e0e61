"""The compiled reward terms against their formulas, written out here."""

import math

import numpy as np
import pytest
from push_recovery.controllers.capturability import step_start_dcm
from push_recovery.controllers.double_support import transfer_weight
from push_recovery.controllers.limits import GaitLimits
from push_recovery.controllers.nominal_gait import nominal_gait
from push_recovery.controllers.robot import RobotModel
from push_recovery.envs.gait_reward import REWARD_TERMS, GaitReward

ROBOT, LIMITS = RobotModel(), GaitLimits()


def draw(n):
    rng = np.random.default_rng(2)
    observations = 0.3 * rng.normal(size=(n, 36))
    observations[:, 0] = rng.uniform(0.0, 0.6, n)
    before = rng.uniform(-1.0, 1.0, (n, 7))
    planned, margins = rng.uniform(0.2, 0.7, n), rng.normal(0.05, 0.1, n)
    return observations, before, planned, margins, rng.random(n) < 0.3


def formula(obs, before, planned, margin, failed, delay, double_support):
    nominal = nominal_gait(ROBOT, LIMITS, obs[25:27], delay, double_support)
    start = np.array(step_start_dcm(nominal, ROBOT.pelvis_width, ROBOT.omega, delay))
    decay = math.exp(-ROBOT.omega * nominal.duration)
    if double_support:
        start = np.array([nominal.length + nominal.offset_x, nominal.width + nominal.offset_y]) * decay
    left = transfer_weight(obs[0], double_support, ROBOT.omega) * obs[9:11]
    error = (obs[1:3] - left) * math.exp(-ROBOT.omega * obs[0]) - start
    return {
        "alive": 0.0 if failed else 1.0,
        "fall": -50.0 if failed else 0.0,
        "dcm": 0.0 if failed else math.exp(-(error @ error) / 0.1**2),
        "margin": -float(np.clip(1.0 - margin / 0.1, 0.0, 1.0)),
        "duration": -0.5 * (planned / nominal.duration - 1.0) ** 2,
        "trunk": max(-0.3 * obs[15:17] @ obs[15:17] - 0.01 * obs[17:19] @ obs[17:19], -2.0),
        "smoothness": -0.02 * float(np.sum((obs[27:34] - before) ** 2)),
    }


@pytest.mark.parametrize(("delay", "double_support"), [(0.0, 0.0), (0.03, 0.0), (0.0, 0.1)])
def test_terms_are_their_formulas(delay, double_support):
    given = draw(40)
    reward = GaitReward(ROBOT, LIMITS, delay, double_support)(*given)
    for k in range(40):
        expected = formula(*(part[k] for part in given), delay, double_support)
        assert tuple(expected) == REWARD_TERMS
        np.testing.assert_allclose(reward.terms[k], list(expected.values()), rtol=1e-12, atol=1e-14)
        assert reward.total[k] == sum(reward.terms[k].tolist())


def test_a_robots_terms_do_not_depend_on_the_others():
    given, reward = draw(9), GaitReward(ROBOT, LIMITS, 0.0, 0.0)
    together = reward(*given)
    for k in range(9):
        one = reward(*(part[k : k + 1] for part in given))
        assert one.terms.tobytes() == together.terms[k].tobytes()
        assert one.total[0] == together.total[k]
