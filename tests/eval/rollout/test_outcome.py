"""Scores of rows written by hand, and measures of an episode: by hand, and from its time histories."""

import math
from functools import partial
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.observation import DCM, STANCE_CONTACT, SWING_CONTACT, SWING_POSITION
from push_recovery.controllers.model.robot import REFERENCE
from push_recovery.controllers.whole_body.kinematics import NU, NV
from push_recovery.envs.biped.core import BipedCore
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.biped.limits_record import LimitsReport
from push_recovery.envs.robots.biped import ARMS_HELD
from push_recovery.envs.scenario.arrays import empty_pushes
from push_recovery.envs.scenario.push import Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.envs.wrappers import ActionHold
from push_recovery.eval.record.record import record_episode
from push_recovery.eval.rollout import outcome as measured
from push_recovery.eval.rollout.episodes import rollout, rollout_all
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.rollout.outcome import (
    NOT_SETTLED,
    EffortMeter,
    Ending,
    Outcome,
    Score,
    check_row,
    failure_label,
)


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
    labels = ["com_height", NOT_SETTLED, "unknown"]
    assert [failure_label(ROWS[place]) for place in (4, 3, 7)] == labels
    assert score.recovered + sum(score.failures.values()) == score.episodes
    content = score.to_dict()
    told = {"recovered": 3, "survived": 4, "episodes": 8, "rate": 3 / 8}
    assert {name: content[name] for name in told} == told
    assert Score.of([]).rate == 0.0
    # Wilson (1927) for 3 of 8: (p + z^2/2n -+ z sqrt(p q/n + z^2/4n^2)) / (1 + z^2/n), z = 1.959964
    assert content["ci95"] == pytest.approx([0.136840, 0.694258], abs=1e-5)


HUGE = 10**400  # as JSON may have it
FINITE = f"finite, got 1{'0' * 199}... (401 characters): no float is so large"


@pytest.mark.parametrize(
    ("field", "value", "must"),
    [
        ("recovered", "yes", "true or false, got 'yes'"), ("recovered", None, "true or false, got None"),
        ("survived", 1, "true or false, got 1"), ("recovered_at", "x", "a number, got 'x'"),
        ("recovered_at", HUGE, FINITE), ("failure_reason", [], "text, got []"),
        ("end_time", None, "a number, got None"), ("end_time", -1, "in [0, inf], got -1"),
        ("env_steps", -1, "an integer >= 0, got -1"), ("total_reward", math.nan, "finite, got nan"),
        ("impulse", None, "a number, got None"), ("command", "x", "2 entries, got 'x'"),
        ("limit_shares", "x", "an object, got 'x'"), ("policy_sha256", {}, "text, got {}"),
        ("measures", [1], "an object, got [1]"),
    ],
)  # fmt: skip
def test_a_value_of_another_kind_than_an_outcomes_is_named(field, value, must):
    with pytest.raises(InvalidValueError) as refused:
        check_row({**ROWS[0], field: value})
    assert str(refused.value) == f"{field} must {'have' if field == 'command' else 'be'} {must}"


def test_a_strange_entry_is_named_by_its_field_and_an_outcome_is_none():
    for field, value in (("measures", "x"), ("limit_shares", "x"), ("limits_met", "x")):
        with pytest.raises(InvalidValueError, match=rf"^{field}\.one must be a number, got 'x'$"):
            check_row({field: {"one": value}})
    check_row({"measures": {"one": None, "other": 2}})
    outcome = Outcome.of(PUSHED, "p", Ending(False, 6.2, 2.5, None, 12.5), 620).to_dict()
    check_row(outcome, optional=("kick", "measures", "policy_sha256"))
    with pytest.raises(InvalidValueError, match=r"^it lacks policy_sha256$"):
        check_row(outcome, optional=("kick", "measures"))


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
    report = LimitsReport({"sole_edge": 1.23456789, "contact": 1.5}, {"sole_edge": 0.1234567, "contact": 0.5})
    found = Outcome.of(PUSHED, "p", Ending(False, 6.2, 2.5, None, 12.5, report), 620)
    assert (found.impulse, found.psi_deg) == (pytest.approx(20.0), pytest.approx(-57.29577951308232))
    assert (found.pushes, found.command, found.first_limit) == (2, (0.3, -0.1), "sole_edge")
    assert list(found.limits_met.items()) == [("sole_edge", 1.234568), ("contact", 1.5)]
    assert found.limit_shares == {"sole_edge": 0.123457, "contact": 0.5}
    up = Scenario("up", (Push((0, 0, 50.0), 0.1, 1.0),))
    for scenario, impulse in ((Scenario("none"), 0.0), (up, 5.0)):
        calm = Outcome.of(scenario, "p", Ending(False, 4.0, 1.0, None, 0.0), 400)
        assert (calm.psi_deg, calm.impulse, calm.first_limit) == (None, pytest.approx(impulse), None)


BRIEF = Scenario("pushed", (polar_push(400.0, 1.0, 0.1, 0.3),), duration=1.2)


class Episodes(SimpleNamespace):
    """Two robots whose arrays a test writes; the second has sensors of its own."""

    def __init__(self):
        physics, judged = (SimpleNamespace(qvel=np.zeros((2, NV))) for _ in range(2))
        physics.ctrl = np.zeros((2, NU))
        senses = SimpleNamespace(last=SimpleNamespace(judged=judged), onboard=np.array([False, True]))
        core = SimpleNamespace(
            physics=physics,
            senses=senses,
            judged=judged,
            margin=np.zeros(2),
            truth=np.zeros((2, 36)),
            command=np.zeros((2, 4)),
            pushes=empty_pushes(2, 2),
        )  # fmt: skip
        core.true_values = partial(BipedCore.true_values, core)
        errors = {"error": np.array([[0.01, 9, 9], [0.02, 9, 9]]), "speed_error": np.array([0.1, 0.2])}
        monitor = SimpleNamespace(state=SimpleNamespace(touchdowns=np.array([3, 2]), **errors))
        motion = SimpleNamespace(steps=np.array([7, 1]), heading=np.zeros(2), time=np.array([3.0, 3.0]))
        super().__init__(
            n=2, control_hz=100.0, core=core, monitor=monitor, motion=lambda: motion, both_feet=False,
            robot=REFERENCE, limits=GaitLimits.of(REFERENCE),
        )  # fmt: skip


@pytest.fixture
def episodes(monkeypatch):
    monkeypatch.setattr(measured, "_motors", lambda episodes: [0, 13])
    return Episodes()


def test_sums_over_periods_are_those_by_hand(episodes):
    meter, core = EffortMeter(episodes), episodes.core
    for k in range(2):
        meter.begin(k)
    core.margin[:] = 0.3, np.nan
    core.truth[0, 15:17] = 0.1, -0.2  # pitch, roll
    core.physics.ctrl[0, [0, 1, 13]] = 10.0, 999.0, -20.0  # the robot has no motor 1
    core.physics.qvel[0, [6, 7, 19]] = -2.0, 99.0, 3.0
    core.physics.ctrl[1, 0], core.physics.qvel[1, 6], core.senses.last.judged.qvel[1, 6] = 1.0, 50.0, 4.0
    meter.look()
    core.margin[0], core.truth[0, 15:17], core.physics.ctrl[0, 0] = 0.4, (0.15, 0.0), -30.0
    meter.look()
    names = ("steps", "smallest_margin", "dcm_error", "velocity_error", "trunk_excursion", "peak_torque")
    apart = {"heading_error", "margin_of_stability"}
    names = ("first_push", *names, "mean_torque", "energy")
    assert tuple(name for name in meter.of(0) if name not in apart) == names
    mean, energy = (10 + 20 + 30 + 20) / 4, 0.01 * (10 * 2 + 20 * 3 + 30 * 2 + 20 * 3)
    assert list(meter.of(0).values()) == [
        None,
        7,
        0.3,
        None,
        0.01,
        0.1,
        0.2,
        0.0,
        30.0,
        mean,
        pytest.approx(energy),
    ]
    # Its margin was never known, its velocity is judged from the third touchdown on; the true rate counts
    energy = pytest.approx(0.01 * 2 * 4.0)
    assert list(meter.of(1).values()) == [None, 1, None, None, 0.02, None, 0.0, 0.0, 1.0, 0.5, energy]
    meter.begin(0)
    core.margin[0], core.truth[0], core.physics.ctrl[0] = 0.6, 0.0, 0.0
    meter.look()
    assert (meter.of(0)["smallest_margin"], meter.of(0)["peak_torque"], meter.of(0)["energy"]) == (0.6, 0, 0)
    assert meter.of(1)["peak_torque"] == 1.0


def test_the_first_push_is_the_earliest_that_has_begun(episodes):
    """At 3 s; pushes that wait for a gait event begin at inf."""
    meter, start = EffortMeter(episodes), episodes.core.pushes.start
    for k in range(2):
        meter.begin(k)
    start[:] = (math.inf, 2.4), (3.2, math.inf)
    meter.look()
    assert meter.of(0)["first_push"] == 2.4
    assert meter.of(1)["first_push"] is None  # the robot has ended before
    start[0] = 1.25, 0.5
    assert meter.of(0)["first_push"] == 0.5


def test_the_margin_of_stability_is_the_least_distance_from_the_border_of_what_stands(episodes):
    """Soles of 0.2 x 0.1 m; of a robot on both feet their hull, of one in flight nothing."""
    meter, truth = EffortMeter(episodes), episodes.core.truth
    meter.begin(0)
    truth[0, DCM], truth[0, SWING_POSITION] = (0.02, 0.01), (0.0, 0.2, 0.0)
    meter.look()
    assert meter.of(0)["margin_of_stability"] is None  # in flight
    for contacts, dcm, margin in (
        ((1, 0), (0.02, 0.01), 0.04),  # 4 cm to the side
        ((1, 1), (0.03, 0.1), 0.04),  # between the feet, far from every side
        ((1, 0), (0.03, 0.1), -0.05),  # the same on one foot
        ((0, 1), (0.0, 0.11), -0.05),  # within the other sole: no less than before
        ((1, 1), (0.13, 0.29), -0.05),  # 3 cm before and 4 cm beside the corner of the outer sole
        ((1, 1), (0.16, 0.33), -0.1),
        ((1, 0), (math.nan, 0.0), -0.1),
    ):
        truth[0, [STANCE_CONTACT, SWING_CONTACT]], truth[0, DCM] = contacts, dcm
        meter.look()
        assert meter.of(0)["margin_of_stability"] == pytest.approx(margin), (contacts, dcm)


def test_the_heading_is_held_against_the_commanded_turns(episodes):
    """Two periods of 10 ms: 0.5 rad/s to the left, then 0.3 to the right; at most half a turn."""
    meter, core, motion = EffortMeter(episodes), episodes.core, episodes.motion()
    motion.heading[:] = 0.1, 3.0
    for k in range(2):
        meter.begin(k)
    for turn in (0.5, -0.3):
        core.command[0, 2] = turn
        meter.look()
    motion.heading[:] = 0.352, -3.0
    assert meter.of(0)["heading_error"] == pytest.approx(0.25, abs=1e-6)
    assert meter.of(1)["heading_error"] == pytest.approx(2.0 * math.pi - 6.0, abs=1e-6)


def test_recoveries_that_turned_or_bent_are_counted():
    def measured_row(recovered, heading, lean):
        return {**row(recovered, True), "measures": {"heading_error": heading, "trunk_excursion": lean}}

    rows = [measured_row(True, 0.6, 0.1), measured_row(True, 0.5, 1.6), measured_row(False, 3.0, 2.0)]
    score = Score.of([*rows, measured_row(True, 3.0, 1.5)])
    assert (score.turned, score.bent) == (2, 1)  # over 0.524 and 1.571 rad
    assert (Score.of(ROWS).turned, Score.of(ROWS).bent) == (None, None)


@pytest.fixture(scope="module")
def biped():
    env = gym.make("PushRecovery/Biped-v0", disable_env_checker=True)
    yield env
    env.close()


def test_an_episode_tells_the_extremes_and_means_of_its_time_histories(biped):
    record = record_episode(biped, load_policy("stage-1", biped), BRIEF, "stage-1")
    told, columns = record.outcome.measures, record.columns
    moving = {name: np.array(column)[1:] for name, column in columns.items()}  # the first one is the start
    torques = np.abs([column for name, column in moving.items() if name.startswith("torque_")])
    assert told["peak_torque"] == pytest.approx(torques.max(), abs=1e-6)
    assert told["mean_torque"] == pytest.approx(torques.mean(), abs=1e-6)
    assert told["smallest_margin"] == pytest.approx(moving["capture_margin"].min(), abs=1e-6)
    leans = np.abs([moving["trunk_pitch"], moving["trunk_roll"]])
    assert told["trunk_excursion"] == pytest.approx(leans.max(), abs=1e-6)
    assert told["steps"] == columns["step"][-1]
    assert told["first_push"] == record.push_starts[0] == 0.3
    weight = biped.unwrapped.robot.mass * 9.81
    assert 0.01 * weight < told["energy"] < 10.0 * weight  # raised by its own weight through 1 cm, and 10 m


def test_an_action_that_is_held_is_measured_in_every_period(biped):
    class Still:
        def predict(self, observation):
            return np.zeros(7)

    each = rollout(biped, Still(), BRIEF, "p")
    held = rollout(ActionHold(biped, 4), Still(), BRIEF, "p")
    assert held.measures == each.measures
    assert held.env_steps == math.ceil(each.env_steps / 4)
    assert biped.unwrapped.after_period == []  # nothing is left behind
    assert held.to_dict()["measures"] == held.measures


def test_joints_that_are_held_take_no_effort():
    """Arms that are held have rates after those of the joints that control moves; one period by hand."""
    episodes = BipedEpisodes(1, robot=ARMS_HELD)
    episodes.begin(0, BRIEF)
    meter = EffortMeter(episodes)
    meter.begin(0)
    episodes.step(np.zeros((1, 7), np.float32))
    meter.look()
    physics = episodes.core.physics
    assert physics.qvel.shape[1] > NV
    work = np.abs(physics.ctrl[0] * physics.qvel[0, NV - NU : NV]).sum() * 0.01
    assert meter.of(0)["energy"] == pytest.approx(work, abs=1e-5)


def test_a_measure_from_outside_stands_in_every_row_after_those_of_the_package(biped, monkeypatch):
    fallen = measured.Measure(lambda seen, k: 1.0 - seen.core.margin.item(k))
    monkeypatch.setitem(measured.MEASURES, "from_outside", fallen)
    (alone,) = rollout_all(biped, load_policy("stage-1", biped), [BRIEF], "p", 1)
    row = rollout(biped, load_policy("stage-1", biped), BRIEF, "p").to_dict()
    assert list(row["measures"])[-2:] == ["energy", "from_outside"]
    assert row["measures"]["from_outside"] == round(1.0 - biped.unwrapped.core.margin.item(0), 6)
    assert alone.to_dict() == row


@pytest.mark.parametrize(
    ("force", "psi"),
    [
        ((50.0, 0.0, 0.0), 0.0),
        ((-50.0, 0.0, 0.0), 180.0),
        ((0.0, 50.0, 0.0), 90.0),
        ((0.0, -50.0, 20.0), -90.0),
    ],
)
def test_a_push_along_an_axis_has_a_direction(force, psi):
    scenario = Scenario("a", (Push(force, 0.1, 1.0),))
    found = Outcome.of(scenario, "p", Ending(False, 4.0, None, None, 0.0), 400)
    assert found.psi_deg == pytest.approx(psi)


def test_sums_over_time_know_how_long_a_period_is(episodes):
    """Two periods of 20 ms: 10 N m at 3 rad/s, and a command to turn at 0.5 rad/s that is not followed."""
    episodes.control_hz = 50.0
    meter, core = EffortMeter(episodes), episodes.core
    meter.begin(0)
    core.physics.ctrl[0, 0], core.physics.qvel[0, 6], core.command[0, 2] = 10.0, 3.0, 0.5
    meter.look()
    meter.look()
    found = meter.of(0)
    assert (found["energy"], found["heading_error"]) == pytest.approx((1.2, 0.02), abs=1e-6)


def test_pushes_that_follow_a_law_are_told_by_what_they_have_delivered(episodes):
    """(3, 4, 0) and (0, 0, 12) N s are 13 N s; those of robot 1 are constant."""
    meter, pushes = EffortMeter(episodes), episodes.core.pushes
    for k in range(2):
        meter.begin(k)
    pushes.law[0, 1] = 1
    pushes.delivered[:] = (3.0, 4.0, 0.0), (0.0, 0.0, 12.0)
    meter.look()
    assert meter.of(0)["delivered"] == pytest.approx(13.0)
    assert "delivered" not in meter.of(1)


@pytest.mark.parametrize(("touchdowns", "error"), [(0, None), (1, 0.01)])
def test_the_error_of_the_dcm_is_known_from_the_first_touchdown_on(episodes, touchdowns, error):
    meter = EffortMeter(episodes)
    meter.begin(0)
    episodes.monitor.state.touchdowns[0] = touchdowns
    meter.look()
    assert meter.of(0)["dcm_error"] == error


@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_outside_a_sole_the_margin_is_the_distance_from_its_nearest_corner(episodes, signs):
    """3 cm before or behind and 4 cm beside each corner of 0.2 x 0.1 m, on either foot."""
    meter, truth = EffortMeter(episodes), episodes.core.truth
    truth[0, SWING_POSITION] = 0.05, 0.2, 0.0
    for contacts, (x, y) in (((1, 0), (0.0, 0.0)), ((0, 1), (0.05, 0.2))):
        meter.begin(0)
        truth[0, [STANCE_CONTACT, SWING_CONTACT]] = contacts
        truth[0, DCM] = x + 0.13 * signs[0], y + 0.09 * signs[1]
        meter.look()
        assert meter.of(0)["margin_of_stability"] == pytest.approx(-0.05)
