import numpy as np
import pytest
from push_recovery.eval.reproduction.pendulum import Variant
from push_recovery.eval.reproduction.recording import CaseJob, case_numbers, record
from push_recovery.eval.reproduction.scenario_1 import FORCE, PUSH


@pytest.fixture(scope="module", params=["stage-1-paper", "two-stage"])
def case(request):
    variant = Variant(request.param, request.param)
    return request.param, variant, record(variant, PUSH, FORCE)


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
    job = CaseJob(variant, PUSH, FORCE)
    assert job.run() == case_numbers(episode, variant.gait(0.5))
    assert job.identity()["kind"] == "case"
    assert job.identity() != CaseJob(variant, PUSH, FORCE + 1.0).identity()
