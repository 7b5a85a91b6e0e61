"""The command that holds this tree's rows against another commit's, on rows written by hand."""

import io
import json
import runpy
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

MAIN = runpy.run_path(str(Path(__file__).parents[1] / "benchmarks" / "same_rows.py"))["main"]
ROW = {"scenario_id": "s", "policy": "p", "end_time": 1.5, "limits": {"cop": 0.1}, "command": [0.0, 1.0]}
NUMBERS = {"F*": 641.4774346291564, "arms": {"two-stage": [{"psi_deg": 0, "max_force_N": 300.0}]}}


def write(folder: Path, rows, numbers=None) -> Path:
    folder.mkdir(parents=True)
    (folder / "outcomes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    if numbers is not None:
        (folder / "reproduction.json").write_text(json.dumps(numbers, indent=1))
    return folder.parent


def same(*arguments) -> tuple[int, str]:
    """Exit code and all that the script prints."""
    code, said = 0, io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        try:
            MAIN(list(map(str, arguments)))
        except SystemExit as leave:
            code = leave.code if isinstance(leave.code, int) else 1
            print(leave.code if code else "")
    return code, said.getvalue()


def test_equal_runs_in_another_order_and_with_more_beside_them_pass(tmp_path):
    other = {**ROW, "scenario_id": "t"}
    a = write(tmp_path / "a" / "quick", [ROW, other])
    write(a / "reproduce", [{"key": "1f"}], NUMBERS)
    b = write(tmp_path / "b" / "quick", [other, {**ROW, "new": 1}])
    write(b / "reproduce", [{"key": "other hash"}], {**NUMBERS, "more": 2.0})
    code, out = same("--a", a, "--b", b)
    assert code == 0, out
    assert "quick: 14 of 14 entries equal, 1 only in B" in out
    assert "reproduce: 4 of 4 entries equal, 1 only in B" in out
    assert same("--a", a / "quick", "--b", b / "quick")[0] == 0


@pytest.mark.parametrize(
    "change",
    [
        {"end_time": 1.5000000000000002},
        {"limits": {"cop": 0.2}},
        {"command": [-0.0, 1.0]},
        {"command": [0.0, 1.0, 0.0]},
        {"end_time": None},
        {"scenario_id": "another"},
    ],
)
def test_one_bit_of_a_row_fails(tmp_path, change):
    a = write(tmp_path / "a" / "quick", [ROW])
    code, out = same("--a", a, "--b", write(tmp_path / "b" / "quick", [{**ROW, **change}]))
    assert code == 1
    assert "in A" in out


def test_one_bit_of_a_reproduced_number_or_a_missing_run_fails(tmp_path):
    a = write(tmp_path / "a" / "reproduce", [{"key": "1f"}], NUMBERS)
    moved = {**NUMBERS, "F*": 641.4774346291565}
    code, out = same("--a", a, "--b", write(tmp_path / "b" / "reproduce", [{"key": "1f"}], moved))
    assert code == 1
    assert "/F*: 641.4774346291564 in A, 641.4774346291565 in B" in out
    assert same("--a", a, "--b", write(tmp_path / "c" / "quick", [ROW]))[0] == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "either a commit, or two folders"),
        (("--a", "x"), "either a commit, or two folders"),
        (("7bb5027", "--a", "x", "--b", "y"), "either a commit, or two folders"),
        (("no such commit",), "is no commit"),
        (("--a", "absent", "--b", "absent"), "absent is no folder"),
    ],
)
def test_bad_options_are_told_in_a_line(arguments, words):
    code, out = same(*arguments)
    assert code != 0
    assert words in out
    assert "Traceback" not in out
