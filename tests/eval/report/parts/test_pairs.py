"""Pairs and the pushes that set them apart, on rows whose tables are known."""

from push_recovery.eval.report.episodes import SIGNS, scenario_lines
from push_recovery.eval.report.headline import pair_cells, pairs_with_best
from push_recovery.eval.report.page import Command, outcome_words, scenario_words, short_labels
from push_recovery.eval.score.suites import quick_suite

LABELS = {"p": "P", "q": "Q", "t": "T"}
COMMAND = Command(("evaluate",), (("--suite", ("quick",)),))


def test_every_pair_has_its_counts_the_better_one_first(evaluation):
    cells = pair_cells(evaluation({"p": "rrffff", "q": "rfrrrr", "t": "ffffff"}), LABELS)
    assert [cell[:5] for cell in cells] == [
        ("Q and P", "1", "4", "1", "0"), ("Q and T", "0", "5", "0", "1"), ("P and T", "0", "2", "0", "4"),
    ]  # fmt: skip
    assert cells[0][5].startswith("+50.0 (")
    # 2 (1 + 5) / 2^5, 2 / 2^5 and 2 / 2^2; Holm: three times the least, the others twice and once at least
    assert [cell[6] for cell in cells] == ["0.38", "0.062", "0.5"]
    assert [cell[7] for cell in cells] == ["0.75", "0.19", "0.75"]


def test_the_best_is_told_apart_from_each_other_one(evaluation):
    found = evaluation({"p": "rrfsff", "q": "rfrrff"})
    (pair,) = pairs_with_best(found, LABELS, "hardware", COMMAND)
    assert (pair.a, pair.b) == ("Q", "P")
    assert {one.scenario_id for one in pair.only_a} == {"quick-0002", "quick-0003"}
    assert [one.scenario_id for one in pair.only_b] == ["quick-0001"]
    assert [one.impulse for one in pair.only_a] == sorted(one.impulse for one in pair.only_a)
    by_id = {one.scenario_id: one for one in pair.only_a}
    assert by_id["quick-0003"].loser == "stays up, does not settle"
    assert by_id["quick-0002"].loser == "falls at 3.2 s (com_height, first cop)"
    assert by_id["quick-0002"].commands[1] == (
        "push-recovery play --suite quick --profile hardware --scenario quick-0002 --policy p "
        "--out quick-0002-p.png"
    )
    assert pairs_with_best(evaluation({"p": "rf"}), LABELS, "exact", COMMAND) == []


def test_a_line_for_every_push(evaluation):
    found = evaluation({"p": "rsf", "q": "rrf"})
    lines = scenario_lines(found, {found.suite.scenarios[1].id: 0.824})
    assert [line.kind for line in lines] == ["all", "some", "none"]
    assert [line.signs[0][0] for line in lines] == [SIGNS["recovered"], SIGNS["survived"], SIGNS["fell"]]
    assert [line.share for line in lines] == ["", "0.82", ""]
    effort = "margin 25 cm, lean 29 deg, 7.9 kJ"
    assert [line.signs[0][1] for line in lines] == [
        effort,
        f"stays up, does not settle; {effort}",
        f"falls at 3.2 s (com_height, first cop); {effort}",
    ]
    for rows in found.rows.values():
        for row in rows:
            row["measures"]["smallest_margin"] = None
    assert scenario_lines(found, {})[0].signs[0][1] == ""


def test_a_scenario_in_words():
    scenario = next(s for s in quick_suite().scenarios if len(s.pushes) == 2 and s.command.turn)
    push, words = scenario.pushes[0], scenario_words(scenario)
    assert words.startswith(f"{push.body}, {push.impulse_magnitude:.0f} N s ")
    assert words.endswith(f" within {push.duration:.2f} s, double, turning")
    assert outcome_words(
        {"recovered": False, "survived": False, "failure_reason": "low", "end_time": 1.0}
    ) == ("falls at 1.0 s (low)")


def test_files_are_told_by_folder_and_stem_where_that_tells_them_apart():
    names = ["two-stage", "runs/a/policy.safetensors", "x/a/policy.safetensors", "runs/b/policy.safetensors"]
    assert short_labels(names) == {
        "two-stage": "two-stage", names[1]: names[1], names[2]: names[2], names[3]: "b/policy"
    }  # fmt: skip
