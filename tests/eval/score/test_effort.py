"""What recovering took, on rows written by hand."""

import math
from pathlib import Path

import pytest
from push_recovery.eval.score.evaluate import Evaluation
from push_recovery.eval.score.report import effort_cells, effort_markdown, effort_summary, recovered_after
from push_recovery.eval.score.suites import Suite, standard_suite

SCENARIOS = standard_suite().scenarios[:3]


def row(recovered_at, energy, **more):
    measures = {
        "steps": 10, "smallest_margin": 0.125, "dcm_error": 0.01, "velocity_error": 0.1,
        "trunk_excursion": math.radians(20.0), "peak_torque": 150.0, "mean_torque": 12.34, "energy": energy,
    }  # fmt: skip
    kept = {"recovered": recovered_at is not None, "recovered_at": recovered_at, "end_time": 7.0}
    return {**kept, "measures": {**measures, **more}}


def evaluation(**rows):
    return Evaluation(Suite("three", "1", SCENARIOS), "env", rows, Path("out"), 0.0)


def test_medians_are_over_the_pushes_that_all_policies_recover_from():
    found = evaluation(
        p=[row(4.0, 1000.0), row(5.0, 9000.0), row(4.5, 3000.0, smallest_margin=None)],
        q=[row(5.5, 2000.0, steps=11), row(None, 1.0), row(6.5, 2500.0, steps=14)],
    )
    together, summary = effort_summary(found)
    assert (together, SCENARIOS[0].settle_time) == (2, 4.0)  # so that the last push ended at 3 s
    assert summary["p"]["recovered_after"] == pytest.approx((1.0 + 1.5) / 2)
    assert summary["q"]["recovered_after"] == pytest.approx((2.5 + 3.5) / 2)
    assert (summary["p"]["energy"], summary["q"]["energy"]) == (2000.0, 2250.0)
    assert (summary["p"]["smallest_margin"], summary["q"]["steps"]) == (0.125, 12.5)
    assert effort_cells(found, {"p": "first"}) == [
        ("first", "1.25", "10", "12.5", "20.0", "150", "12.3", "2.00"),
        ("q", "3.00", "12", "12.5", "20.0", "150", "12.3", "2.25"),
    ]
    assert "| p | 1.25 | 10 | 12.5 | 20.0 | 150 | 12.3 | 2.00 |" in effort_markdown(found)


def test_rows_that_tell_of_no_effort_make_no_table():
    bare = [{**row(4.0, 1.0), "measures": {}} for _ in SCENARIOS]
    for one in bare:
        del one["measures"]
    assert (effort_cells(evaluation(p=bare)), effort_markdown(evaluation(p=bare))) == ([], "")
    lost = evaluation(p=[row(None, 1.0)] * 3)
    assert effort_summary(lost)[0] == 0
    assert effort_markdown(lost) == ""


def test_recovery_during_the_push_counts_as_at_once():
    assert recovered_after(row(2.9, 1.0), 4.0) == 0.0
    assert recovered_after(row(None, 1.0), 4.0) is None
