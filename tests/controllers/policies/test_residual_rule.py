import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.residual import ResidualRule

ROBOT, LIMITS = RobotModel(), GaitLimits()
SCALE = np.array([0.5, 0.25, 0.0, 1.0, 0.125, 2.0, 0.5], np.float32)
BASE = np.array([[0.5, -0.75, 0.1, 0.9, -0.9, 0.0, 0.3]], np.float32)
LEARNED = np.array([[0.5, -0.5, 1.0, 0.5, -1.0, -0.25, 0.0]], np.float32)
# by hand: base + scale x learned, held within [-1, 1]
SHIFT = np.array([[0.25, -0.125, 0.0, 0.5, -0.125, -0.5, 0.0]], np.float32)
TOTAL = np.array([[0.75, -0.875, 0.1, 1.0, -1.0, -0.5, 0.3]], np.float32)


class Fixed:
    """The same action everywhere; with a memory where `state` is given."""

    def __init__(self, state=None):
        self.state = state

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.repeat(BASE, len(observation), axis=0), self.state


def at_nominal_start(error: float) -> np.ndarray:
    """An observation at the start of a nominal step in place whose DCM is off by `error` along x [m]."""
    observation = np.zeros(36)
    gait = nominal_gait(ROBOT, LIMITS, (0.0, 0.0))
    growth = np.exp(ROBOT.omega * gait.duration)
    observation[1] = gait.offset_x + error
    observation[2] = (gait.width - ROBOT.pelvis_width) / (growth - 1) + ROBOT.pelvis_width / (growth + 1)
    return observation[None]


def test_base_shift_and_total_by_hand():
    rule = ResidualRule(Fixed(), ROBOT, LIMITS, SCALE, None)
    found = rule.act(np.zeros((1, 36)), LEARNED)
    np.testing.assert_array_equal(found.base, BASE)
    np.testing.assert_array_equal(found.shift, SHIFT)
    np.testing.assert_array_equal(found.total, TOTAL)
    np.testing.assert_array_equal(rule.opening(np.zeros((3, 36))), np.ones((3, 1)))


@pytest.mark.parametrize(
    ("error", "opening"), [(0.0, 0.0), (0.02, 0.0), (0.03, 0.25), (-0.04, 0.5), (0.07, 1.0)]
)
def test_the_gate_scales_the_learned_action(error, opening):
    rule = ResidualRule(Fixed(), ROBOT, LIMITS, SCALE, (0.02, 0.06))
    found = rule.act(at_nominal_start(error), LEARNED)
    np.testing.assert_allclose(rule.opening(at_nominal_start(error)), opening, atol=1e-6)
    np.testing.assert_allclose(found.shift, opening * SHIFT, atol=1e-6)
    if opening == 0.0:
        np.testing.assert_array_equal(found.total, BASE)


def test_an_action_beyond_the_box_passes_where_nothing_is_added_on_its_own():
    rule = ResidualRule(Fixed(), ROBOT, LIMITS, SCALE, None)
    beyond = np.full((1, 7), 1.5, np.float32)
    np.testing.assert_array_equal(rule.correct(np.zeros((1, 36)), beyond, np.zeros_like(BASE)).total, beyond)


def test_a_policy_with_a_memory_is_refused():
    rule = ResidualRule(Fixed(state=(np.zeros(1),)), ROBOT, LIMITS, SCALE, None)
    with pytest.raises(InvalidValueError, match="policy without memory"):
        rule.act(np.zeros((1, 36)), LEARNED)
