"""A recorded episode obeys the pendulum it was recorded from."""

import math

import numpy as np
import pytest
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.eval.reproduction.pendulum import PushKind, Variant
from push_recovery.eval.reproduction.recording import record

ROBOT = RobotModel()
PUSH = PushKind(-90.0, vx=0.5)


@pytest.fixture(scope="module")
def pushed():
    return record(Variant("two-stage"), PUSH, 315.0)


def test_scenario_1_is_pushed_at_2600_ms_on_left_stance(pushed):
    assert pushed.push_start == pytest.approx(2.6, abs=1e-9)
    assert pushed.push_force == pytest.approx([0.0, -315.0], abs=1e-9)
    during = int(np.argmin(np.abs(pushed.time - 2.65)))
    assert pushed.step[during] == 4
    assert pushed.foothold_side[:5].tolist() == [0, 1, 0, 1, 0]
    assert pushed.touchdown[:5] == pytest.approx([0.0, 0.65, 1.3, 1.95, 2.6], abs=1e-6)
    assert np.diff(pushed.foothold[:5, 0]) == pytest.approx(0.325, abs=1e-6)
    assert pushed.survived


def test_samples_follow_the_cmp(pushed):
    """xi' = omega (xi - cmp) while nobody pushes and no foot touches down within the period."""
    omega, dt = ROBOT.omega, 0.01
    growth = math.exp(omega * dt)
    quiet = (pushed.time[1:] < 2.6) | (pushed.time[1:] > 2.72)
    off = np.abs(pushed.time[:, None] - pushed.touchdown[None, :]).min(axis=1)
    inside = quiet & (off[1:] > 0.011)
    expected = growth * pushed.dcm[:-1] - (growth - 1.0) * pushed.cmp[1:]
    at_stop = (np.abs(pushed.trunk_angle) > ROBOT.trunk_angle_max - 1e-9).any(axis=1)[1:]
    keep = inside & ~at_stop
    assert keep.sum() > 300
    assert pushed.dcm[1:][keep] == pytest.approx(expected[keep], abs=1e-9)


def test_inputs_stay_within_the_robot(pushed):
    assert np.abs(pushed.trunk_torque).max() <= ROBOT.trunk_torque_max + 1e-6
    assert np.abs(pushed.trunk_torque).max() > 10.0
    assert np.abs(pushed.trunk_angle).max() <= ROBOT.trunk_angle_max + 1e-9
    assert pushed.trunk_torque == pytest.approx(ROBOT.weight * (pushed.cmp - pushed.cop), abs=1e-9)
    assert pushed.swing[:, 2].min() >= 0.0


def test_a_fall_is_recorded_until_it_is_certain():
    fallen = record(Variant("stage-1-paper", "stage-1-paper"), PUSH, 315.0)
    assert not fallen.survived
    assert fallen.time[-1] < 6.0
    assert abs(fallen.dcm[-1, 1] - fallen.stance[-1, 1]) > 0.25
    assert not np.any(fallen.trunk_torque)
