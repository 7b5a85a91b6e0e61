"""Several arms searched one after the other: one budget, directories of their own, one record."""

import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.settings import load_preset
from push_recovery.eval.tuning.study import TuningSettings, tune
from push_recovery.eval.tuning.variants import tune_arms

SETTINGS = TuningSettings("PushRecovery/Pendulum-v0", "stage-1", scenarios=8, held_out=8)
ARMS = ["stage-1", "fixed-time"]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return tune_arms(SETTINGS, ARMS, 2, directory=tmp_path_factory.mktemp("arms"))


def test_every_arm_has_the_search_that_it_would_have_alone(found, tmp_path):
    alone = tune(TuningSettings(**{**vars(SETTINGS), "policy": "fixed-time"}), 2, directory=tmp_path)
    assert list(found.studies) == ARMS
    assert found.studies["fixed-time"].trials == alone.trials
    assert found.studies["fixed-time"].path.read_bytes() == alone.path.read_bytes()
    assert found.studies["fixed-time"].directory == found.directory / "fixed-time"


def test_the_record_has_what_is_best_for_each_arm_and_how_it_was_found(found):
    record = load_preset(str(found.path))
    for name in ARMS:
        study = found.studies[name]
        assert record.config(name) == study.preset.config(name)
        assert record.found[name] == study.preset.found
        assert record.found[name]["trials"] == 2
    assert record.config("two-stage") == load_preset("default").config("two-stage")


def test_a_second_run_adds_arms_and_runs_nothing_again(found, tmp_path):
    first = tune_arms(SETTINGS, ARMS[:1], 2, directory=tmp_path)
    seen = []
    both = tune_arms(
        SETTINGS, ARMS, 2, directory=tmp_path, on_trial={"fixed-time": lambda row, best: seen.append(row)}
    )
    assert both.studies["stage-1"].trials == first.studies["stage-1"].trials
    assert len(seen) == 2
    assert both.path.read_bytes() == found.path.read_bytes()


def test_names_fail_before_the_first_search(tmp_path):
    with pytest.raises(UnknownNameError, match="unknown policy to tune 'random'"):
        tune_arms(SETTINGS, ["stage-1", "random"], 1, directory=tmp_path)
    with pytest.raises(InvalidValueError, match=r"^arm 'stage-1' is given more than once$"):
        tune_arms(SETTINGS, ["stage-1", "stage-1"], 1, directory=tmp_path)
    assert list(tmp_path.iterdir()) == []
