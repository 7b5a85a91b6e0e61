import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model import gait_box
from push_recovery.controllers.model.robot import RobotModel

LIMITS = gait_box.GaitLimits()


def test_actions_span_the_box():
    np.testing.assert_array_equal(LIMITS.from_action(np.full(7, -1.0)), LIMITS.low)
    np.testing.assert_array_equal(LIMITS.from_action(np.ones(7)), LIMITS.high)
    middle = LIMITS.from_action(np.zeros((2, 3, 7), np.float32))
    np.testing.assert_allclose(middle, np.broadcast_to(0.5 * (LIMITS.low + LIMITS.high), (2, 3, 7)))


def test_actions_outside_are_clipped_and_nan_stays():
    action = np.array([-5.0, 5.0, np.nan, np.inf, -np.inf, 0.0, 1.0])
    gait = LIMITS.from_action(action)
    np.testing.assert_array_equal(gait[[0, 4]], LIMITS.low[[0, 4]])
    np.testing.assert_array_equal(gait[[1, 3, 6]], LIMITS.high[[1, 3, 6]])
    assert np.isnan(gait[2])
    assert action[0] == -5.0  # the caller's own is left alone


def test_to_action_is_the_inverse_whatever_the_memory_layout():
    actions = np.asfortranarray(np.random.default_rng(0).uniform(-1.0, 1.0, (5, 7)).astype(np.float32))
    np.testing.assert_allclose(LIMITS.to_action(LIMITS.from_action(actions)), actions, atol=1e-6)
    np.testing.assert_array_equal(LIMITS.from_action(actions), LIMITS.from_action(actions.copy("C")))


def test_seven_entries_are_asked_for():
    with pytest.raises(InvalidValueError, match=r"7 entries, got shape \(6,\)"):
        LIMITS.from_action(np.zeros(6))


def test_columns_are_those_of_the_names():
    pairs = [("step_length", "step_width", gait_box.STEP), ("cop_x", "cop_y", gait_box.COP),
             ("trunk_pitch_acceleration", "trunk_roll_acceleration", gait_box.TRUNK)]  # fmt: skip
    for x, y, column in pairs:
        assert gait_box.GAIT_NAMES[column : column + 2] == (x, y)
    assert gait_box.GAIT_NAMES[gait_box.DURATION] == "step_duration"
    assert len(gait_box.GAIT_NAMES) == gait_box.GAIT_SIZE == len(LIMITS.low)


def test_an_axis_that_the_waist_lacks_has_no_range():
    limits = gait_box.GaitLimits.of(RobotModel(trunk_torque_max=80.0, trunk_roll=False))  # 80 N m / 8 kg m^2
    np.testing.assert_array_equal(limits.box[:, 5:], [[-10.0, 0.0], [10.0, 0.0]])
    np.testing.assert_array_equal(
        gait_box.GaitLimits(trunk_pitch=False).box[:, 5:], [[0.0, -18.75], [0.0, 18.75]]
    )
    gait = np.array([0.1, 0.2, 0.5, 0.0, 0.0, 5.0, 7.0])
    np.testing.assert_array_equal(limits.to_action(gait)[5:], [0.5, 0.0])
    np.testing.assert_array_equal(limits.from_action(np.ones(7))[5:], [10.0, 0.0])


@pytest.mark.parametrize("kind", [gait_box.GaitLimits, RobotModel])
@pytest.mark.parametrize("name", ["trunk_pitch", "trunk_roll"])
def test_an_axis_is_there_or_not(kind, name):
    with pytest.raises(InvalidValueError, match=rf"{kind.__name__}\.{name} must be a bool, got 1"):
        kind(**{name: 1})
