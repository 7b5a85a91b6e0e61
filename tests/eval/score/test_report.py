"""The table of an evaluation on rows written by hand."""

from pathlib import Path

from push_recovery.eval.score.evaluate import Evaluation
from push_recovery.eval.score.report import COLUMNS, evaluation_cells, kinds_markdown
from push_recovery.eval.score.suites import Suite, standard_suite


def row(impulse, recovered, survived=True, reason=None):
    return {"impulse": impulse, "recovered": recovered, "survived": survived, "failure_reason": reason}


ROWS = [
    row(4.9, False), row(5.0, True), row(60.0, True), row(60.1, False, False, "low"),
    row(75.0, False, False, "low"),
]  # fmt: skip


def test_the_second_rate_is_of_pushes_from_5_to_60_newton_seconds():
    suite = Suite("five", "1", standard_suite().scenarios[:5])
    evaluation = Evaluation(suite, "env", {"p": ROWS, "q": ROWS[3:]}, Path("out"), 0.0)
    p, q = evaluation_cells(evaluation)
    assert COLUMNS[4] == "rate 5-60 N s"
    # Wilson (1927) of 2 of 5 and of 2 of 2: 1 / (1 + z^2 / n) below, z = 1.959964
    assert p == ("p", "2/5", "0.400", "0.118-0.769", "1.000 (0.342-1.000)", "3", "low 2, not_settled 1", "-")
    assert q[1:3] + q[4:6] == ("0/2", "0.000", "-", "0")


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
