"""What counts as recovered and why an episode does not, on rows written by hand."""

import pytest
from push_recovery.envs.biped.limits_record import BoundsReport
from push_recovery.envs.scenario.push import Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.rollout.outcome import NOT_SETTLED, Ending, Outcome, Score, failure_label


def row(recovered: bool, survived: bool, reason: str | None = None, impulse: float = 10.0) -> dict:
    return {"recovered": recovered, "survived": survived, "failure_reason": reason, "impulse": impulse}


ROWS = [
    row(True, True), row(True, True), row(True, True),
    row(False, True),  # stands, but not as it should
    row(False, False, "com_height"), row(False, False, "com_height"), row(False, False, "pelvis_tilt"),
    row(False, False),
]  # fmt: skip


def test_a_score_counts_what_recovered_and_says_why_the_rest_did_not():
    score = Score.of(ROWS)
    assert (score.recovered, score.survived, score.episodes, score.rate) == (3, 4, 8, 3 / 8)
    assert list(score.failures.items()) == [
        ("com_height", 2), (NOT_SETTLED, 1), ("pelvis_tilt", 1), ("unknown", 1),
    ]  # fmt: skip
    assert score.recovered + sum(score.failures.values()) == score.episodes
    content = score.to_dict()
    assert (content["recovered"], content["survived"], content["episodes"], content["rate"]) == (
        3,
        4,
        8,
        3 / 8,
    )
    # Wilson (1927) for 3 of 8: (p + z^2/2n -+ z sqrt(p q/n + z^2/4n^2)) / (1 + z^2/n), z = 1.959964
    assert content["ci95"] == pytest.approx([0.136840, 0.694258], abs=1e-5)


@pytest.mark.parametrize(
    ("of", "label"),
    [
        (row(False, False, "com_height"), "com_height"),
        (row(False, True), NOT_SETTLED),
        (row(False, False), "unknown"),
    ],
)
def test_a_label_for_each_end(of, label):
    assert failure_label(of) == label


PUSHED = Scenario(
    "a", (polar_push(200.0, -1.0, 0.1, 1.0), polar_push(900.0, 2.0, 0.2, 2.0)), Command(0.3, -0.1)
)


@pytest.mark.parametrize(
    ("fell", "settled", "reason", "expected"),
    [
        (False, 2.5, None, (True, True, 2.5, None)),
        (False, None, None, (True, False, None, None)),
        (True, None, "com_height", (False, False, None, "com_height")),
        (True, 2.5, "com_height", (False, False, 2.5, "com_height")),  # recovered first, then fell
        (True, None, None, (False, False, None, "fall")),
        (False, 0.0, "late", (True, True, 0.0, None)),
    ],
)
def test_recovered_is_standing_and_settled(fell, settled, reason, expected):
    found = Outcome.of(PUSHED, "p", Ending(fell, 6.2, settled, reason, 12.5), 620)
    assert (found.survived, found.recovered, found.recovered_at, found.failure_reason) == expected
    assert (found.end_time, found.env_steps, found.total_reward) == (6.2, 620, 12.5)


def test_a_row_tells_of_the_first_push_and_of_bounds_in_their_order():
    report = BoundsReport({"sole_edge": 1.23456789, "contact": 1.5}, {"sole_edge": 0.1234567, "contact": 0.5})
    found = Outcome.of(PUSHED, "p", Ending(False, 6.2, 2.5, None, 12.5, report), 620)
    assert (found.impulse, found.psi_deg) == (pytest.approx(20.0), pytest.approx(-57.29577951308232))
    assert (found.pushes, found.command, found.first_limit) == (2, (0.3, -0.1), "sole_edge")
    assert list(found.limits_met.items()) == [("sole_edge", 1.234568), ("contact", 1.5)]
    assert found.limit_shares == {"sole_edge": 0.123457, "contact": 0.5}
    for scenario, impulse in (
        (Scenario("none"), 0.0),
        (Scenario("up", (Push((0, 0, 50.0), 0.1, 1.0),)), 5.0),
    ):
        calm = Outcome.of(scenario, "p", Ending(False, 4.0, 1.0, None, 0.0), 400)
        assert (calm.psi_deg, calm.impulse, calm.first_limit) == (None, pytest.approx(impulse), None)
