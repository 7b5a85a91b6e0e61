"""Who recovers more, pairs, and training seeds, on rows whose 2 x 2 tables are known."""

import re

import numpy as np
import pytest
from push_recovery.eval.output.statistics import PairedCounts
from push_recovery.eval.report import headline, page
from push_recovery.eval.report.evaluation import SIGNS, scenario_lines
from push_recovery.eval.report.page import Command, outcome_words, scenario_words, short_labels
from push_recovery.eval.score.report import p_words, pairs_table, points, ranked
from push_recovery.eval.score.suites import get_suite
from scipy import stats


def test_the_leader_is_the_one_that_recovers_most(evaluation):
    found = evaluation({"p": "rrffffff", "q": "rrrrrrrs", "t": "fffrrrff"})
    assert ranked(found) == ["q", "t", "p"]
    said = headline.verdict(found)
    # only q 4, only t 0: p = 2 / 2^4
    assert said.startswith("q recovers from 7 of 8 pushes (87.5 %), 4 more than t: too few to say")
    assert all(words in said for words in ("+50.0 points", "p = 0.12"))


def test_the_best_learned_policy_is_held_against_the_best_planner(evaluation):
    found = evaluation({"net": "rrrrrr", "net-seed1": "rrrrrf", "plan": "rrrfff", "other": "rrffff"})
    assert headline.rival(found) == "plan"  # of another recipe
    for name in ("net", "net-seed1", "other"):
        for row in found.rows[name]:
            row["policy_sha256"] = "1"
    assert headline.rival(found) == "plan"  # without weights
    assert headline.verdict(found).startswith("net recovers from 6 of 6 pushes (100.0 %), 3 more than plan:")
    for row in found.rows["plan"]:
        row["policy_sha256"] = "2"
    assert headline.rival(found) == "plan"
    assert headline.rival(evaluation({"net": "rr", "net-seed1": "rf"})) == "net-seed1"
    assert headline.rival(evaluation({"net": "rr"})) is None


def test_a_lead_that_is_sure():
    # 12 : 0 and 9 : 1, p = 2 / 2^12 and 2 (1 + 10) / 2^10
    assert headline.sureness(PairedCounts(20, 12, 0, 5)).startswith("a lead that chance hardly makes")
    assert headline.sureness(PairedCounts(20, 9, 1, 5)).startswith("a lead that chance is unlikely to make")
    assert "p = 0.021" in headline.sureness(PairedCounts(20, 9, 1, 5))


def test_one_policy_and_equal_policies(evaluation):
    # Wilson (1927) of 2 of 4, z = 1.96
    assert headline.verdict(evaluation({"p": "rrff"})) == (
        "p recovers from 2 of 4 pushes (50.0 %); 95 % interval 15.0 to 85.0 %."
    )
    equal = evaluation({"p": "rrff", "q": "ffrr"})
    assert headline.verdict(equal) == "p and q recover from equally many pushes, 2 of 4 pushes (50.0 %)."


def test_recovered_and_survived_have_their_own_cells(evaluation):
    (cells,) = headline.rates_table(evaluation({"p": "rssf"})).rows
    # Wilson of 1 of 4, and of 3 of 4, its mirror image
    assert cells == ("p", "25.0 % (1)", "4.6-69.9", "75.0 % (3)", "30.1-95.4", "-", "0")


@pytest.mark.parametrize(
    ("p", "words"), [(0.0123, "p = 0.012"), (1.0, "p = 1"), (3e-7, "p < 0.0001"), (2e-4, "p = 0.0002")]
)
def test_p_in_words_and_points_with_signs(p, words):
    assert p_words(p) == words
    assert (points(0.0314), points(-0.0314)) == ("+3.1", "\N{MINUS SIGN}3.1")


COMMAND = Command(("evaluate",), (("--suite", ("quick",)),))


def test_every_pair_has_its_counts_the_better_one_first(evaluation):
    cells = pairs_table(evaluation({"p": "rrffff", "q": "rfrrrr", "t": "ffffff"})).rows
    assert [cell[:5] for cell in cells] == [
        ("q and p", "1", "4", "1", "0"), ("q and t", "0", "5", "0", "1"), ("p and t", "0", "2", "0", "4"),
    ]  # fmt: skip
    assert cells[0][5].startswith("+50.0 (")
    # 2 (1 + 5) / 2^5, 2 / 2^5 and 2 / 2^2; Holm: three times the least, the others twice and once at least
    assert [cell[6] for cell in cells] == ["0.38", "0.062", "0.5"]
    assert [cell[7] for cell in cells] == ["0.75", "0.19", "0.75"]
    assert not pairs_table(evaluation({"p": "rrffff"}))


def test_the_best_is_told_apart_from_each_other_one(evaluation):
    found = evaluation({"p": "rrfsff", "q": "rfrrff"})
    (pair,) = headline.pairs_with_best(found, "hardware", COMMAND)
    assert (pair.a, pair.b) == ("q", "p")
    assert {one.scenario_id for one in pair.only_a} == {"quick-0002", "quick-0003"}
    assert [one.scenario_id for one in pair.only_b] == ["quick-0001"]
    assert [one.impulse for one in pair.only_a] == sorted(one.impulse for one in pair.only_a)
    by_id = {one.scenario_id: one for one in pair.only_a}
    assert by_id["quick-0003"].loser == "stays up, does not settle"
    assert by_id["quick-0002"].loser == "falls 3.2 s into the walk (sank too low, first limit met: CoP)"
    assert by_id["quick-0002"].commands[1] == (
        "push-recovery play --suite quick --profile hardware --scenario quick-0002 --policy p "
        "--out quick-0002-p.png"
    )
    assert headline.pairs_with_best(evaluation({"p": "rf"}), "exact", COMMAND) == []


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
        f"falls 3.2 s into the walk (sank too low, first limit met: CoP); {effort}",
    ]
    for rows in found.rows.values():
        for row in rows:
            row["measures"]["smallest_margin"] = None
    assert scenario_lines(found, {})[0].signs[0][1] == ""


def test_a_scenario_in_words():
    scenario = next(s for s in get_suite("quick").scenarios if len(s.pushes) == 2 and s.command.turn)
    push, words = scenario.pushes[0], scenario_words(scenario)
    assert words.startswith(f"{push.body}, {push.impulse_magnitude:.0f} N s ")
    assert words.endswith(f" within {push.duration:.2f} s, double, turning")
    assert outcome_words(
        {"recovered": False, "survived": False, "failure_reason": "low", "end_time": 1.0}
    ) == ("falls 1.0 s into the walk (low)")
    fell = {"recovered": False, "survived": False, "failure_reason": "pelvis_tilt", "end_time": 3.25}
    pushed = {**fell, "measures": {"first_push": 2.0}}
    assert outcome_words(pushed) == "falls 1.2 s after the first push (tipped over)"
    before = {**fell, "measures": {"first_push": None}}
    assert outcome_words(before) == "falls 3.2 s into the walk (tipped over)"


def test_files_are_told_by_folder_and_stem_where_that_tells_them_apart():
    names = ["two-stage", "runs/a/policy.safetensors", "x/a/policy.safetensors", "runs/b/policy.safetensors"]
    assert short_labels(names) == {
        "two-stage": "two-stage", names[1]: names[1], names[2]: names[2], names[3]: "b/policy"
    }  # fmt: skip


LETTERS = "rrfsrrrfrrsf" * 8  # 96 pushes


def shifted(by: int) -> str:
    return LETTERS[by:] + LETTERS[:by]


def test_a_recipe_is_what_differs_by_its_seed_alone():
    files = ["residual-Biped-v0-seed12/policy", "residual-Biped-v0-seed3/policy"]
    assert headline.recipes_of(["residual", "residual-seed1", "two-stage", "residual-hardware", *files]) == {
        "residual": ["residual", "residual-seed1"],
        "two-stage": ["two-stage"],
        "residual-hardware": ["residual-hardware"],
        "residual-Biped-v0/policy": files,
    }


def test_strata_are_directions_and_quarters_of_the_impulses():
    rows = [{"impulse": float(k), "psi_deg": 45.0 * (k // 4)} for k in range(32)]
    quarters = [k * 4 // 32 for k in range(32)]
    pairs = [(k // 4, quarters[k]) for k in range(32)]
    strata = headline.strata_of(rows)
    assert sorted(set(strata.tolist())) == list(range(len(set(pairs))))
    assert all((strata[i] == strata[j]) == (pairs[i] == pairs[j]) for i in range(32) for j in range(32))
    assert (
        len(set(headline.strata_of([{"impulse": 1.0, "psi_deg": None}] * 8).tolist())) == 4
    )  # of kicks: quarters


def test_the_tables_hold_the_numbers_of_their_definitions(evaluation):
    words = {"residual": LETTERS, "residual-seed1": shifted(5), "two-stage": shifted(1).replace("r", "s", 20)}
    found = evaluation(words)
    part = headline.seed_part(found)
    assert part is not None
    assert headline.seed_part(evaluation({"residual": LETTERS, "two-stage": LETTERS})) is None
    strata = headline.strata_of(found.rows["two-stage"])
    assert part.strata == len(set(strata.tolist()))
    rates = {
        name: np.array([
            np.mean([word[i] == "r" for i in np.flatnonzero(strata == k)]) for k in range(part.strata)
        ]) for name, word in words.items()
    }  # fmt: skip
    (row,) = part.recipes.rows
    counts = [word.count("r") for name, word in words.items() if name != "two-stage"]
    assert row[:3] == ("residual", "2", f"{np.mean(counts):.1f} ({min(counts)} to {max(counts)})")
    middle, low, high = numbers(row[3])
    both = np.array([rates["residual"], rates["residual-seed1"]])
    assert middle == pytest.approx(100.0 * stats.trim_mean(both.ravel(), 0.25), abs=0.05)
    assert low <= middle <= high
    ((name, other, said),) = part.against.rows
    assert (name, other) == ("residual", "two-stage")
    u = [stats.mannwhitneyu(both[:, k], [rates["two-stage"][k]]).statistic / 2 for k in range(part.strata)]
    assert numbers(said)[0] == pytest.approx(100.0 * np.mean(u), abs=0.5)


def test_the_profile_falls_where_fewer_strata_are_recovered():
    """Every stratum of one policy is at a half, of the other at nothing or all."""
    strata = np.repeat([0, 1], 4)
    svg = headline.profile_figure(
        {"even": np.tile([1.0, 0.0], 4)[None], "uneven": np.repeat([1.0, 0.0], 4)[None]}, strata
    )
    assert "even" in svg
    assert "uneven" in svg


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"[\d.]+", text)]


def test_quarters_are_ranks_of_the_impulses_in_any_order_of_pushes():
    rows = [{"impulse": impulse, "psi_deg": 0.0} for impulse in (3.0, 1.0, 4.0, 2.0)]
    assert headline.strata_of(rows).tolist() == [2, 0, 3, 1]


def test_a_page_of_two_long_names_has_a_name_that_a_file_can_have(tmp_path):
    assert Command(("compare", "a", "b")).page(tmp_path) == "compare-a-b.html"
    long = Command(("compare", "a" * 120, "b" * 120)).page(tmp_path)
    other = Command(("compare", "a" * 120, "c" * 120)).page(tmp_path)
    assert len(long) < 40
    assert long != other


def test_marks_of_the_rates_are_survived_and_recovered_with_its_interval(evaluation, monkeypatch):
    """Wilson of 1 of 4 is 4.6 to 69.9 %."""
    monkeypatch.setattr(page, "to_svg", lambda figure, words: figure)
    (axes,) = headline.rate_figure({"exact": evaluation({"p": "rssf", "q": "rrrr"})}).axes
    assert [line.get_xdata().tolist() for line in axes.lines[:2]] == [[75.0, 100.0], [25.0, 100.0]]
    assert axes.collections[0].get_segments()[0][:, 0] == pytest.approx([4.6, 69.9], abs=0.05)


def test_a_profile_is_how_many_strata_lie_above(monkeypatch):
    monkeypatch.setattr(page, "to_svg", lambda figure, words: figure)
    scores = {"even": np.tile([1.0, 0.0], 4)[None], "uneven": np.repeat([1.0, 0.0], 4)[None]}
    (axes,) = headline.profile_figure(scores, np.repeat([0, 1], 4)).axes
    for line, shares in zip(axes.lines, ((100.0, 0.0), (50.0, 50.0)), strict=True):
        assert np.interp([47.0, 51.0], line.get_xdata(), line.get_ydata()) == pytest.approx(shares)


def test_a_lead_is_told_with_newcombes_interval_low_end_first():
    """Newcombe (1998): 0.0569 to 0.3404; p = 2 (1 + 14 + 91) / 2^14."""
    assert headline.sureness(PairedCounts(36, 12, 2, 0)) == (
        "a lead that chance is unlikely to make "
        "(+20.0 points, 95 % interval +5.7 to +34.0; exact McNemar p = 0.013)"
    )


def test_a_p_above_a_twentieth_is_too_few():
    """9 : 2 is 2 (1 + 11 + 55) / 2^11 = 0.065."""
    assert headline.sureness(PairedCounts(20, 9, 2, 5)).startswith("too few to say that it is better")


def test_a_p_above_a_thousandth_is_only_unlikely():
    """11 : 1 is 2 (1 + 12) / 2^12 = 0.0063."""
    words = headline.sureness(PairedCounts(20, 11, 1, 5))
    assert words.startswith("a lead that chance is unlikely to make")


def test_the_interval_of_an_improvement_is_of_the_same_side(monkeypatch):
    """Every seed of the one recovers all, of the other nothing, under any draw."""
    monkeypatch.setattr(headline, "DRAWS", 50)
    strata = np.repeat([0, 1], 4)
    assert headline._improvement(np.ones((3, 8)), np.zeros((2, 8)), strata) == "100 % (100 to 100)"


def test_pushes_of_an_improvement_are_drawn_within_their_strata(monkeypatch):
    """One wins all of the first stratum, the other all of the second: a half under any draw within them."""
    monkeypatch.setattr(headline, "DRAWS", 50)
    a, strata = np.tile(np.repeat([1.0, 0.0], 4), (2, 1)), np.repeat([0, 1], 4)
    assert headline._improvement(a, 1.0 - a, strata) == "50 % (50 to 50)"


def test_pushes_of_an_interquartile_mean_are_drawn_within_their_strata(monkeypatch):
    """Rates of the strata are 1 and 0 of both seeds under any draw within them; their mean is a half."""
    monkeypatch.setattr(headline, "DRAWS", 200)
    scores = np.tile(np.repeat([1.0, 0.0], 4), (2, 1))
    cells = headline._cells(scores, np.repeat([0, 1], 4))
    assert cells == ("2", "4.0 (4 to 4)", "50.0 % (50.0 to 50.0)")
