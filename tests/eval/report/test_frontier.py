"""The page of a frontier on rows written by hand."""

import math
import shlex
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.envs.scenario.scenario import AT_REST
from push_recovery.eval.cli.main import parse
from push_recovery.eval.cli.score import Frontier as FrontierOptions
from push_recovery.eval.report import frontier, page
from push_recovery.eval.report.frontier import frontier_table
from push_recovery.eval.report.page import Command, command_of
from push_recovery.eval.score.frontier import Frontier, FrontierSettings
from push_recovery.eval.score.limits import DirectionLimits

pytest.importorskip("jinja2", reason="needs the extra report")
FALL = {
    "force_N": 160.0, "failure_reason": "com_height", "first_limit": "cop", "limits_met": {"cop": 1.0},
    "limit_shares": {"cop": 0.5, "contact": 0.75},
}  # fmt: skip


def row(psi, survived, falls=()):
    forces = {"survived_N": survived, "largest_survived_N": survived}
    return {"policy": "p", "psi_deg": psi, **forces, "falls": list(falls)}


@pytest.fixture
def found(tmp_path):
    (tmp_path / "outcomes.jsonl").write_text("")
    rows = {
        "p": [row(0.0, 140.0, [FALL]), row(90.0, 100.0), row(180.0, 100.0)],
        "q": [row(0.0, 120.0), row(90.0, 120.0), row(180.0, 100.0)],
    }
    limits = {0.0: (400.0, 200.0, 160.0), 90.0: (200.0, 90.0, 125.0), 180.0: (0.0, 50.0, 80.0)}
    limits = {psi: DirectionLimits(*forces) for psi, forces in limits.items()}
    return Frontier(FrontierSettings("PushRecovery/Pendulum-v0"), rows, limits, tmp_path, 60.0)


def test_shares_are_of_the_own_box_where_it_has_a_limit(found):
    assert frontier.mean_share(found, "p") == pytest.approx((140 / 400 + 100 / 200) / 2)
    assert frontier.verdict(found) == (
        "q withstands 45 % of F* in the mean, p 42 %: the first takes the harder push in 1 of 3 directions, "
        "the second in 1."
    )
    first, _, last = frontier_table(found, frontier.direction_text, falls=False).rows
    assert first == ("0°, forward", "400", "200", "160", "140 (0.35, 0.70)", "120 (0.30, 0.60)")
    assert last == ("180°, backward", "0", "50", "80", "100 (-, 2.00)", "100 (-, 2.00)")


def standing(found):
    """The same of robots that stand: p takes no step up to 80, 100 and 60 N, q up to 120, 100 and 60 N."""
    caught = {"p": (80.0, 100.0, 60.0), "q": (120.0, 100.0, 60.0)}
    rows = {
        name: [{**row, "stand_N": force} for row, force in zip(found.rows[name], forces, strict=True)]
        for name, forces in caught.items()
    }
    return replace(found, settings=replace(found.settings, command=AT_REST), rows=rows)


def test_a_standing_robot_is_measured_by_what_it_catches_without_a_step_too(found):
    found = standing(found)
    assert frontier.mean_share_in_place(found, "p") == pytest.approx((80 / 160 + 100 / 125 + 60 / 80) / 3)
    assert frontier.verdict(found).endswith(
        "the second in 1. Of F*_stand, caught without a step: q 77 %, p 68 %."
    )
    table = frontier_table(found, falls=False)
    assert table.columns[4:] == ("p", "q", "p without a step", "q without a step")
    assert table.rows[0][6:] == ("80 (0.50)", "120 (0.75)")
    assert found.to_dict("q")["directions"][0]["stand_N"] == 120.0
    text = frontier.write_frontier_page(found, Command(("frontier",))).read_text()
    assert "stands on both feet. After half a second at rest, a force" in text
    assert "walks" not in text.split("</section>")[0]


def test_a_fall_is_replayed_by_the_push_that_it_was(found):
    options = FrontierOptions(policies=("p", "q"), vx=0.2, body="trunk", profile="hardware", grid=20.0)
    (line,) = frontier.falls_table(found, command_of("frontier", options)).rows
    assert line[:4] == ("p", "0°, forward", "160 N (sank too low)", "CoP; contact 0.75, CoP 0.50")
    play = parse("play", shlex.split(line[4])[2:])
    assert not play.stand
    stands = command_of("frontier", FrontierOptions(policies=("p",), stand=True))
    assert parse("play", shlex.split(stands.replay_push(0.0, 160.0, "p"))[2:]).stand
    assert (play.psi, play.force, play.policy, play.vx, play.body, play.profile) == (
        0.0, 160.0, "p", 0.2, "trunk", "hardware"
    )  # fmt: skip


def test_the_page_says_what_was_measured(found):
    path = frontier.write_frontier_page(found, Command(("frontier",)))
    text = path.read_text()
    assert path == found.directory / "report.html"
    assert "walks in place" in text
    assert text.count("<svg") == 2


def test_the_map_of_a_page_goes_from_forward_to_the_left_and_holds_every_limit(found, monkeypatch):
    monkeypatch.setattr(page, "to_svg", lambda figure, words: figure)
    monkeypatch.setattr(frontier, "CURVE_STEP", 45.0)
    (_, figure), _ = frontier._figures(found)
    (axes,) = figure.axes
    assert [text.get_text() for text in axes.get_xticklabels()][::2] == [
        "forward",
        "left",
        "backward",
        "right",
    ]
    lines = {line.get_label(): line for line in axes.lines}
    np.testing.assert_allclose(lines["p"].get_xdata(), [0.0, math.pi / 2, math.pi, 0.0])
    assert lines["p"].get_ydata().tolist() == [140.0, 100.0, 100.0, 140.0]
    assert axes.get_ylim()[1] == pytest.approx(1.05 * max(lines[frontier.OWN].get_ydata()))
