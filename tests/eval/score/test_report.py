"""What recovering took, on rows written by hand.

Counts by kind of push, on rows written by hand.

The table of an evaluation on rows written by hand.

Profiles side by side, on rows written by hand and on one push of the biped.
"""

import json
import math
from pathlib import Path

import pytest
from push_recovery.envs.scenario.push import Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.score.evaluate import Evaluation
from push_recovery.eval.score.report import (
    effort_cells,
    effort_markdown,
    effort_summary,
    evaluation_cells,
    groups_of,
    kept_cells,
    kind_cells,
    kinds_markdown,
    pairs_markdown,
    profile_cells,
    profile_columns,
    profiles_markdown,
    reason_cells,
    recovered_after,
)
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


FORCE = (100.0, 0.0, 0.0)
PELVIS, TRUNK = Push(FORCE, 0.1, 1.0), Push(FORCE, 0.1, 1.0, "trunk")
SCENARIOS_KINDS = (
    Scenario("a", (PELVIS,)),
    Scenario("b", (TRUNK,), Command(0.1)),
    Scenario("c", (TRUNK, TRUNK), Command(0.1)),
    Scenario("d", (PELVIS, TRUNK), Command(-0.1)),
)


def kinds_row(name, recovered, survived):
    return {"scenario_id": name, "recovered": recovered, "survived": survived}


def test_recovered_and_survived_are_counted_in_each_group():
    rows = [
        kinds_row("d", False, True),
        kinds_row("a", True, True),
        kinds_row("c", False, False),
        kinds_row("b", True, True),
    ]
    assert kind_cells(SCENARIOS_KINDS, rows) == {
        "pelvis": "1 / 1 of 1",
        "pelvis and trunk": "0 / 1 of 1",
        "trunk": "1 / 1 of 2",
        "double": "0 / 1 of 2",
        "single": "2 / 2 of 2",
        "backward": "0 / 1 of 1",
        "forward": "1 / 1 of 2",
        "in place": "1 / 1 of 1",
    }


def test_a_kind_of_one_group_only_tells_nothing():
    """All of `standard` are single pushes at the pelvis."""
    assert set(groups_of(standard_suite().scenarios)) == {"backward", "forward", "in place", "sideways"}
    assert groups_of(SCENARIOS_KINDS[:1]) == {}


def report_row(impulse, recovered, survived=True, reason=None):
    return {"impulse": impulse, "recovered": recovered, "survived": survived, "failure_reason": reason}


ROWS = [
    report_row(4.9, False), report_row(5.0, True), report_row(60.0, True),
    report_row(60.1, False, False, "low"), report_row(75.0, False, False, "low"),
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
    rows = [{**report_row(5.0, s is other), "scenario_id": s.id} for s in suite.scenarios]
    evaluation = Evaluation(suite, "env", {"p": rows, "q": rows}, Path("out"), 0.0)
    lines = [line.replace(" ", "") for line in kinds_markdown(evaluation).splitlines()]
    assert "|kindofpush|p|q|" in lines
    assert "|forward|1/1of1|1/1of1|" in lines
    same = Evaluation(Suite("one", "1", (other,)), "env", {"p": rows[1:]}, Path("out"), 0.0)
    assert kinds_markdown(same) == ""


PUSHES = Suite("four", "1", tuple(Scenario(f"s{i}") for i in range(4)))


def profiles_evaluation(recovered: str, survived: str) -> Evaluation:
    rows = [
        {"recovered": r == "1", "survived": s == "1", "failure_reason": None if s == "1" else "low"}
        for r, s in zip(recovered, survived, strict=True)
    ]
    return Evaluation(PUSHES, "env", {"p": rows}, Path("out"), 0.0)


EXACT, REAL = (
    profiles_evaluation("1110", "1111"),
    profiles_evaluation("1001", "1101"),
)  # loses two recoveries, gains one


def test_recovered_and_survived_of_each_profile_stand_side_by_side():
    found = {"exact": EXACT, "hardware": REAL}
    assert profile_columns(found) == (
        "policy",
        "recovered, exact",
        "survived",
        "recovered, hardware",
        "survived",
    )
    # Wilson (1927), z = 1.959964: 3 of 4 and 2 of 4
    assert profile_cells(found) == [("p", "0.750 (0.301-0.954)", "1.000", "0.500 (0.150-0.850)", "0.750")]


def test_what_is_kept_is_a_share_of_its_own():
    assert kept_cells(EXACT, REAL) == [("p", "0.667", "0.750", "2", "1", "1")]
    nothing = profiles_evaluation("0000", "0000")
    assert kept_cells(nothing, REAL) == [("p", "-", "-", "0", "2", "0.5")]
    page = profiles_markdown({"exact": EXACT, "hardware": REAL})
    assert "## hardware against exact" in page
    assert "| p | 0.667 | 0.750 | 2 | 1 | 1 |" in page
    assert "against" not in profiles_markdown({"exact": EXACT})


def test_the_command_runs_a_suite_under_several_profiles(tmp_path, capsys):
    Suite("one", "1", (Scenario("a", (polar_push(100.0, 0.0, 0.1, 0.2),)),)).save(tmp_path / "one.json")
    argv = ["evaluate", "--suite", str(tmp_path / "one.json"), "--policies", "stage-1", "--workers", "1"]
    out = ["--out", str(tmp_path / "out")]
    assert main([*argv, *out, "--profile", "exact", "hardware", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["profiles"]
    assert [told[name]["suite"]["name"] for name in ("exact", "hardware")] == ["one", "one+hardware"]
    rows = [
        json.loads((tmp_path / "out" / name / "outcomes.jsonl").read_text()) for name in ("exact", "hardware")
    ]
    assert rows[0]["total_reward"] != rows[1]["total_reward"]
    assert main([*argv, *out, "--profile", "exact", "hardware"]) == 0  # of the rows that are there
    said = capsys.readouterr().out
    assert "recovered, hardware" in said
    assert str(tmp_path / "out" / "profiles.md") in said
    assert (tmp_path / "out" / "hardware" / "report.md").is_file()


@pytest.mark.parametrize(
    ("names", "words"),
    [(["exact", "exact"], "--profile must name each one once"), (["real"], "exact, hardware")],
)
def test_profiles_are_known_and_named_once(names, words, capsys):
    assert main(["evaluate", "--profile", *names]) == 2
    assert words in capsys.readouterr().err
