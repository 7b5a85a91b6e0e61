"""Who recovers more, on rows whose 2 x 2 tables are known."""

import pytest
from push_recovery.eval.output.statistics import PairedCounts
from push_recovery.eval.report.headline import p_words, points, ranked, rate_cells, sureness, verdict

LABELS = {"p": "P", "q": "Q", "t": "T"}


def test_the_leader_is_the_one_that_recovers_most(evaluation):
    found = evaluation({"p": "rrffffff", "q": "rrrrrrrs", "t": "fffrrrff"})
    assert ranked(found) == ["q", "t", "p"]
    said = verdict(found, LABELS)
    # only Q 4, only T 0: p = 2 / 2^4
    assert said.startswith("Q recovers from 7 of 8 pushes (87.5 %), 4 more than T: too few to say")
    assert "+50.0 points" in said
    assert "p = 0.12" in said


def test_a_lead_that_is_sure():
    # 12 : 0 and 9 : 1, p = 2 / 2^12 and 2 (1 + 10) / 2^10
    assert sureness(PairedCounts(20, 12, 0, 5)).startswith("a lead that chance hardly makes")
    assert sureness(PairedCounts(20, 9, 1, 5)).startswith("a lead that chance is unlikely to make")
    assert "p = 0.021" in sureness(PairedCounts(20, 9, 1, 5))


def test_one_policy_and_equal_policies(evaluation):
    # Wilson (1927) of 2 of 4, z = 1.96
    assert verdict(evaluation({"p": "rrff"}), LABELS) == (
        "P recovers from 2 of 4 pushes (50.0 %); 95 % interval 15.0 to 85.0 %."
    )
    equal = evaluation({"p": "rrff", "q": "ffrr"})
    assert verdict(equal, LABELS) == "P and Q recover from equally many pushes, 2 of 4 pushes (50.0 %)."


def test_recovered_and_survived_have_their_own_cells(evaluation):
    (cells,) = rate_cells(evaluation({"p": "rssf"}), LABELS)
    assert cells[0] == "P"
    assert cells[1] == "25.0 % (1)"
    assert cells[3] == "75.0 % (3)"
    assert cells[2] == "4.6 to 69.9 %"  # Wilson of 1 of 4
    assert cells[4] == "30.1 to 95.4 %"  # of 3 of 4, its mirror image


@pytest.mark.parametrize(
    ("p", "words"), [(0.0123, "p = 0.012"), (1.0, "p = 1"), (3e-7, "p < 0.0001"), (2e-4, "p = 0.0002")]
)
def test_p_in_words(p, words):
    assert p_words(p) == words


def test_points_have_signs():
    assert points(0.0314) == "+3.1"
    assert points(-0.0314) == "\N{MINUS SIGN}3.1"
