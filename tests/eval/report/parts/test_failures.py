"""What became of pushes, and limits met, on rows that are known."""

from push_recovery.controllers.whole_body.limits import BOUNDS
from push_recovery.eval.report.episodes import ending_figure, explained, limit_cells, reason_cells, reasons_of
from push_recovery.eval.report.page import LIMITS, REASONS

LABELS = {"p": "P", "q": "Q"}


def test_reasons_are_counted_and_explained(evaluation):
    found = evaluation({"p": "rsff", "q": "rrrr"})
    found.rows["p"][3]["failure_reason"] = "of_its_own"
    assert reasons_of(found) == ["not_settled", "com_height", "of_its_own"]
    assert reason_cells(found, LABELS) == [("P", "1", "1", "1", "1"), ("Q", "4", "0", "0", "0")]
    assert explained(["com_height", "of_its_own", "com_height"]) == [("com_height", REASONS["com_height"])]
    assert "<pattern" in ending_figure(found, LABELS)  # grey print tells the parts apart


def test_limits_of_falls_and_recoveries(evaluation):
    found = evaluation({"p": "rsff", "q": "rrrr"})
    found.rows["q"][0]["limit_shares"] = {"step_time": 0.4}
    columns, cells = limit_cells(found, LABELS)
    assert columns == ["limit", "met while", "P", "Q"]
    assert cells == [
        ("step_time", LIMITS["step_time"], "0 % / 0 %", "0 % / 10 %"),
        ("cop", LIMITS["cop"], "50 % / 0 %", "0 % / 0 %"),
    ]


def test_every_limit_has_words():
    assert set(LIMITS) == set(BOUNDS)
