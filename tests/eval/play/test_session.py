"""Drags against projections by hand, and sessions against rollouts of the scenarios that they have become."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.play import browser
from push_recovery.eval.play import session as play
from push_recovery.eval.play.session import IMPULSE_MAX, Session, dragged_impulse, floor_impulse, status_words
from push_recovery.eval.record.record import record
from push_recovery.eval.rollout.outcome import REASONS
from push_recovery.eval.score.suites import get_suite

BIPED = "PushRecovery/Biped-v0"


def camera(azimuth, elevation):
    """Axes right, down, view of a camera that looks towards an azimuth [deg], downwards by an elevation."""
    a, e = np.radians([azimuth, elevation])
    view = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return np.stack([right, np.cross(view, right), view], axis=1)


def test_to_the_right_of_the_screen_pushes_to_the_right_of_the_view():
    axes = camera(90.0, 20.0)  # looks along y
    np.testing.assert_allclose(axes[:, 1] @ [0, 0, 1.0], -np.cos(np.radians(20.0)))  # down points down
    np.testing.assert_allclose(dragged_impulse(0.5 * axes[:, 0], axes), [50.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(dragged_impulse(-0.5 * axes[:, 0], axes), [-50.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("elevation", [0.0, 15.0, 60.0, 89.9])
def test_upwards_pushes_away_from_the_camera_whatever_its_height(elevation):
    axes = camera(180.0, elevation)  # looks along -x
    np.testing.assert_allclose(dragged_impulse(-0.3 * axes[:, 1], axes), [-30.0, 0.0], atol=1e-9)


def test_from_straight_above_the_push_follows_the_pointer():
    axes = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # right -y, down -x
    np.testing.assert_allclose(dragged_impulse([0.2, -0.1, 0.0], axes), [20.0, -10.0], atol=1e-9)


def test_the_largest_impulse_keeps_its_direction():
    far = floor_impulse([-9.0, 12.0])
    assert np.hypot(*far) == pytest.approx(IMPULSE_MAX)
    np.testing.assert_allclose(far / IMPULSE_MAX, [-0.6, 0.8])
    np.testing.assert_allclose(floor_impulse([0.03, -0.04]), [3.0, -4.0])
    np.testing.assert_array_equal(floor_impulse([0.0, 0.0]), [0.0, 0.0])


def test_a_push_has_the_impulse_and_begins_now():
    push = play.push_now([30.0, -12.5], 1.23, "trunk")
    assert push.impulse == pytest.approx((30.0, -12.5, 0.0))
    assert (push.start, push.duration, push.body, push.frame) == (1.23, 0.1, "trunk", "world")


def test_a_polar_impulse_turns_counter_clockwise():
    np.testing.assert_allclose(play.polar_impulse(20.0, 90.0), [0.0, 20.0], atol=1e-12)
    with pytest.raises(InvalidValueError, match="400"):
        play.polar_impulse(401.0, 0.0)


def go(session, periods):
    for _ in range(periods):
        session.step()


def state(lane):
    """All that the future of a robot follows from."""
    return lane.state().snapshot.rows


def assert_same(one, other):
    assert one.keys() == other.keys()
    for name, array in one.items():
        np.testing.assert_array_equal(array, other[name], err_msg=name)


@pytest.fixture
def session():
    session = Session(BIPED, "two-stage")
    yield session
    session.close()


def test_pushes_and_commands_while_it_walks_are_a_scenario_bit_for_bit(session):
    go(session, 55)
    session.set_command(Command(0.2, 0.0, 0.1))
    session.set_command(Command(0.25, 0.0, 0.1))  # of two in one planning period the later one stands
    go(session, 40)
    first = session.push([12.0, 15.0])
    go(session, 13)
    session.push([0.0, -8.0], "trunk")
    go(session, 70)
    scenario = session.first.scenario
    assert scenario.pushes[0] == first
    assert first.start == pytest.approx(0.95)
    assert [change.command.vx for change in scenario.changes] == [0.25]
    assert scenario.changes[0].time == pytest.approx(0.56)
    found = record("two-stage", replace(scenario, duration=session.first.time), BIPED)
    np.testing.assert_equal(session.first.rows[-1], {name: c[-1] for name, c in found.columns.items()})
    delivered = session.first.episodes.core.pushes.delivered[0]
    np.testing.assert_allclose(delivered, [[12.0, 15.0, 0.0], [0.0, -8.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize("kind", play.KINDS)
def test_every_kind_given_by_hand_is_a_scenario_bit_for_bit_and_is_given_again(session, kind):
    session.drive(0.3, 0.0, 0.0)
    go(session, 55)
    assert not session.first.given
    given = session.push([18.0, 24.0], "trunk", kind)
    go(session, 90)
    scenario, once = session.first.scenario, state(session.first)
    assert (scenario.pushes, session.first.given) == ((given,), [kind])
    found = record("two-stage", replace(scenario, duration=session.first.time), BIPED)
    np.testing.assert_equal(session.first.rows[-1], {name: c[-1] for name, c in found.columns.items()})
    plain = record("two-stage", replace(scenario, duration=session.first.time, pushes=()), BIPED)
    assert abs(found["dcm_y"][-1] - plain["dcm_y"][-1]) > 1e-6  # it is felt
    assert session.replay() == given
    go(session, 90)
    assert_same(once, state(session.first))
    assert (session.first.scenario, session.first.given) == (scenario, [kind])


@pytest.mark.parametrize(
    ("kind", "delivered"),  # of J = 30 N s, on 60 kg
    [("push", 30.0), ("steady force", 30.0), ("impactor", 30.0 * 1.5 / 1.25), ("payload", None)],
)
def test_the_impulse_of_a_kind_is_the_one_that_was_chosen(session, kind, delivered):
    """An impactor of m / 4 with e = 0.5 would give a rigid body of mass m the impulse J (1 + e) / 1.25."""
    go(session, 30)
    push = session.push([18.0, 24.0], "pelvis", kind)
    go(session, 100)
    if delivered is None:
        assert push.impulse == pytest.approx((0.0, 0.0, -30.0))
        return
    got = session.first.episodes.core.pushes.delivered[0, 0, :2]
    assert np.hypot(*got) == pytest.approx(delivered, rel=1e-6 if kind != "impactor" else 0.5)
    np.testing.assert_allclose(got / np.hypot(*got), [0.6, 0.8], atol=1e-9)


def test_a_direction_is_that_of_the_world_also_on_a_robot_that_has_turned(session):
    session.drive(0.0, 0.0, 0.6)
    go(session, 150)
    heading = session.first.rows[-1]["heading"]
    assert heading > 0.4
    session.push([0.0, 30.0], "pelvis", "steady force")
    go(session, 110)
    got = session.first.episodes.core.pushes.delivered[0, 0]
    np.testing.assert_allclose(got, [0.0, 30.0, 0.0], atol=1e-6)


def test_what_is_given_is_said_and_what_is_impossible_is_refused(session):
    go(session, 30)
    session.push([0.0, 10.0], "pelvis", "trip")
    assert status_words(session.first) == "trip to come in the next step"
    go(session, 50)
    assert "s after trip" in status_words(session.first)
    session.push([0.0, 6.0], "pelvis", "impactor")
    go(session, 5)
    assert status_words(session.first) == (
        "0.05 s after impactor of nominally 6.0 N s (0.10 N s/kg) to the left"
    )
    with pytest.raises(UnknownNameError, match="kind of disturbance"):
        session.push([0.0, 6.0], "pelvis", "kick")
    session.restart()
    session.stand_at_rest(True)
    go(session, 200)
    with pytest.raises(InvalidValueError, match=r"^a robot that stands does not trip: let it walk first$"):
        session.push([0.0, 6.0], "pelvis", "trip")


def test_a_replay_is_the_same_push_again_bit_for_bit(session):
    with pytest.raises(InvalidValueError, match="no push yet"):
        session.replay()
    go(session, 60)
    session.push([0.0, 14.0])
    go(session, 80)
    once, scenario = state(session.first), session.first.scenario
    go(session, 33)
    assert session.replay() == scenario.pushes[-1]
    assert session.first.time == pytest.approx(0.6)
    go(session, 80)
    assert session.first.scenario == scenario
    assert_same(once, state(session.first))


def test_another_policy_takes_over_in_mid_walk_and_goes_another_way(session):
    go(session, 60)
    session.push([0.0, 14.0])
    before = state(session.first)
    assert session.switch("stage-1")
    assert session.first.name == "stage-1"
    assert_same(before, state(session.first))
    go(session, 60)
    other = session.first.rows[-1]["dcm_y"]
    session.switch("two-stage")
    session.replay()
    go(session, 60)
    assert session.first.rows[-1]["dcm_y"] != other


def test_a_policy_with_a_robot_of_its_own_starts_a_new_walk(session):
    go(session, 30)
    session.set_command(Command(0.2))
    assert not session.switch("raibert")
    assert (session.first.time, session.first.command) == (0.0, Command(0.2))
    with pytest.raises(UnknownNameError, match="two-stage"):
        session.switch("two-stag")
    assert session.first.name == "raibert"


def test_two_robots_meet_the_same_push_from_the_same_state(session):
    go(session, 60)
    session.put_beside("stage-1")
    first, second = session.lanes
    assert_same(state(first), state(second))
    go(session, 20)
    session.push([3.0, 14.0])
    assert_same(state(first), state(second))
    assert first.scenario == second.scenario
    go(session, 60)
    assert first.time == second.time
    apart = second.rows[-1]["dcm_y"]
    assert first.rows[-1]["dcm_y"] != apart
    session.replay()
    assert_same(state(first), state(second))
    go(session, 60)
    assert second.rows[-1]["dcm_y"] == apart
    session.put_beside(None)
    assert session.lanes == [first]


def test_a_fallen_robot_lies_and_says_so_until_it_starts_anew(session):
    session.set_command(Command(0.1))
    go(session, 40)
    session.push([0.0, -300.0])
    go(session, 250)
    lane = session.first
    assert lane.over
    assert status_words(lane).startswith("fell ")
    assert REASONS[lane.info["failure_reason"]] in status_words(lane)
    assert status_words(lane).endswith(": press N to start anew, R to replay the last push")
    time = lane.time
    go(session, 5)
    assert lane.time == time
    with pytest.raises(InvalidValueError, match="has fallen"):
        session.push([1.0, 0.0])
    session.set_command(Command(0.3))  # nobody walks who could follow it
    session.replay()
    assert not lane.over
    session.restart()
    assert (lane.time, lane.command) == (0.0, Command(0.1))


@pytest.fixture
def standing():
    session = Session(BIPED, "two-stage", start=Scenario("stand", (), Command(stand=True)))
    go(session, 50)
    yield session
    session.close()


@pytest.mark.parametrize(
    ("impulse", "answer"),
    # forward the soles alone catch 25 N s, with the trunk 45 N s, of 0.1 s (docs/standing.md)
    [
        (18.0, "ankles (no step, the soles alone were enough)"),
        (-33.0, "hips (no step, the trunk's swing was needed)"),
        (60.0, "2 steps"),
    ],
)
def test_the_words_for_a_standing_robots_answer_follow_from_where_its_limits_are(standing, impulse, answer):
    assert (status_words(standing.first), play.answer_words(standing.first)) == ("stands, 0.5 s", "")
    standing.push([impulse, 0.0])
    assert play.answer_words(standing.first) == f"answer to the push: {play.ANSWERS['ankle']}"  # as yet
    go(standing, 250)
    assert status_words(standing.first).startswith("recovered ")
    assert play.answer_words(standing.first) == f"answer to the push: {answer}"
    standing.drive(0.2, 0.0, 0.0)
    go(standing, 150)
    assert play.answer_words(standing.first) == f"answer to the push: {answer}"  # its walk is no answer
    standing.push([5.0, 0.0])
    assert play.answer_words(standing.first) == ""


def test_a_robot_that_stands_at_rest_walks_when_driven_and_stands_again(standing):
    standing.drive(0.3, 0.0, 0.0)
    assert standing.first.command == Command(0.3)
    go(standing, 150)
    assert not standing.first.stands
    standing.stand_at_rest(False)
    standing.stand_at_rest(True)
    assert standing.first.command == Command(0.3)
    standing.drive(0.0, 0.0, 0.0)
    go(standing, 200)
    assert standing.first.stands
    standing.push([10.0, 0.0])
    standing.stand_at_rest(False)
    go(standing, 30)
    assert standing.first.command == Command()
    assert not standing.first.stands
    standing.replay()
    assert standing.stands
    assert standing.first.command == Command(stand=True)


@pytest.mark.parametrize(("name", "stands"), [("joint", False), ("joint-residual", True)])
def test_a_robot_under_joint_targets_steps_in_place_beside_one_that_stands(standing, name, stands):
    standing.put_beside(name)
    go(standing, 20)
    standing.push([5.0, 0.0])
    go(standing, 20)
    first, second = standing.lanes
    assert (first.command.stand, second.command.stand) == (True, stands)
    assert (first.stands, second.stands) == (True, stands)
    assert (play.answer_words(second) == "") == (not stands)


def test_the_clock_is_followed_at_its_speed(session):
    assert session.advance(0.1) == 10
    session.set_speed(0.25)
    assert [session.advance(0.02) for _ in range(4)] == [0, 1, 0, 1]
    assert session.advance(60.0) == play.PERIODS_MAX
    session.paused = True
    assert session.advance(0.1) == 0
    assert session.first.time == pytest.approx(0.01 * (12 + play.PERIODS_MAX))
    with pytest.raises(InvalidValueError, match=r"0\.02"):
        session.set_speed(0.0)


def test_words_tell_of_the_push_and_of_the_limits_it_meets(session):
    assert play.limits_words(session.first) == []
    go(session, 60)
    assert status_words(session.first) == "walks, 0.6 s"
    session.push([0.0, 15.0])
    go(session, 25)
    assert status_words(session.first) == "pushed 0.25 s ago with 15.0 N s (0.25 N s/kg) to the left"
    assert "sole edge" in play.limits_words(session.first)
    go(session, 225)
    assert status_words(session.first).startswith("recovered ")


def test_a_robot_that_is_no_biped_is_refused():
    with pytest.raises(InvalidValueError, match="only bipeds"):
        Session("PushRecovery/Pendulum-v0", "two-stage")


def test_ctrl_c_is_the_way_to_end_a_play_and_no_error(monkeypatch, capsys):
    pytest.importorskip("viser")

    def interrupted(app):
        raise KeyboardInterrupt

    monkeypatch.setattr(browser.App, "run", interrupted)
    assert main(["play", "--port", "0"]) == 0
    told = capsys.readouterr()
    assert "drag it and let go, or press space; Ctrl-C ends" in told.out.splitlines()
    assert "error" not in told.err


def test_kinds_and_words_hold_what_is_documented():
    lane = SimpleNamespace(
        time=1.0,
        period=0.01,
        mass=60.0,
        steps=3,
        stands=False,
        rows=[{"heading": 0.2}],
        scenario=Scenario("x"),
    )
    by_hand = play.ByHand(np.array([18.0, 24.0]), "trunk", lane)
    made = {kind: make(by_hand) for kind, make in play.KINDS.items()}
    assert made["weight pull"].mass == pytest.approx(30.0 / (9.81 * 0.5))
    assert made["waist pull"].travel == pytest.approx(0.06)
    slip, trip = made["slip"], made["trip"]
    assert (slip.side, slip.friction, slip.start, slip.duration) == ("right", 0.05, 1.01, 0.4)
    assert (trip.start.step, trip.start.side, trip.force) == (4, "left", 150.0)
    fell = SimpleNamespace(
        over=True, given=["push"], time=2.35, push_start=1.1, info={"failure_reason": "com_height"}
    )
    assert status_words(fell).startswith("fell 1.25 s after the push")


def test_corrections_are_not_played_with():
    with pytest.raises(InvalidValueError, match="those of PushRecovery/BipedResidual-v0 are corrections"):
        Session("PushRecovery/BipedResidual-v0", "two-stage")


@pytest.mark.parametrize("suite", ["disturbances", "kick"])
def test_a_session_has_nothing_of_what_happens_in_its_start(suite):
    session = Session(BIPED, "two-stage", start=get_suite(suite).scenarios[0])
    assert (session.first.scenario.forces, session.first.scenario.jumps) == ((), ())
    session.close()


def test_a_fallen_robot_starts_anew_as_it_was_told_while_it_lay():
    session = Session(BIPED, "two-stage")
    lane = session.first
    lane.over = True
    session.drive(0.3, 0.0, 0.0)
    assert lane.command == Command(0.3)
    assert lane.scenario.command == Command()
    session.restart()
    assert lane.scenario.command == Command(0.3)
    session.drive(0.1, 0.0, 0.0)
    assert lane.command == Command(0.1)
    session.close()


def test_a_walk_that_began_astride_begins_anew_on_the_way_too():
    session = Session(BIPED, "two-stage", start=Scenario("x", (), Command(stand=True), stride=0.2))
    assert session.first.scenario.stride == 0.2
    session.drive(0.2, 0.0, 0.0)
    session.restart()
    assert (session.first.command, session.first.scenario.stride) == (Command(0.2), 0.0)
    session.drive(0.0, 0.0, 0.0)
    session.restart()
    assert session.first.scenario.stride == 0.2
    session.close()


def test_a_replay_puts_a_second_robot_of_another_kind_back_to_its_own_moment():
    """Times are sums of 2 ms, so that their differences are rounded."""
    session = Session(BIPED, "two-stage")
    go(session, 60)
    session.put_beside("raibert")
    for _ in range(6):
        go(session, 1)
        session.push([0.0, 0.5])
        began = [lane.time for lane in session.lanes]
        go(session, 1)
        session.replay()
        assert [lane.time for lane in session.lanes] == began
        assert session.lanes[1].scenario.pushes[-1].start == began[1]
    session.close()


def test_what_a_kind_given_by_hand_weighs_and_how_fast_it_is():
    """J = 30 N s on 60 kg: a quarter of that at 2 m/s; a fall of 0.2 m ends at sqrt(2 g 0.2)."""
    lane = SimpleNamespace(time=1.0, mass=60.0, rows=[{"heading": 0.2}])
    hand = play.ByHand(np.array([18.0, 24.0]), "trunk", lane)
    kinds = ("impactor", "waist pull", "steady force", "payload")
    hit, pull, press, load = (play.KINDS[kind](hand) for kind in kinds)
    assert (hit.mass, hit.speed, hit.start, hit.body) == (15.0, pytest.approx(2.0), 1.0, "trunk")
    assert hit.direction == pytest.approx(np.arctan2(24.0, 18.0) - 0.2)
    assert (pull.fastest, press.force, press.duration, press.rise) == (0.8, pytest.approx(37.5), 1.0, 0.2)
    assert (load.height, load.mass) == (0.2, pytest.approx(30.0 / np.sqrt(2.0 * 9.81 * 0.2)))


def test_a_speed_is_changed_only_as_far_as_it_may_go():
    clock = SimpleNamespace(speed=1.0)
    for factor, speed in ((0.5, 0.5), (0.01, 0.02), (200.0, 2.0)):
        Session.faster(clock, factor)
        assert clock.speed == speed


def test_a_limit_counts_as_being_met_for_thirty_periods():
    rows = [{"time": 0.01 * i, "limit_cop": float(i == 0), "limit_sole_edge": float(i == 1),
             "limit_friction": 0.0} for i in range(31)]  # fmt: skip
    assert play.limits_words(SimpleNamespace(rows=rows)) == ["sole edge"]
