"""The tables of a study on numbers written by hand."""

from types import SimpleNamespace

from push_recovery.eval.tuning.space import Dimension, Space
from push_recovery.eval.tuning.variants import field_cells, score_cells

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
