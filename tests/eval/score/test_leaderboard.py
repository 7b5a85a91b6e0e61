"""Results are taken whole and true, and refused where one row, one count or one hash is not."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.scenario.scenario import HARDWARE
from push_recovery.eval.cli.main import main
from push_recovery.eval.output.rows import LOCK, Writer
from push_recovery.eval.rollout import DEFAULT_ENV
from push_recovery.eval.rollout.outcome import Ending, Outcome, Score
from push_recovery.eval.score import leaderboard
from push_recovery.eval.score.evaluate import evaluate
from push_recovery.eval.score.report import write_evaluation_reports
from push_recovery.eval.score.suites import Suite, get_suite, with_profile

SUITE = Suite("head", "1", get_suite("standard").scenarios[:12])


@pytest.fixture
def given(tmp_path):
    """A directory of results of two policies, and its suite as a file."""
    policies = [toy.save_policy(tmp_path / f"{gain}.safetensors", gain) for gain in (0.2, 8.0)]
    evaluation = evaluate(SUITE, toy.ENV_ID, policies, directory=tmp_path / "out")
    write_evaluation_reports(evaluation, evaluation)
    SUITE.save(tmp_path / "suite.json")
    return tmp_path / "out", str(tmp_path / "suite.json"), policies


def rows_in(out) -> list[dict]:
    return [json.loads(line) for line in (out / "outcomes.jsonl").read_text().splitlines()]


def write_rows(out, rows: list[dict]) -> None:
    (out / "outcomes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


def check(out, suite, size: int = 12) -> None:
    submission = leaderboard.read_submission(out, suite)
    leaderboard.run_again(submission, leaderboard.sample_of(submission, size, seed=1))


def test_true_results_are_taken_and_ranked(given, tmp_path, capsys):
    out, suite, (weak, strong) = given
    board = tmp_path / "board"
    argv = ["submit", str(out), "--suite", suite, "--board", str(board), "--workers", "1", "--sample", "5"]
    assert main([*argv, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told["files"]) == {weak, strong}
    for name, path in told["files"].items():
        entry = json.loads(Path(path).read_text())
        assert entry == told["entries"][name]
        assert f"board/{SUITE.sha256[:16]}/" in path
        assert entry["checked"] == 5
        assert entry["score"]["recovered"] == sum(r["recovered"] for r in rows_in(out) if r["policy"] == name)
    assert main(argv) == 0  # once more changes nothing
    assert len(leaderboard.read_board(board)) == 2
    page = (board / "README.md").read_text()
    assert page == leaderboard.board_page(leaderboard.read_board(board))
    assert page.index(strong) < page.index(weak)  # the better one first
    assert f"Suite SHA-256 `{SUITE.sha256}`" in page


def test_an_altered_row_that_is_sampled_is_refused(given):
    """It agrees with itself and with the report, so that only running it again tells."""
    out, suite, (weak, _) = given
    rows, true = rows_in(out), rows_in(out)
    row = next(r for r in true if r["policy"] == weak and not r["survived"])
    row |= {"survived": True, "recovered": True, "recovered_at": 3.0, "failure_reason": None}
    write_rows(out, true)
    (out / "report.json").unlink()
    leaderboard.read_submission(out, suite)
    with pytest.raises(InvalidValueError, match=f"{row['scenario_id']}.*recovered is True, again False"):
        check(out, suite)
    rows[3]["total_reward"] += 1e-12 * rows[3]["total_reward"]
    write_rows(out, rows)
    with pytest.raises(InvalidValueError, match="total_reward"):
        check(out, suite)


@pytest.mark.parametrize(
    "change",
    [
        {"survived": True}, {"impulse": 1.0}, {"psi_deg": 12.0}, {"command": [0.1, 0.0]}, {"pushes": 2},
        {"surprise": 1}, {"survived": 0, "failure_reason": "forward"}, {"limits_met": 3},
    ],
)  # fmt: skip
def test_a_row_that_contradicts_its_scenario_or_itself_is_refused_unrun(given, change):
    out, suite, (weak, _) = given
    rows = rows_in(out)
    row = next(r for r in rows if r["policy"] == weak and not r["survived"])
    row |= change
    write_rows(out, rows)
    with pytest.raises(InvalidValueError, match=row["scenario_id"]):
        leaderboard.read_submission(out, suite)


def test_rows_that_lack_or_come_twice(given):
    out, suite, (weak, _) = given
    rows = rows_in(out)
    *but_last, last = rows
    for changed, message in (
        (rows[1:], f"lacks 1 rows of '{weak}', such as '{rows[0]['scenario_id']}'"),
        ([*rows, rows[4]], "more than once"),
        ([*but_last, {**last, "policy_sha256": "0" * 64}], "several contents"),
        ([*but_last, {**last, "scenario_id": "other"}], "no row of suite 'head'"),
    ):
        write_rows(out, changed)
        with pytest.raises(InvalidValueError, match=message):
            leaderboard.read_submission(out, suite)


def test_a_report_with_other_counts_is_refused(given):
    out, suite, (weak, _) = given
    report = json.loads((out / "report.json").read_text())
    report["policies"][weak]["recovered"] += 1
    (out / "report.json").write_text(json.dumps(report))
    with pytest.raises(InvalidValueError, match="recovered"):
        leaderboard.read_submission(out, suite)


def test_results_of_something_else_are_refused(given, tmp_path):
    out, suite, (weak, _) = given
    content = (out / "config.json").read_text()
    for key, value in (("code", "0" * 64), ("env", "PushRecovery/Biped-v0")):
        (out / "config.json").write_text(json.dumps({**json.loads(content), key: value}))
        with pytest.raises(InvalidValueError):
            check(out, suite)
    (out / "config.json").write_text(content)
    Suite("head", "1", SUITE.scenarios[:11]).save(tmp_path / "other.json")
    with pytest.raises(InvalidValueError, match="another suite"):
        leaderboard.read_submission(out, str(tmp_path / "other.json"))
    with pytest.raises(InvalidValueError, match="not built in"):
        leaderboard.read_submission(out)  # no built-in suite of that name
    toy.save_policy(weak, 0.3)
    with pytest.raises(InvalidValueError, match="not the one of the rows"):
        check(out, suite)


def test_a_built_in_suite_is_found_with_its_profile():
    found = leaderboard._suite("quick+hardware", "1", None, DEFAULT_ENV)
    assert found == with_profile(get_suite("quick-1"), HARDWARE)
    assert leaderboard._suite("quick", "2", None, DEFAULT_ENV) == get_suite("quick")
    assert leaderboard._suite("hardware", "1", None, DEFAULT_ENV) == get_suite("hardware")


def test_samples_are_of_the_size_asked_for_and_new_each_time(given):
    submission = leaderboard.read_submission(given[0], given[1])
    assert [len(sample) for sample in leaderboard.sample_of(submission, 5).values()] == [5, 5]
    assert [len(sample) for sample in leaderboard.sample_of(submission, 99).values()] == [12, 12]
    assert leaderboard.sample_of(submission, 5, seed=3) == leaderboard.sample_of(submission, 5, seed=3)
    drawn = [next(iter(leaderboard.sample_of(submission, 5).values())) for _ in range(9)]
    assert len({tuple(scenario.id for scenario in sample) for sample in drawn}) > 1


def test_entries_of_other_code_stand_beside(given, tmp_path):
    out, suite, (weak, _) = given
    entry = leaderboard.entry_of(leaderboard.read_submission(out, suite), weak, 5)
    board = tmp_path / "board"
    first = leaderboard.add_entry(board, entry)
    second = leaderboard.add_entry(board, {**entry, "code": "1" * 64})
    assert first != second
    assert len(leaderboard.read_board(board)) == 2
    assert leaderboard.add_entry(board, {**entry, "checked": 12}) == first
    assert {entry["checked"] for entry in leaderboard.read_board(board)} == {12, 5}
    first.rename(first.with_name("0000.json"))
    with pytest.raises(InvalidValueError, match="belongs in"):
        leaderboard.read_board(board)


def test_an_entry_says_how_many_joints_a_policy_of_others_moves(given):
    """One that moves none itself has no such field, as those made before there were others."""
    out, suite, (weak, _) = given
    submission = leaderboard.read_submission(out, suite)
    entry = leaderboard.entry_of(submission, weak, 5)
    assert leaderboard.DRIVEN not in entry
    rows = [row | {"measures": {"driven_joints": 29}} for row in submission.rows[weak]]
    other = leaderboard.entry_of(replace(submission, rows={weak: rows}), weak, 5)
    assert other[leaderboard.DRIVEN] == "29"
    lines = leaderboard.board_page([entry, {**other, "policy": "other"}]).splitlines()
    cells = [[cell.strip() for cell in line.split("|")] for line in lines if line.startswith("| ")]
    place = cells[0].index("targets of")
    assert {row[1]: row[place] for row in cells[2:]} == {weak: "-", "other": "29"}


def test_what_is_no_directory_of_results(tmp_path, capsys):
    assert main(["submit", str(tmp_path / "none")]) == 2
    assert "config.json" in capsys.readouterr().err
    (tmp_path / "config.json").write_text('{"format": 1}')
    assert main(["submit", str(tmp_path)]) == 2
    assert "no results of evaluate" in capsys.readouterr().err


def test_a_second_writer_of_a_board_is_refused(given, tmp_path, capsys):
    out, suite, _ = given
    board = tmp_path / "board"
    with Writer(board):
        assert main(["submit", str(out), "--suite", suite, "--board", str(board), "--workers", "1"]) == 2
        assert [path.name for path in board.iterdir()] == [LOCK]
    assert "error: another run (process " in capsys.readouterr().err


def test_the_page_of_the_documentation_is_made_of_its_entries_and_an_empty_board_says_so(tmp_path):
    board = Path(__file__).parents[3] / "docs" / "leaderboard"
    assert (board / "README.md").read_text() == leaderboard.board_page(leaderboard.read_board(board))
    assert "No results yet" in leaderboard.board_page(leaderboard.read_board(tmp_path))


def test_a_file_that_is_handed_in_imports_no_module_of_others():
    with pytest.raises(InvalidValueError, match="is not built in"):
        leaderboard._suite("hard@mine", "1", None, "no_such_module:Mine-v0")


def test_a_row_without_the_hash_of_its_policy_is_none():
    scenario = get_suite("standard").scenarios[0]
    outcome = Outcome.of(scenario, "p", Ending(False, 7.0, 4.0, None, 1.0), 700)
    row = json.loads(json.dumps(outcome.to_dict()))
    assert leaderboard.checked_row({**row, "policy_sha256": None}, scenario)
    with pytest.raises(InvalidValueError, match="is no outcome"):
        leaderboard.checked_row(row, scenario)


@pytest.fixture
def true_row() -> dict:
    scenario = SUITE.scenarios[0]
    outcome = Outcome.of(scenario, "p", Ending(False, 7.0, 4.0, None, 1.0), 700)
    return json.loads(json.dumps({**outcome.to_dict(), "policy_sha256": None}))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"policy_sha256": []}, "policy_sha256 must be text, got []"),
        ({"recovered_at": 10**400},
         f"recovered_at must be finite, got 1{'0' * 199}... (401 characters): no float is so large"),
        ({"measures": {"heading_error": "x"}}, "measures.heading_error must be a number, got 'x'"),
        ({"end_time": "1"}, "end_time must be a number, got '1'"),
        ({"env_steps": -1}, "env_steps must be an integer >= 0, got -1"),
        ({"total_reward": "1"}, "total_reward must be a number, got '1'"),
        ({"survived": 1}, "survived must be true or false, got 1"),
    ],
)  # fmt: skip
def test_a_row_with_a_value_of_the_wrong_kind_is_no_outcome(true_row, change, said):
    scenario = SUITE.scenarios[0]
    with pytest.raises(InvalidValueError) as refused:
        leaderboard.checked_row(true_row | change, scenario)
    assert str(refused.value) == f"row '{scenario.id}' of 'p' is no outcome: {said}"


@pytest.mark.parametrize("name", [[], {}, None])
def test_a_row_without_the_name_of_a_scenario_is_of_no_suite(true_row, name, tmp_path):
    write_rows(tmp_path, [true_row | {"scenario_id": name}])
    with pytest.raises(InvalidValueError) as refused:
        leaderboard._rows(tmp_path / "outcomes.jsonl", SUITE)
    assert str(refused.value) == f"'{tmp_path}/outcomes.jsonl' line 1 is no row of suite 'head'"


@pytest.mark.parametrize(
    ("policies", "said"),
    [
        ({"p": [1]}, "policy 'p' of {} must be an object, got [1]"),
        ({"p": 5}, "policy 'p' of {} must be an object, got 5"),
        ([1], "policies of {} must be an object, got [1]"),
        (None, "policies of {} must be an object, got None"),
    ],
)
def test_a_report_whose_policies_are_no_objects_is_refused(true_row, policies, said, tmp_path):
    path = tmp_path / "report.json"
    path.write_text(json.dumps({"policies": policies}))
    with pytest.raises(InvalidValueError) as refused:
        leaderboard._check_report(path, {"p": [true_row]})
    assert str(refused.value) == said.format(repr(str(path)))


def test_a_value_of_any_length_is_cut_where_running_again_gives_another_one(true_row):
    with pytest.raises(InvalidValueError) as refused:
        leaderboard._compare(true_row | {"failure_reason": "x" * 9999}, true_row)
    assert str(refused.value) == (
        f"row '{SUITE.scenarios[0].id}' of 'p' is not what running it again gives: failure_reason is "
        f"'{'x' * 199}... (10001 characters), again None (1 fields differ); on another kind of machine last "
        "bits may differ"
    )


@pytest.fixture
def board(true_row, tmp_path):
    """A board with one true entry, and its file."""
    suite, score = SUITE.summary(), Score.of([true_row]).to_dict()
    named = {"env": toy.ENV_ID, "policy": "p", "policy_sha256": None, "code": "1" * 64}
    entry = {"suite": suite, **named, "rows_sha256": "2" * 64, "score": score, "checked": 1}
    return tmp_path / "board", leaderboard.add_entry(tmp_path / "board", entry)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"suite": 5}, "suite must be an object, got 5"), ({"suite": {"sha256": "5"}}, "suite lacks name"),
        ({"suite": {"name": "s", "sha256": 5}}, "suite.sha256 must be text, got 5"),
        ({"score": {}}, "score lacks recovered, survived, episodes, rate, ci95"),
        ({"score": None}, "score must be an object, got None"),
        ({"policy": ["p"]}, "policy must be text, got ['p']"),
        ({"checked": "x"}, "checked must be an integer >= 0, got 'x'"),
    ],
)  # fmt: skip
def test_a_file_of_a_board_that_is_no_entry_is_named_with_what_is_wrong(board, change, said):
    folder, path = board
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InvalidValueError) as refused:
        leaderboard.read_board(folder)
    assert str(refused.value) == f"'{path}' is no entry of a leaderboard: {said}"


def test_a_bad_file_of_a_board_is_found_before_rows_are_run_and_entries_written(
    given, board, capsys, monkeypatch
):
    out, suite, _ = given
    folder, path = board
    path.write_text("[]")
    before = {one: one.read_bytes() for one in folder.rglob("*") if one.is_file()}
    monkeypatch.setattr(leaderboard, "run_again", None)
    assert main(["submit", str(out), "--suite", suite, "--board", str(folder)]) == 2
    assert capsys.readouterr().err == (
        f"push-recovery: error: '{path}' is no entry of a leaderboard: it must be an object, got []\n"
    )
    assert {one: one.read_bytes() for one in folder.rglob("*") if one.is_file()} == before


def test_a_refused_submission_leaves_no_new_board(given, tmp_path, capsys):
    out, suite, (weak, _) = given
    toy.save_policy(weak, 0.3)
    assert main(["submit", str(out), "--suite", suite, "--board", str(tmp_path / "new" / "board")]) == 2
    assert "is not the one of the rows" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_what_results_name_is_imported_only_where_it_is_trusted(given, tmp_path, monkeypatch):
    out, suite, _ = given
    (tmp_path / "planted.py").write_text("open('ran', 'w').close()")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    config = json.loads((out / "config.json").read_text())
    refused = {  # the first one is the name of a file, in a folder maybe
        "planted:mine.robot.json": r"cannot read robot file 'planted:mine\.robot\.json'",
        "planted:PushRecovery/X-v0": r"runs the code of a module: .* submit takes --trust",
    }
    for env_id, words in refused.items():
        (out / "config.json").write_text(json.dumps(config | {"env": env_id}))
        with pytest.raises(InvalidValueError, match=words):
            leaderboard.read_submission(out, suite)
    assert not (tmp_path / "ran").exists()
    with pytest.raises(Exception, match=r"."):
        leaderboard.read_submission(out, suite, trust=True)
    assert (tmp_path / "ran").exists()


def test_a_policy_that_is_code_is_run_again_only_where_it_is_trusted(given, tmp_path, monkeypatch):
    out, suite, (weak, _) = given
    (tmp_path / "planted.py").write_text("open('ran', 'w').close()\nPolicy = None")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (out / "report.json").unlink()
    rows = [row | {"policy": "planted:Policy"} for row in rows_in(out) if row["policy"] == weak]
    write_rows(out, rows)
    with pytest.raises(InvalidValueError, match=r"is code of a module: .* submit takes --trust"):
        check(out, suite)
    assert not (tmp_path / "ran").exists()


def test_a_suite_file_is_found_with_its_profile(tmp_path):
    SUITE.save(tmp_path / "suite.json")
    path = str(tmp_path / "suite.json")
    assert leaderboard._suite("head+hardware", "1", path, DEFAULT_ENV) == with_profile(SUITE, HARDWARE)
    assert leaderboard._suite("head", "1", path, DEFAULT_ENV) == SUITE
