"""Where a push stands on the map, thresholds of impulses, and survival under repeated pushes."""

import math

import numpy as np
import pytest
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.model.standing import Feet, max_standing_force
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.output.statistics import LogisticFit, fit_logistic, kaplan_meier
from push_recovery.eval.record.words import sector_of
from push_recovery.eval.report import pushes as parts
from push_recovery.eval.report.page import PALE
from push_recovery.eval.report.pushes import Curve
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score.limits import limit_share
from push_recovery.eval.score.suites import get_suite


@pytest.mark.parametrize(("side", "direction"), [("left", 0.7), ("right", -0.7)])
def test_pushes_on_a_right_stance_are_mirrored(side, direction):
    push = polar_push(100.0, 0.7, 0.1, GaitEvent(4, side))
    assert parts.stance_direction(push) == pytest.approx(direction)


def test_a_sector_is_the_nearest_of_eight_directions():
    degrees = {0.0: 0, 22.0: 0, 23.0: 1, 90.0: 2, 179.0: 4, -179.0: 4, -90.0: 6, -23.0: 7, -22.0: 0}
    assert {psi: sector_of(psi) for psi in degrees} == degrees


def test_only_single_pushes_with_a_limit_are_mapped():
    push, late = polar_push(80.0, 1.0, 0.1, GaitEvent(4, "right")), Push((50.0, 0.0, 0.0), 0.1, 2.0)
    scenarios = [Scenario("one", (push,)), Scenario("two", (push, push)), Scenario("none", ()),
                 Scenario("timed", (late,))]  # fmt: skip
    env = make_env("PushRecovery/Pendulum-v0")
    (found,) = parts.mapped_pushes(env, scenarios)
    share = limit_share(env, push, scenarios[0].command)
    env.close()
    assert found == parts.MappedPush("one", pytest.approx(-1.0), share)


def test_pushes_on_a_stander_are_mapped_as_they_are_by_their_share_of_what_it_catches_in_place():
    """450 N forward is F*_stand of the paper's robot (docs/limits.md)."""
    push = polar_push(225.0, 0.0, 0.1, 0.5)
    scenarios = [Scenario("one", (push,), Command(stand=True), "right"), Scenario("two", (push,))]
    with make_env("PushRecovery/Pendulum-v0@paper") as env:
        (found,) = parts.mapped_pushes(env, scenarios)
    assert found == parts.MappedPush("one", 0.0, pytest.approx(0.5, abs=1e-3), True)
    drawn = parts.direction_figure("p", [found], {"one": {"recovered": True, "survived": True}})
    assert ">left</text>" in drawn
    assert "stance" not in drawn


def test_the_rim_counts_what_each_sector_recovers():
    pushes = [
        parts.MappedPush("a", 0.1, 0.4),
        parts.MappedPush("b", -0.2, 0.9),
        parts.MappedPush("c", math.pi / 2, 1.4),
    ]
    rows = {name: {"recovered": ok, "survived": ok} for name, ok in (("a", True), ("b", False), ("c", True))}
    drawn = parts.direction_figure("p", pushes, rows)
    for text in ("1/2", "forward", "1/1", "stance", "swing", "0/0", "F*"):
        assert f">{text}</text>" in drawn


IMPULSE = np.linspace(50.0, 200.0, 40)
SURE = np.diag([1e-6, 1e-12])


def curve(intercept: float, slope: float, covariance=SURE, yes=None) -> Curve:
    recovered = np.arange(40) % 2 == 0 if yes is None else np.full(40, yes)
    return Curve("p", "pelvis", IMPULSE, recovered, LogisticFit(intercept, slope, np.asarray(covariance)))


@pytest.mark.parametrize(
    ("found", "share", "words"),
    [
        (curve(12.0, -0.1), 0.5, "120"),
        (curve(12.0, -0.1), 0.95, "91"),  # (12 - log 19) / 0.1 = 90.6
        (curve(3.0, -0.1), 0.5, "under 50"),
        (curve(30.0, -0.1), 0.5, "over 200"),
        (curve(19.0, -0.1, np.diag([0.09, 1e-12])), 0.5, "190 (184 to 196)"),  # +-1.96 x 0.3 / 0.1
        (curve(19.0, -0.1, np.diag([4.0, 1e-12])), 0.5, "190 (151 to over 200)"),
        (curve(-12.0, 0.1), 0.5, "not told"),  # the slope leads upwards
        (curve(12.0, -0.1, np.diag([1e-6, 1.0])), 0.5, "not told"),  # it may
        (Curve("p", "pelvis", IMPULSE, IMPULSE < 100.0, None), 0.5, "not told"),
        (curve(0.0, -1.0, yes=True), 0.95, "over 200"),
        (curve(0.0, -1.0, yes=False), 0.95, "under 50"),
    ],
)
def test_a_threshold_is_where_the_curve_meets_the_share_within_the_pushes_given(found, share, words):
    assert found.threshold(share) == words


def test_a_curve_for_each_body_over_its_single_pushes():
    scenarios = get_suite("quick").scenarios
    sizes = [s.pushes[0].impulse_magnitude for s in scenarios]
    rows = [{"impulse": size, "recovered": size < 100.0 + 50.0 * (i % 2)} for i, size in enumerate(sizes)]
    pelvis, trunk = parts.curves_of(scenarios, rows, "p")
    single = [s.pushes[0] for s in scenarios if len(s.pushes) == 1]
    assert (pelvis.body, trunk.body) == ("pelvis", "trunk")
    assert pelvis.impulse.tolist() == [p.impulse_magnitude for p in single if p.body == "pelvis"]
    assert trunk.impulse.size == sum(p.body == "trunk" for p in single)
    expected = fit_logistic(pelvis.impulse, pelvis.recovered)
    assert None not in (expected, pelvis.fit)
    assert pelvis.fit.slope == expected.slope < 0.0
    cells = parts.curves_table([pelvis, trunk]).rows
    assert cells[0][:3] == ("p", "pelvis", str(pelvis.impulse.size))
    assert parts.curve_figure([pelvis, trunk], 200.0).startswith("<svg")


def test_groups_are_equally_large_and_reach_as_far_as_wilson():
    centres, share, below, above = parts.binned(np.arange(12.0), np.arange(12) < 5)
    assert centres.tolist() == [0.5, 2.5, 4.5, 6.5, 8.5, 10.5]
    assert share.tolist() == [1.0, 1.0, 0.5, 0.0, 0.0, 0.0]
    assert above[0] == 0.0
    assert below[0] == pytest.approx(1.0 - 0.342, abs=5e-4)  # Wilson of 2 of 2 begins at 0.342
    assert (below[2], above[2]) == pytest.approx((0.4055, 0.4055), abs=5e-4)  # of 1 of 2: 0.0945 to 0.9055


def test_only_scenarios_with_several_pushes_count(evaluation):
    found = evaluation({"a": "rsf" * 8, "b": "r" * 24})
    several = [len(scenario.pushes) > 1 for scenario in found.suite.scenarios]
    falls = sum(letter == "f" and many for letter, many in zip("rsf" * 8, several, strict=True))
    assert 0 < falls < sum(several) < 24
    for row, many in zip(found.rows["a"], several, strict=True):
        row["end_time"] = 9.0 if row["survived"] else 4.0 if many else 1.0
    part = parts.survival_part(found)
    assert part is not None
    assert part.episodes == sum(several)
    marks = [f"standing at {time} s" for time in (3, 6, 9)]
    assert part.table.columns == ["policy", "falls", *marks]
    first, second = part.table.rows
    assert first[:3] == ("a", str(falls), "100.0 %")
    share = 100.0 * (1.0 - falls / sum(several))
    assert float(first[3].split()[0]) == float(first[4].split()[0]) == pytest.approx(share, abs=0.05)
    assert second[:2] == ("b", "0")
    assert ">b<" in part.figure


def test_four_curves_can_be_told_apart_and_the_rest_is_pale(evaluation):
    """Three that keep most robots up, and the last one; a fall at 4 s for each that an entry has more."""
    found = evaluation(
        {
            name: "f" * falls + "r" * (24 - falls)
            for name, falls in zip("abcdefg", range(18, 4, -2), strict=True)
        }
    )
    for rows in found.rows.values():
        for row in rows:
            row["end_time"] = 9.0 if row["survived"] else 4.0
    part = parts.survival_part(found)
    assert part is not None
    assert [name for name in "abcdefg" if f">{name}<" in part.figure] == ["a", "e", "f", "g"]
    assert ">3 others<" in part.figure
    assert part.figure.count(PALE) >= 3
    assert [row[0] for row in part.table.rows] == list("abcdefg")
    four = evaluation(dict.fromkeys("abcd", "rf" * 12))
    assert "others" not in parts.survival_part(four).figure


def test_nothing_is_shown_of_single_pushes(evaluation):
    found = evaluation({"a": "rsf" * 8})
    single = [i for i, scenario in enumerate(found.suite.scenarios) if len(scenario.pushes) == 1]
    suite = type(found.suite)("single", "1", tuple(found.suite.scenarios[i] for i in single))
    rows = {"a": [found.rows["a"][i] for i in single]}
    assert parts.survival_part(type(found)(suite, found.env_id, rows, found.directory, 0.0)) is None


def test_a_share_is_told_with_its_interval():
    curve = kaplan_meier([1.0, 2.0, 3.0, 3.0], [True, False, True, False])
    assert parts.share_at(curve, 0.5) == "100.0 %"
    assert parts.share_at(curve, 1.0).startswith("75.0 % (")
    assert parts.share_at(curve, 3.0).startswith(
        "37.5 % ("
    )  # 3/4 of those before, and of two at risk one falls
    low, high = (float(part) for part in parts.share_at(curve, 3.0).split("(")[1].rstrip(")").split(" to "))
    assert np.isclose(low, 100.0 * curve.low[-1], atol=0.05)
    assert np.isclose(high, 100.0 * curve.high[-1], atol=0.05)


@pytest.mark.parametrize(("side", "left"), [("right", 0.2), ("left", -0.2)])
def test_the_share_of_a_stander_is_that_of_its_feet_astride(side, left):
    scenario = Scenario("one", (polar_push(225.0, 0.6, 0.1, 0.5),), Command(stand=True), side, stride=0.2)
    with make_env("PushRecovery/Pendulum-v0@paper") as env:
        (found,) = parts.mapped_pushes(env, [scenario])
    limit = max_standing_force(RobotModel(), 0.6, 0.1, feet=Feet((0.2, left)))
    assert found.share == pytest.approx(225.0 / limit)


@pytest.mark.parametrize(
    ("stands", "left", "right"), [(False, "stance\nside", "swing\nside"), (True, "left", "right")]
)
def test_the_map_has_each_push_where_it_goes_and_names_its_sides(monkeypatch, stands, left, right):
    """Counter-clockwise from the top; on a left stance the left is the stance side."""
    monkeypatch.setattr(parts, "to_svg", lambda figure, words: figure)
    places = {"a": (0.1, 0.4), "b": (-0.2, 0.9), "c": (math.pi / 2, 1.4)}
    pushes = [parts.MappedPush(name, *place, stands) for name, place in places.items()]
    rows = {"a": {"recovered": True, "survived": True}, "b": {"recovered": False, "survived": True},
            "c": {"recovered": False, "survived": False}}  # fmt: skip
    (axes,) = parts.direction_figure("p", pushes, rows).axes
    drawn = [marks.get_offsets().tolist()[0] for marks in axes.collections[:3]]
    assert drawn == [list(place) for place in places.values()]
    texts = ((text.get_text().partition("\n")[2], text.get_position()[0]) for text in axes.texts)
    rim, quarter = {words: angle for words, angle in texts if words}, math.pi / 2
    assert rim == pytest.approx({"forward": 0.0, left: quarter, "backward": 2 * quarter, right: 3 * quarter})
    assert (axes.get_theta_direction(), axes.get_theta_offset()) == (1, pytest.approx(quarter))


def test_a_staircase_goes_on_to_the_longest_episode(monkeypatch):
    monkeypatch.setattr(parts, "to_svg", lambda figure, words: figure)
    (axes,) = parts.survival_figure({"p": kaplan_meier([1.0, 3.0], [True, False])}, 4.0).axes
    assert axes.lines[0].get_xydata().tolist() == [[0.0, 100.0], [1.0, 50.0], [3.0, 50.0], [4.0, 50.0]]
