"""The capture-point rule, with footholds worked out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import UnknownNameError
from push_recovery.controllers.model.gait_box import DURATION, STEP, GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.model.observation import COMMAND, DCM, ELAPSED, SWING_POSITION
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.settings import PlannerConfig, preset_config
from push_recovery.controllers.stage_1 import OFFSET, REMAINING, ROW_SIZE, TARGET, StepPlanner

ROBOT, LIMITS = RobotModel(), GaitLimits()
OMEGA = ROBOT.omega
CONFIG = PlannerConfig(foothold="capture_point", push_carry=0.0, freeze=0.0)


def plan(elapsed, dcm, command=(0.0, 0.0), config=CONFIG, swing=(0.0, 0.2)):
    observation = np.zeros(36)
    observation[ELAPSED], observation[DCM], observation[COMMAND] = elapsed, dcm, command
    observation[SWING_POSITION] = *swing, 0.0
    rows = np.zeros((1, ROW_SIZE))
    StepPlanner(ROBOT, LIMITS, config).plan(observation[None], rows)
    return rows[0]


def nominal_dcm(gait, elapsed, delay=0.0):
    """(u + b) exp(-omega (T + delay - t)), (2,)."""
    end = np.array([gait.length + gait.offset_x, gait.width + gait.offset_y])
    return end * math.exp(-OMEGA * (gait.duration + delay - elapsed))


@pytest.mark.parametrize("elapsed", [0.0, 0.2, 0.6])
@pytest.mark.parametrize("command", [(0.0, 0.0), (0.4, 0.0), (-0.2, 0.0), (0.0, -0.1)])
def test_the_capture_points_error_moves_the_foothold_one_for_one_at_any_moment(elapsed, command):
    gait = nominal_gait(ROBOT, LIMITS, command)
    expected = nominal_dcm(gait, elapsed)
    undisturbed = plan(elapsed, expected, command)
    np.testing.assert_allclose(undisturbed[STEP : STEP + 2], [gait.length, gait.width], atol=1e-12)
    np.testing.assert_allclose(undisturbed[OFFSET : OFFSET + 2], gait.offset, atol=1e-12)
    pushed = plan(elapsed, expected + [0.05, -0.03], command)
    np.testing.assert_allclose(pushed[STEP : STEP + 2], [gait.length + 0.05, gait.width - 0.03], atol=1e-12)
    assert pushed[DURATION] == gait.duration
    growth = math.exp(OMEGA * (gait.duration - elapsed))
    left = gait.offset + (growth - 1.0) * np.array([0.05, -0.03])  # what one for one leaves to the next step
    np.testing.assert_allclose(pushed[OFFSET : OFFSET + 2], left, atol=1e-12)


def test_in_place_the_numbers_are_these():
    """l_p 0.2 m, T 0.65 s: half-way xi_nom is 0.2 / (exp(0.325 omega) + exp(-0.325 omega))."""
    half = math.exp(0.325 * math.sqrt(9.81 / ROBOT.com_height))
    row = plan(0.325, (0.1, 0.2 / (half + 1 / half)))
    np.testing.assert_allclose(row[STEP : STEP + 3], [0.1, 0.2, 0.65], atol=1e-12)
    b = -0.2 / (half**2 + 1.0)
    assert row[OFFSET + 1] == pytest.approx(b, abs=1e-12)
    np.testing.assert_allclose(row[TARGET : TARGET + 2], [0.1, 0.2 + b], atol=1e-12)


def test_the_step_stays_in_its_box():
    gait = nominal_gait(ROBOT, LIMITS)
    for error, bounds in (((2.0, 2.0), LIMITS.high), ((-2.0, -2.0), LIMITS.low)):
        row = plan(0.1, nominal_dcm(gait, 0.1) + error)
        assert row[STEP : STEP + 2].tolist() == bounds[:2].tolist()


def test_a_step_that_is_late_ends_a_margin_from_now_and_its_delay_counts():
    config = replace(CONFIG, duration_margin=0.02, touchdown_delay=0.01)
    gait = nominal_gait(ROBOT, LIMITS, touchdown_delay=0.01)
    early = plan(0.3, nominal_dcm(gait, 0.3, 0.01), config=config)
    assert early[DURATION] == gait.duration
    np.testing.assert_allclose(early[STEP : STEP + 2], [0.0, 0.2], atol=1e-12)
    late = plan(0.9, (0.0, 0.1), config=config)
    assert late[DURATION] == pytest.approx(0.92)
    assert late[REMAINING] == pytest.approx(0.03)
    nominal = (0.2 + gait.offset_y) * math.exp(-OMEGA * 0.03)
    assert late[STEP + 1] == pytest.approx(0.2 + 0.1 - nominal, abs=1e-12)


def test_in_double_support_a_foot_that_follows_to_the_end_leaves_the_nominal_g():
    """What the next step grows from is b + c u (`planner`): at touchdown it must be nominal, c = kappa(0)."""
    d = 0.1
    config = replace(preset_config("double-support"), foothold="capture_point", push_carry=0.0)
    gait = nominal_gait(ROBOT, LIMITS, (0.2, 0.0), 0.0, d)
    end = np.array([gait.length + gait.offset_x, gait.width + gait.offset_y])
    row = plan(gait.duration, end + [0.02, 0.01], (0.2, 0.0), config)
    c = 1.0 - (1.0 - math.exp(-OMEGA * d)) / (OMEGA * d)  # kappa(0)
    g = row[OFFSET : OFFSET + 2] + c * row[STEP : STEP + 2]
    np.testing.assert_allclose(g, gait.offset + c * np.array([gait.length, gait.width]), atol=1e-12)


def test_another_foothold_is_refused_and_the_nearest_named():
    message = r"unknown PlannerConfig\.foothold 'capture'; did you mean 'capture_point'\?"
    with pytest.raises(UnknownNameError, match=message):
        PlannerConfig(foothold="capture")  # pyright: ignore[reportArgumentType]
