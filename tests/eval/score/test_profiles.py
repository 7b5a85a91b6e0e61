"""Profiles side by side, on rows written by hand and on one push of the biped."""

import json
from pathlib import Path

import pytest
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.score.evaluate import Evaluation
from push_recovery.eval.score.report import kept_cells, profile_cells, profile_columns, profiles_markdown
from push_recovery.eval.score.suites import Suite

PUSHES = Suite("four", "1", tuple(Scenario(f"s{i}") for i in range(4)))


def evaluation(recovered: str, survived: str) -> Evaluation:
    rows = [
        {"recovered": r == "1", "survived": s == "1", "failure_reason": None if s == "1" else "low"}
        for r, s in zip(recovered, survived, strict=True)
    ]
    return Evaluation(PUSHES, "env", {"p": rows}, Path("out"), 0.0)


EXACT, REAL = evaluation("1110", "1111"), evaluation("1001", "1101")  # loses two recoveries, gains one


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
    nothing = evaluation("0000", "0000")
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
