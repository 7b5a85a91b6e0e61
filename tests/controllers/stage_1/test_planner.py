"""Plans of stage 1 in states that a walk seldom meets, against their equations written out here."""

import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.model.double_support import transfer_weight
from push_recovery.controllers.model.gait_box import DURATION, STEP, GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.model.observation import (
    COMMAND,
    DCM,
    ELAPSED,
    PREVIOUS_ACTION,
    PUSH_ESTIMATE,
    SWING_POSITION,
)
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.settings import PlannerConfig, preset_config
from push_recovery.controllers.stage_1 import (
    HELD,
    OFFSET,
    REMAINING,
    ROW_SIZE,
    TARGET,
    StepPlanner,
    StepProblem,
    solve_step,
)

ROBOT, LIMITS = RobotModel(), GaitLimits()
OMEGA = ROBOT.omega


def plan(observation: np.ndarray, config: PlannerConfig, adapt: bool = True) -> np.ndarray:
    """The row (ROW_SIZE,) of one observation (36,)."""
    rows = np.zeros((1, ROW_SIZE))
    StepPlanner(ROBOT, LIMITS, config, adapt).plan(observation[None], rows)
    return rows[0]


@pytest.mark.parametrize("elapsed", [0.38, 0.45])  # before and after the time that was planned
def test_a_step_that_is_held_ends_where_its_dcm_drifts_to(elapsed):
    """b = (xi - 0) exp(omega (T + delay - t)) - u; a step that is late ends now."""
    config = PlannerConfig(freeze=0.05, touchdown_delay=0.02, trunk_debt=False)
    observation = np.zeros(36)
    asked = np.array([0.1, 0.25, 0.4, 0.0, 0.0, 0.0, 0.0])
    observation[PREVIOUS_ACTION] = LIMITS.to_action(asked)
    observation[ELAPSED], observation[DCM] = elapsed, (0.12, 0.2)
    row = plan(observation, config)
    assert row[HELD] == 1.0
    np.testing.assert_allclose(row[STEP : STEP + 3], asked[:3], atol=1e-6)
    growth = math.exp(OMEGA * (max(0.4 - elapsed, 0.0) + 0.02))
    np.testing.assert_allclose(
        row[OFFSET : OFFSET + 2], growth * np.array([0.12, 0.2]) - asked[:2], atol=1e-5
    )
    assert row[REMAINING] == pytest.approx(max(0.4 - elapsed, 0.0) + 0.02, abs=1e-6)


def test_only_a_push_beyond_its_threshold_is_carried_on():
    config = PlannerConfig(push_carry=0.1, push_threshold=0.2)
    quiet, below, above = np.zeros((3, 36))
    for observation in (quiet, below, above):
        observation[DCM] = 0.02, 0.1
    below[PUSH_ESTIMATE], above[PUSH_ESTIMATE] = (0.12, 0.15), (0.13, 0.16)  # 0.192 and 0.206 m
    assert plan(below, config).tobytes() == plan(quiet, config).tobytes()
    assert abs(plan(above, config)[STEP] - plan(quiet, config)[STEP]) > 1e-3


def test_in_double_support_the_step_keeps_its_price():
    """Stage 1 solves for v = u (1 - c) and g = b + c u, and alpha_step prices u itself."""
    d = 0.1
    config = replace(preset_config("double-support"), alpha_step=50.0, alpha_offset=5.0)
    assert config.double_support == d
    observation = np.zeros(36)
    observation[ELAPSED], observation[DCM], observation[COMMAND] = 0.05, (0.03, 0.16), (0.2, 0.0)
    observation[SWING_POSITION] = -0.1, 0.2, 0.0
    row = plan(observation, config)
    nominal = nominal_gait(ROBOT, LIMITS, (0.2, 0.0), 0.0, d)
    c, now = transfer_weight(0.0, d, OMEGA), transfer_weight(0.05, d, OMEGA)
    reach = 1.0 - c
    gain = (observation[DCM] - now * observation[SWING_POSITION][:2]) * math.exp(-OMEGA * 0.05)
    step = np.array([nominal.length, nominal.width])
    offset = nominal.offset + c * step
    exact = solve_step(
        StepProblem(
            gain=(gain[0], gain[1]),
            step_nominal=(reach * step[0], reach * step[1]),
            tau_nominal=math.exp(OMEGA * nominal.duration),
            offset_nominal=(offset[0], offset[1]),
            step_low=(reach * LIMITS.length_min, reach * LIMITS.width_min),
            step_high=(reach * LIMITS.length_max, reach * LIMITS.width_max),
            tau_low=math.exp(OMEGA * LIMITS.duration_min),
            tau_high=math.exp(OMEGA * LIMITS.duration_max),
            alpha_step=50.0 / reach**2,
            alpha_duration=config.alpha_duration,
            alpha_offset=5.0,
        )
    )
    found = np.array(exact.step) / reach
    assert abs(found[0] - nominal.length) > 0.01  # the price is felt
    np.testing.assert_allclose(row[STEP : STEP + 2], found, atol=1e-9)
    assert row[DURATION] == pytest.approx(exact.duration(OMEGA), abs=1e-9)
    np.testing.assert_allclose(row[OFFSET : OFFSET + 2], np.array(exact.offset) - c * found, atol=1e-9)
    np.testing.assert_allclose(
        row[TARGET : TARGET + 2], found + nominal.offset + c * (step - found), atol=1e-9
    )


def test_a_swing_foot_that_cannot_be_in_time_gets_the_longest_step():
    """With hardly any acceleration every place needs longer than T_max, which stays the bound."""
    observation = np.zeros(36)
    observation[DCM], observation[SWING_POSITION] = (0.2, 0.25), (-0.5, 0.3, 0.0)
    row = plan(observation, PlannerConfig(swing_acceleration=0.5))
    assert row[DURATION] == pytest.approx(LIMITS.duration_max, abs=1e-9)
    late = observation.copy()
    late[ELAPSED] = LIMITS.duration_max + 0.1
    assert plan(late, PlannerConfig(swing_acceleration=0.5))[DURATION] == pytest.approx(
        LIMITS.duration_max + 0.1, abs=1e-9
    )


def test_without_adaptation_every_state_gets_the_nominal_gait():
    observation = np.zeros(36)
    observation[DCM], observation[COMMAND], observation[ELAPSED] = (0.4, -0.3), (0.3, 0.05), 0.2
    row, nominal = plan(observation, PlannerConfig(), adapt=False), nominal_gait(ROBOT, LIMITS, (0.3, 0.05))
    np.testing.assert_array_equal(row[STEP : STEP + 3], [nominal.length, nominal.width, nominal.duration])
    np.testing.assert_array_equal(row[OFFSET : OFFSET + 2], nominal.offset)
    assert row[REMAINING] == nominal.duration - 0.2
