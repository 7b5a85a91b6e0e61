"""A recorded episode obeys the pendulum it was recorded from."""

import math

import numpy as np
import pytest
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.eval.reproduction.pendulum import PushKind, Variant
from push_recovery.eval.reproduction.recording import CaseJob, case_numbers, record
from push_recovery.eval.reproduction.scenario_1 import FORCE
from push_recovery.eval.reproduction.scenario_1 import PUSH as SCENARIO_PUSH

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


@pytest.fixture(scope="module", params=["stage-1-paper", "two-stage"])
def case(request):
    variant = Variant(request.param, request.param)
    return request.param, variant, record(variant, SCENARIO_PUSH, FORCE)


def test_numbers_of_a_case_are_those_of_its_record(case):
    name, variant, episode = case
    found = case_numbers(episode, variant.gait(0.5))
    assert found["survived"] == (name == "two-stage")
    assert found["step_error_before"] < 1e-6  # four nominal steps
    assert found["duration_error_before"] < 1e-6
    step = found["pushed_step"]
    assert step["duration"] == pytest.approx(episode.touchdown[5] - episode.touchdown[4])
    assert [step["length"], -step["width"]] == pytest.approx(episode.foothold[5] - episode.foothold[4])
    swaying = (episode.time >= 2.6) & (episode.time <= 3.6)
    assert found["peak_lean_within_1_s"] == np.abs(episode.trunk_angle[swaying]).max()
    if name == "two-stage":
        assert found["cop_to_inner_edge"] == pytest.approx(0.05)  # pushed to the right on the left foot
        assert found["final_speed"] == pytest.approx(0.5, abs=0.01)
    else:
        assert found["cop_to_inner_edge"] == 0.0
        assert "final_speed" not in found


def test_a_case_is_a_job_of_its_own(case):
    _, variant, episode = case
    job = CaseJob(variant, SCENARIO_PUSH, FORCE)
    assert job.run() == case_numbers(episode, variant.gait(0.5))
    assert job.identity()["kind"] == "case"
    assert job.identity() != CaseJob(variant, SCENARIO_PUSH, FORCE + 1.0).identity()
