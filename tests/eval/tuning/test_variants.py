"""Several variants searched one after the other: directories of their own, one record, and its tables."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.settings import PresetFile, load_preset
from push_recovery.eval.tuning.space import Dimension, Space
from push_recovery.eval.tuning.study import TuningSettings, tune
from push_recovery.eval.tuning.variants import all_trials, field_cells, score_cells, tune_variants

SETTINGS = TuningSettings("PushRecovery/Pendulum-v0", "stage-1", scenarios=8, held_out=8)
VARIANTS = ["stage-1", "fixed-time"]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return tune_variants(SETTINGS, VARIANTS, 2, directory=tmp_path_factory.mktemp("variants"))


def test_every_variant_has_the_search_that_it_would_have_alone(found, tmp_path):
    alone = tune(replace(SETTINGS, policy="fixed-time"), 2, directory=tmp_path)
    assert list(found.studies) == VARIANTS
    assert found.studies["fixed-time"].trials == alone.trials
    assert found.studies["fixed-time"].path.read_bytes() == alone.path.read_bytes()
    assert found.studies["fixed-time"].directory == found.directory / "fixed-time"


def test_the_record_has_what_is_best_for_each_variant_and_how_it_was_found(found):
    record = load_preset(str(found.path))
    for name in VARIANTS:
        study = found.studies[name]
        assert record.config(name) == study.preset.config(name)
        assert record.found[name] == study.preset.found
        assert record.found[name]["trials"] == 2
    assert record.found["trials"] == {"stage-1": 2, "fixed-time": 2}
    assert record.config("two-stage") == load_preset("default").config("two-stage")


def test_trials_add_up_over_searches_that_begin_where_one_ended():
    start = PresetFile(found={"trials": {"two-stage": 158, "raibert": 5}})
    assert all_trials(start, {"two-stage": {"trials": 30}, "herdt": {"trials": 4}}) == {
        "two-stage": 188, "raibert": 5, "herdt": 4
    }  # fmt: skip
    assert all_trials(PresetFile(found={"trials": 250}), {"herdt": {"trials": 4}}) == {"herdt": 4}


def test_a_second_run_adds_variants_and_runs_nothing_again(found, tmp_path):
    first = tune_variants(SETTINGS, VARIANTS[:1], 2, directory=tmp_path)
    seen = []
    both = tune_variants(
        SETTINGS, VARIANTS, 2, directory=tmp_path, on_trial={"fixed-time": lambda row, best: seen.append(row)}
    )
    assert both.studies["stage-1"].trials == first.studies["stage-1"].trials
    assert len(seen) == 2
    assert both.path.read_bytes() == found.path.read_bytes()


def test_names_fail_before_the_first_search(tmp_path):
    with pytest.raises(UnknownNameError, match="unknown policy to tune 'random'"):
        tune_variants(SETTINGS, ["stage-1", "random"], 1, directory=tmp_path)
    with pytest.raises(InvalidValueError, match=r"^variant 'stage-1' is given more than once$"):
        tune_variants(SETTINGS, ["stage-1", "stage-1"], 1, directory=tmp_path)
    assert list(tmp_path.iterdir()) == []


ENTRY = {
    "start": {"score": 0.25, "recovered": 2}, "best": {"score": 0.75, "recovered": 6}, "scenarios": 8,
    "rate_difference": 0.5, "ci95": [-0.125, 0.875], "mcnemar_p": 0.0625,
}  # fmt: skip


def test_start_stands_before_best():
    cells = score_cells("held_out", ENTRY)
    assert cells == ("held out", "0.250 (2/8)", "0.750 (6/8)", "+0.500 (-0.125 to +0.875)", "0.0625")


def test_the_fields_that_moved_most_come_first_whatever_their_way():
    dimensions = tuple(Dimension("g", name, -10.0, 10.0, 1.0) for name in "abc")
    study = SimpleNamespace(
        space=Space(dimensions, (0.0, 1.0, 2.0)),
        start={"settings": {"g": {"a": 0.0, "b": 1.0, "c": 2.0}}},
        best={"settings": {"g": {"a": 0.5, "b": -2.0, "c": 3.0}}, "point": [0.5, -3.0, 1.0]},
    )
    assert field_cells(study, 2) == [("g.b", "1", "-2", "-3.00"), ("g.c", "2", "3", "+1.00")]  # type: ignore[arg-type]


def test_an_impossible_variant_is_refused_before_the_first_one_is_searched(monkeypatch, tmp_path):
    """Herdt's MPC knows no double support."""
    monkeypatch.setattr("push_recovery.eval.tuning.variants.tune", None)
    settings = TuningSettings("PushRecovery/Pendulum-v0", "stage-1", preset="double-support")
    with pytest.raises(InvalidValueError, match="double support"):
        tune_variants(settings, ["stage-1", "herdt"], 1, directory=tmp_path / "out")
    assert not (tmp_path / "out").exists()
