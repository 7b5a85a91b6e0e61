"""What a preset file says of its search, from rows written by hand."""

import pytest
from push_recovery.eval.tuning.study import comparison, findings


def row(number, values, stopped=False):
    return {
        "trial": number, "values": values, "score": sum(values) / len(values), "stopped": stopped,
        "scenarios": len(values),
    }  # fmt: skip


# recovered by both, by the best alone (three times), by the start alone, by neither (0.5 stands unsettled)
START = row(0, [1.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0])
BEST = row(2, [1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.0])


def test_recoveries_are_paired_and_scores_are_not_recoveries():
    found = comparison(START, BEST)
    assert found["start"] == {"score": 3.0 / 8.0, "recovered": 2}
    assert found["best"] == {"score": 5.5 / 8.0, "recovered": 4}
    assert (found["scenarios"], found["only_best"], found["only_start"]) == (8, 3, 1)
    assert found["rate_difference"] == pytest.approx(0.25)
    assert found["mcnemar_p"] == pytest.approx(2 * (4 + 1) / 2**4)  # at least 3 of 4, both tails
    low, high = found["ci95"]
    assert low < 0.25 < high


def test_held_out_compares_start_with_best_and_episodes_are_added_up():
    rows = [START, row(1, [0.0, 0.0], stopped=True), BEST]
    config = {"tune": {"seed": 3}, "suites": [], "code": "c", "space": {}}
    found = findings(config, 6, rows, {0: row(0, [1.0, 0.0]), 2: row(2, [0.0, 0.0])})
    assert (found["trials"], found["stopped_early"], found["episodes"], found["trial"]) == (2, 1, 22, 2)
    assert found["tuning"] == comparison(START, BEST)
    assert (found["held_out"]["start"]["recovered"], found["held_out"]["best"]["recovered"]) == (1, 0)
    assert (found["tune"], found["code"]) == ({"seed": 3}, "c")
    assert ", 6 trials a generation" in found["by"]
