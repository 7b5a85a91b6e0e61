"""Hindsight search over a suite: what is searched, what is kept, and what stands in the report."""

import json
import shutil
from dataclasses import asdict, replace

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval import ceiling as stored
from push_recovery.eval.ceiling import ceiling
from push_recovery.eval.cli.main import main
from push_recovery.eval.hindsight import CEILING, CeilingSettings, Sequence
from push_recovery.eval.output.progress import about, episode_seconds
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score.evaluate import Evaluation, evaluate
from push_recovery.eval.score.suites import Suite

ENV = "PushRecovery/Biped-v0"
EVENT = GaitEvent(1, "right", 0.3)
SUITE = Suite("mixed", "1", (
    Scenario("light-0", (polar_push(100.0, 0.0, 0.1, EVENT),), settle_time=2.0),
    Scenario("hopeless", (polar_push(6000.0, 2.0, 0.1, 0.2),)),
    Scenario("light-1", (polar_push(120.0, 2.0, 0.1, EVENT),), stance_side="right", settle_time=2.0),
))  # fmt: skip
SETTINGS = CeilingSettings(population=3, generations=2, elites=2)
FALLS = "passive"  # without a push, so that all pushes are searched


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> stored.Ceiling:
    return ceiling(SUITE, ENV, FALLS, SETTINGS, directory=tmp_path_factory.mktemp("one"))


def evaluated(found, directory):
    """A directory in which the policies have been scored, and nothing is searched."""
    for name in ("config.json", "outcomes.jsonl"):
        shutil.copy(found.evaluation.directory / name, directory)
    return directory


def rows_in(directory) -> list[str]:
    return sorted((directory / CEILING / "outcomes.jsonl").read_text().splitlines())


def test_what_all_policies_lose_and_nothing_else_is_searched_and_counts_where_it_is_answered(found):
    assert [row["scenario_id"] for row in found.searched] == ["light-0", "hopeless", "light-1"]
    assert [row["recovered"] for row in found.rows[CEILING]] == [True, False, True]
    told = found.to_dict()
    assert (told["policies"][CEILING]["recovered"], told["search"]["answered"]) == (2, 2)
    assert told["search"]["attempts"] == 3 + 6 + 3  # light ones are answered by the first generation
    assert found.score.recovered == 2
    both = ceiling(SUITE, ENV, [FALLS, "two-stage"], SETTINGS, directory=found.evaluation.directory)
    assert [row["scenario_id"] for row in both.searched] == ["hopeless"]
    assert both.score.recovered == 2
    assert both.rows[CEILING][0]["policy"] == "two-stage"


def test_rows_are_the_same_on_two_processes(found, tmp_path):
    stored.ceiling(SUITE, ENV, FALLS, SETTINGS, workers=2, directory=evaluated(found, tmp_path))
    assert rows_in(tmp_path) == rows_in(found.evaluation.directory)


def test_a_run_that_was_stopped_goes_on_to_the_same_rows(found, tmp_path, interrupted):
    interrupted(1, ceiling, SUITE, ENV, FALLS, SETTINGS, 1, evaluated(found, tmp_path))
    (kept,) = rows_in(tmp_path)
    (tmp_path / CEILING / "outcomes.jsonl").write_text(kept + '\n{"scenario_id": "hopel')  # torn by a kill
    ceiling(SUITE, ENV, FALLS, SETTINGS, directory=tmp_path)
    assert kept in rows_in(tmp_path)
    assert rows_in(tmp_path) == rows_in(found.evaluation.directory)


def test_it_says_what_is_searched_at_what_cost_and_counts_the_answers(found, tmp_path, monkeypatch, capsys):
    """Only what the directory lacks is searched for, and counts as work; what is there counts as done."""
    asked = []

    def known(env_id, task, jobs, workers):
        asked.append((env_id, [scenario.id for _, scenario in jobs], {settings for settings, _ in jobs}))
        return (row for row in found.searched if row["scenario_id"] in asked[-1][1])

    monkeypatch.setattr(stored, "parallel", known)
    directory = evaluated(found, tmp_path)
    for ids in (["light-0", "hopeless", "light-1"], []):
        again = ceiling(SUITE, ENV, FALLS, SETTINGS, 2, directory)
        assert again.searched == found.searched
        assert asked[-1] == (ENV, ids, {SETTINGS} if ids else set())
        lines = capsys.readouterr().err.splitlines()
        said = [line for line in lines if "attempts" in line or "/3 in" in line]
        seconds = 6 * episode_seconds(ENV, SUITE.scenarios, 2)
        how_long = f"{about(seconds)} at most" if ids else "nothing is left to run"
        pushes = "up to 6 attempts at each of the 3 pushes that all policies lose"
        assert said[-2] == f"{pushes}: {how_long}; output in {directory / CEILING}"
        assert said[-1] == "3/3 in 0:00:00" + (" (ceiling answered 2)" if ids else "")
    assert rows_in(directory) == rows_in(found.evaluation.directory)


def test_stored_answers_replay_in_an_ordinary_evaluation_to_the_same_rows(found, tmp_path):
    policy = stored.load_answers(found.directory, make_env(ENV))
    again = evaluate(SUITE, ENV, {CEILING: policy}, directory=tmp_path)
    for row, searched in zip(again.rows[CEILING], found.searched, strict=True):
        del row["policy_sha256"]
        assert {name: searched[name] for name in row} == row


def test_a_directory_without_searches_or_with_those_of_other_settings_is_refused(found, tmp_path):
    with pytest.raises(InvalidValueError, match=r"another configuration \(differs in: ceiling\)"):
        ceiling(SUITE, ENV, FALLS, CeilingSettings(seed=1), directory=found.evaluation.directory)
    for place in (tmp_path, found.evaluation.directory):
        with pytest.raises(InvalidValueError, match="holds no searches"):
            stored.load_answers(place, make_env(ENV))


def test_answers_go_through_a_file(found, tmp_path):
    path = tmp_path / "answers.json"
    answers = stored.Answers.of(found)
    answers.save(path)
    assert stored.Answers.load(path) == answers
    assert list(answers.sequences) == ["light-0", "light-1"]
    assert stored.load_answers(path, make_env(ENV)).sequences == answers.sequences
    faults = (
        ('"format": 1', '"format": 7', "has format 7"),
        ('"light-0": [', '"l": [3, [1.0]], "x": [', "rows of 7 numbers"),
        ('"seed": 0', '"sed": 0', "lacks seed"),
        ('"sha256"', '"sha"', "lacks sha256"),
    )
    for good, bad, message in faults:
        (tmp_path / "bad.json").write_text(path.read_text().replace(good, bad))
        with pytest.raises(InvalidValueError, match=message):
            stored.Answers.load(tmp_path / "bad.json")


def test_a_report_of_a_suite_with_stored_answers_has_the_ceiling(found, tmp_path, monkeypatch, capsys):
    """Only what the answers recover today counts, and only for just these pushes."""
    monkeypatch.setattr(stored, "STORED", tmp_path)
    suite = tmp_path / "suite.json"
    SUITE.save(suite)
    words = ["evaluate", "--suite", str(suite), "--policies", FALLS, "--workers", "1", "--json", "--out"]
    there = str(evaluated(found, tmp_path))
    assert main([*words, there]) == 0
    assert "ceiling" not in json.loads(capsys.readouterr().out)
    answers = stored.Answers.of(found)
    answers.save(tmp_path / "mixed.json")
    assert main([*words, there]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["ceiling"]["recovered"] == 2
    assert list(told["policies"]) == [FALLS]
    assert "| ceiling | 2/3 |" in (tmp_path / "report.md").read_text()
    replace(answers, suite={**answers.suite, "sha256": "0"}).save(tmp_path / "mixed.json")
    assert stored.stored_answers(SUITE) is None


def hand_written() -> stored.Ceiling:
    """Four pushes: a recovers 0, b 0 and 1 (and survives 2), a search answers 2 and none 3."""

    def row(name, recovered, survived=False, **more):
        stands = survived or recovered
        reason = None if stands else "com_height"
        told = {"scenario_id": name, "recovered": recovered, "survived": stands, "failure_reason": reason}
        return {**told, "impulse": 1.0, **more}

    names = ["s0", "s1", "s2", "s3"]
    suite = Suite("hand", "1", tuple(Scenario(name) for name in names))
    a = [row(name, name == "s0") for name in names]
    b = [row("s0", True), row("s1", True), row("s2", False, True), row("s3", False)]
    searched = [row("s2", True, attempts=64, neighbours=18), row("s3", False, attempts=1280, neighbours=None)]
    return stored.Ceiling(
        Evaluation(suite, ENV, {"a": a, "b": b}, None, 0.0), CeilingSettings(), searched, None
    )  # type: ignore[arg-type]


def test_the_ceiling_is_what_policies_and_searches_recover_together():
    found = hand_written()
    assert [row["recovered"] for row in found.rows[CEILING]] == [True, True, True, False]
    rates, shares = stored.ceiling_table(found).rows, stored.shares_table(found).rows
    assert [cells[:2] for cells in rates] == [("a", "1/4"), ("b", "2/4"), ("ceiling", "3/4")]
    assert list(shares) == [("a", "1", "0.333", "2", "0.5"), ("b", "2", "0.667", "1", "1")]  # p = 2^(1 - n)
    assert found.robust == [0.75]
    text = stored.search_lines(found)
    for part in ("2 pushes lost by all policies, 1 of them answered", "at most 1280 attempts", "Median 64",
                 "recovers 75% of the 24 pushes within 2% of the force and 2 degrees"):  # fmt: skip
        assert part in text


def test_where_nothing_recovers_the_best_is_what_survives_and_otherwise_the_last():
    found = hand_written()
    a, b = found.evaluation.rows.values()
    unanswered = stored.best_rows(replace(found.evaluation, rows={"b": b, "a": a}), [])
    assert unanswered[0] is b[0]
    assert unanswered[2] is b[2]
    assert unanswered[3] is a[3]


def test_an_answer_to_half_of_the_neighbours_counts_among_those_to_half_or_more():
    found = hand_written()
    found.searched[0]["neighbours"] = 12
    assert "1 of 1 answers recover half of them or more" in stored.search_lines(found)


def test_answers_are_replayed_once_and_on_the_environment_that_they_were_found_in(monkeypatch):
    found = hand_written()
    for name, evaluation in (
        ("other", found.evaluation),  # an answer to none of its pushes
        ("s0", replace(found.evaluation, rows=found.rows)),
        ("s0", replace(found.evaluation, env_id="PushRecovery/Pendulum-v0")),
    ):
        answers = stored.Answers({}, found.settings, {name: Sequence(0, [[0.0] * 7])})
        monkeypatch.setattr(stored, "stored_answers", lambda suite, answers=answers: answers)
        assert stored.with_ceiling(evaluation) is evaluation


def test_the_report_and_the_command_tell_the_same(found, tmp_path, capsys):
    suite = tmp_path / "suite.json"
    SUITE.save(suite)
    words = ["ceiling", "--suite", str(suite), "--policies", FALLS, "--population", "3", "--generations", "2",
             "--elites", "2", "--workers", "1"]  # fmt: skip
    assert main([*words, "--out", str(found.evaluation.directory), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads(json.dumps(found.to_dict()))
    assert json.loads((found.directory / "report.json").read_text()) == told
    assert "| ceiling | 2/3 |" in stored.write_ceiling_reports(found).read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--env", "PushRecovery/Pendulum-v0"], "searched for on bipeds"),
        (["--env", "PushRecovery/BipedResidual-v0"], "needs plain gait actions"),
        (["--planner", "two-stag"], "did you mean 'two-stage'"),
        (["--planner", "random"], "unknown policy 'random'"),
        (["--elites", "65"], "elites must be at most the population 64, got 65"),
        (["--sample", "2000"], r"sample must be an integer in [1, 1024], got 2000"),
    ],
)
def test_bad_input_is_one_line(words, message, capsys):
    assert main(["ceiling", *words]) == 2
    assert message in capsys.readouterr().err


def test_means_and_medians_are_told_apart_and_pushes_that_never_come_are_left_out(tmp_path):
    """42 of 72 neighbours recover; in the median 18 of 24."""
    found = hand_written()
    found.searched[:] = [
        {"recovered": True, "attempts": a, "neighbours": n} for a, n in ((64, 24), (128, 18), (1280, 0))
    ]
    text = stored.search_lines(found)
    for part in ("Median 128", "recovers 58%", "75% in the median", "2 of 3 answers"):
        assert part in text
    config = {"format": 1, "ceiling": asdict(SETTINGS), "suite": {"name": "h"}}
    (tmp_path / "config.json").write_text(json.dumps(config))
    base = dict.fromkeys(stored.FIELDS)
    rows = [
        {**base, "scenario_id": "a", "period": 3, "corrections": [[0.0] * 7]},
        {**base, "scenario_id": "b"},
    ]
    (tmp_path / "outcomes.jsonl").write_text("".join(json.dumps(one) + "\n" for one in rows))
    assert list(stored.Answers.of_searches(tmp_path).sequences) == ["a"]


def test_a_ceiling_says_how_much_was_searched():
    found = hand_written().to_dict()["search"]
    names = "searched", "answered", "attempts", "budget", "neighbours", "neighbours_recovered"
    assert [found[name] for name in names] == [2, 1, 1344, 1280, 24, [0.75]]
