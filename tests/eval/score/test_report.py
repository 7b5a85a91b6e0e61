"""The table of an evaluation on rows written by hand."""

from pathlib import Path

from push_recovery.eval.score.evaluate import Evaluation
from push_recovery.eval.score.report import evaluation_cells, kinds_markdown, pairs_markdown, reason_cells
from push_recovery.eval.score.suites import Suite, standard_suite


def row(impulse, recovered, survived=True, reason=None):
    return {"impulse": impulse, "recovered": recovered, "survived": survived, "failure_reason": reason}


ROWS = [
    row(4.9, False), row(5.0, True), row(60.0, True), row(60.1, False, False, "low"),
    row(75.0, False, False, "low"),
]  # fmt: skip


def test_recovered_survived_and_why_not():
    suite = Suite("five", "1", standard_suite().scenarios[:5])
    evaluation = Evaluation(suite, "env", {"p": ROWS, "q": ROWS[3:]}, Path("out"), 0.0)
    # Wilson (1927) of 2 of 5 and of 0 of 2, z = 1.959964
    assert evaluation_cells(evaluation) == [
        ("p", "2/5", "0.400", "0.118-0.769", "3"), ("q", "0/2", "0.000", "0.000-0.658", "0")
    ]  # fmt: skip
    assert reason_cells(evaluation) == [("low 2, not_settled 1", "-"), ("low 2", "-")]


def test_every_two_policies_are_paired():
    suite = Suite("five", "1", standard_suite().scenarios[:5])
    none = [{**row, "recovered": False} for row in ROWS]
    evaluation = Evaluation(suite, "env", {"p": ROWS, "q": none, "r": none}, Path("out"), 0.0)
    page = pairs_markdown(evaluation)
    assert "| p | q | 2 | 0 | 0.5 |" in page  # two that differ: p = 2 / 2^2
    assert "| q | r | 0 | 0 | 1 |" in page
    assert pairs_markdown(Evaluation(suite, "env", {"p": ROWS}, Path("out"), 0.0)) == ""


def test_kinds_of_push_have_a_column_for_each_policy():
    first, other = (
        standard_suite().scenarios[0],
        next(s for s in standard_suite().scenarios if s.command.vx > 0),
    )
    names = {s.id: "forward" if s.command.vx > 0 else "other" for s in (first, other)}
    assert set(names.values()) == {"forward", "other"}
    suite = Suite("two", "1", (first, other))
    rows = [{**row(5.0, s is other), "scenario_id": s.id} for s in suite.scenarios]
    evaluation = Evaluation(suite, "env", {"p": rows, "q": rows}, Path("out"), 0.0)
    lines = [line.replace(" ", "") for line in kinds_markdown(evaluation).splitlines()]
    assert "|kindofpush|p|q|" in lines
    assert "|forward|1/1of1|1/1of1|" in lines
    same = Evaluation(Suite("one", "1", (other,)), "env", {"p": rows[1:]}, Path("out"), 0.0)
    assert kinds_markdown(same) == ""
