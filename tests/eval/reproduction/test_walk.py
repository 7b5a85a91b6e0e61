"""A recorded walk obeys the pendulum it was recorded from."""

import math

import numpy as np
import pytest
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.pendulum.env import PendulumEnv
from push_recovery.eval.record.record import record_episode
from push_recovery.eval.reproduction.jobs import CaseJob, case_numbers
from push_recovery.eval.reproduction.pendulum import Variant, record
from push_recovery.eval.reproduction.scenarios import FORCE, PUSH

ROBOT = RobotModel()


@pytest.fixture(scope="module")
def pushed():
    return record(Variant("two-stage"), PUSH, 315.0)


def test_the_time_histories_are_those_of_the_environment(pushed):
    env, policy = PendulumEnv(), Variant("two-stage").made_policy()
    found = record_episode(env, policy, pushed.scenario, "pendulum")
    assert list(found) == list(pushed)
    for name in found:
        np.testing.assert_array_equal(found[name], pushed[name], err_msg=name)
    assert (found.outcome, found.push_starts, found.sole) == (pushed.outcome, pushed.push_starts, pushed.sole)


def test_scenario_1_is_pushed_at_2600_ms_on_left_stance(pushed):
    assert pushed.push_start == pytest.approx(2.6, abs=1e-9)
    assert pushed.push_force == pytest.approx([0.0, -315.0], abs=1e-9)
    during = int(np.argmin(np.abs(pushed["time"] - 2.65)))
    assert pushed["step"][during] == 4
    assert pushed.foothold_side[:5].tolist() == [0, 1, 0, 1, 0]
    assert pushed.touchdown[:5] == pytest.approx([0.0, 0.65, 1.3, 1.95, 2.6], abs=1e-6)
    assert np.diff(pushed.foothold[:5, 0]) == pytest.approx(0.325, abs=1e-6)
    assert pushed.outcome.survived


def test_samples_follow_the_cmp(pushed):
    """xi' = omega (xi - cmp) while nobody pushes and no foot touches down within the period."""
    omega, dt = ROBOT.omega, 0.01
    growth = math.exp(omega * dt)
    quiet = (pushed["time"] < 2.6) | (pushed["time"] > 2.72)
    off = np.abs(pushed["time"][:, None] - pushed.touchdown[None, :]).min(axis=1)
    lean = np.maximum(np.abs(pushed["trunk_pitch"]), np.abs(pushed["trunk_roll"]))
    keep = (quiet & (off > 0.011) & (lean <= ROBOT.trunk_angle_max - 1e-9))[1:]
    expected = growth * pushed.points("dcm")[:-1] - (growth - 1.0) * pushed.points("cmp")[1:]
    assert keep.sum() > 300
    assert pushed.points("dcm")[1:][keep] == pytest.approx(expected[keep], abs=1e-9)


def test_inputs_stay_within_the_robot(pushed):
    for axis, name in zip("xy", ("pitch", "roll"), strict=True):
        torque, lean = pushed[f"torque_trunk_{name}"], pushed[f"trunk_{name}"]
        assert np.abs(torque).max() <= ROBOT.trunk_torque_max + 1e-6
        assert np.abs(lean).max() <= ROBOT.trunk_angle_max + 1e-9
        offset = pushed[f"cmp_{axis}"] - pushed[f"cop_{axis}"]
        assert torque == pytest.approx(ROBOT.weight * offset, abs=1e-9)
    assert np.abs(pushed["torque_trunk_roll"]).max() > 10.0
    assert min(pushed["left_sole_z"].min(), pushed["right_sole_z"].min()) >= 0.0


def test_steps_are_where_and_when_the_soles_were_set_down(pushed):
    for k, (place, side) in enumerate(zip(pushed.foothold, pushed.foothold_side, strict=True)):
        during = pushed["step"] == k
        assert (pushed["stance_side"][during] == side).all()
        sole = pushed.points("left_sole" if side == 0 else "right_sole")[during]
        np.testing.assert_allclose(sole, np.broadcast_to(place, sole.shape), atol=1e-12)
        assert 0.0 <= pushed["time"][during][0] - pushed.touchdown[k] < 0.01


def test_a_fall_is_recorded_until_it_is_certain():
    fallen = record(Variant("stage-1-paper", "stage-1-paper"), PUSH, 315.0)
    assert not fallen.outcome.survived
    assert fallen["time"][-1] < 6.0
    stance = ("left", "right")[int(fallen["stance_side"][-1])]
    assert abs(fallen["dcm_y"][-1] - fallen[f"{stance}_sole_y"][-1]) > 0.25
    assert not np.any(fallen["torque_trunk_roll"])
    assert not np.any(fallen["torque_trunk_pitch"])


@pytest.mark.parametrize("name", ["stage-1-paper", "two-stage"])
def test_numbers_of_a_case_are_those_of_its_record(name):
    variant = Variant(name, name)
    episode = record(variant, PUSH, FORCE)
    found = case_numbers(episode, variant.gait(0.5))
    assert found["survived"] == (name == "two-stage")
    assert found["step_error_before"] < 1e-6  # four nominal steps
    assert found["duration_error_before"] < 1e-6
    step = found["pushed_step"]
    assert step["duration"] == pytest.approx(episode.touchdown[5] - episode.touchdown[4])
    assert [step["length"], -step["width"]] == pytest.approx(episode.foothold[5] - episode.foothold[4])
    swaying = (episode["time"] >= 2.6) & (episode["time"] <= 3.6)
    leans = [episode[f"trunk_{axis}"][swaying] for axis in ("pitch", "roll")]
    assert found["peak_lean_within_1_s"] == np.abs(leans).max()
    if name == "two-stage":
        assert found["cop_to_inner_edge"] == pytest.approx(0.05)  # pushed to the right on the left foot
        assert found["final_speed"] == pytest.approx(0.5, abs=0.01)
    else:
        assert found["cop_to_inner_edge"] == 0.0
        assert "final_speed" not in found
    job = CaseJob(variant, PUSH, FORCE)
    assert job.run() == found
    assert job.identity()["kind"] == "case"
    assert job.identity() != CaseJob(variant, PUSH, FORCE + 1.0).identity()
