"""What `info` tells, against values written by hand; one robot's dict and the vector form of n agree."""

import math

import numpy as np
import pytest
from push_recovery.controllers.model.observation import ELAPSED, STANCE_CONTACT, SWING_CONTACT
from push_recovery.envs.episode.info import InfoReader
from push_recovery.envs.episode.period_end import REWARD_TERMS, latest_push
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Scenario

PUSHES = (
    Push((30.0, -40.0, 0.0), 0.1, 0.2, body="trunk"),
    Push((0.0, 60.0, 80.0), 0.05, GaitEvent(5, "left")),
)


@pytest.mark.parametrize(
    ("starts", "count", "time", "index"),
    [
        ([0.5, 0.2], 0, 1.0, -1),
        ([0.5, 0.2], 2, 0.1, 0),  # none has begun: the first of the list
        ([0.5, 0.2], 2, 0.2, 0),  # one that begins now has not begun
        ([0.5, 0.2], 2, 0.3, 1),
        ([0.5, 0.2], 2, 1.0, 0),  # the latest one
        ([0.2, 0.5], 2, 1.0, 1),
        ([0.3, 0.3], 2, 1.0, 0),
        ([0.2, 0.5], 1, 1.0, 0),  # the other belongs to no one
        ([math.inf, 0.2], 2, 1.0, 1),
        ([math.inf], 1, 1.0, 0),
    ],
)
def test_the_push_of_info(starts, count, time, index):
    assert latest_push(np.array(starts), count, time) == index


def written():
    """Two pendulums in states written by hand; the second one stands on its left foot."""
    episodes = PendulumEpisodes(2)
    reader = InfoReader(episodes)
    for k, scenario in enumerate((Scenario("a", PUSHES, stance_side="right"), Scenario("b"))):
        episodes.begin(k, scenario)
        reader.begin(k, scenario)
    core, state = episodes.core, episodes.core.state
    state.time[:], episodes.planned[:] = (0.7, 0.4), (0.5, 0.4)
    core.margin[:], core.world[:] = (0.06, -0.02), np.arange(12.0).reshape(2, 6)
    core.truth[:, ELAPSED], core.observation[:, ELAPSED] = (0.2, 0.6), 0.1
    core.truth[:, STANCE_CONTACT], core.truth[:, SWING_CONTACT] = (1.0, 0.0), (0.0, 1.0)
    state.failure[:] = 0, 1
    episodes.monitor.state.recovered_at[:] = 0.65, np.nan
    return reader


def test_one_robot():
    info = written().of_robot(0, np.arange(7.0))
    points = {key: info.pop(key).tolist() for key in ("dcm", "cop", "cmp")}
    assert points == {"dcm": [0.0, 1.0], "cop": [2.0, 3.0], "cmp": [4.0, 5.0]}
    assert info == {
        "scenario_id": "a",
        "time": 0.7,
        "push": {
            "force": (30.0, -40.0, 0.0), "direction": math.atan2(-40.0, 30.0), "start": 0.2,
            "duration": 0.1, "body": "trunk", "impulse": (3.0, -4.0, 0.0),
            "impulse_per_kg": pytest.approx(5.0 / 60.0),
        },
        "capture_margin": 0.06,
        "phase": 0.4,  # of what is, not of what is seen
        "stance_side": "right",
        "failure_reason": None,
        "recovered_at": 0.65,
        "reward_terms": dict(zip(REWARD_TERMS, range(7), strict=True)),
        "contacts": {"left": False, "right": True},
    }  # fmt: skip


def test_a_robot_without_pushes_that_has_fallen():
    info = written().of_robot(1, np.zeros(7))
    assert info["push"] is None
    assert info["recovered_at"] is None
    assert info["failure_reason"] == "dcm_diverged"
    assert info["phase"] == 1.0  # at most
    assert info["stance_side"] == "left"
    assert info["contacts"] == {"left": False, "right": True}
    assert info["dcm"].tolist() == [6.0, 7.0]


def test_the_vector_form_of_the_same():
    terms = np.arange(14.0).reshape(2, 7)
    info = written().of_robots(np.array([True, True]), terms)
    assert info["push"]["_force"].tolist() == [True, False]
    assert info["push"]["force"][0].tolist() == [30.0, -40.0, 0.0]
    assert info["push"]["impulse"][0].tolist() == [3.0, -4.0, 0.0]
    assert info["push"]["duration"][0] == 0.1
    assert info["push"]["start"][0] == 0.2
    assert info["push"]["body"][0] == "trunk"
    assert info["failure_reason"].tolist() == [None, "dcm_diverged"]
    assert info["_failure_reason"].tolist() == [False, True]
    assert info["_recovered_at"].tolist() == [True, False]
    assert info["recovered_at"][0] == 0.65
    assert info["cop"].tolist() == [[2.0, 3.0], [8.0, 9.0]]
    assert info["contacts"]["left"].tolist() == [False, False]
    assert info["contacts"]["right"].tolist() == [True, True]
    assert info["phase"].tolist() == [0.4, 1.0]
    assert info["reward_terms"][REWARD_TERMS[2]].tolist() == [2.0, 9.0]


def test_a_push_that_waits_for_its_gait_event_has_no_start():
    episodes = PendulumEpisodes(1)
    reader, scenario = InfoReader(episodes), Scenario("a", PUSHES[1:])
    episodes.begin(0, scenario)
    reader.begin(0, scenario)
    push = reader.of_robot(0, np.zeros(7))["push"]
    assert push["start"] is None
    assert push["body"] == "pelvis"
    assert push["impulse"] == (0.0, 3.0, 4.0)
    assert not reader.of_robots(np.array([True]), np.zeros((1, 7)))["push"]["_start"].any()


def test_a_stander_is_in_no_phase():
    reader = written()
    reader._episodes.core.truth[0, ELAPSED] = -1.0
    assert reader.of_robot(0, np.zeros(7))["phase"] == 0.0


def test_arrays_and_masks_of_info_are_the_callers_each_for_itself():
    reader, everyone, terms = written(), np.array([True, True]), np.zeros((2, 7))
    info = reader.of_robots(everyone, terms)
    info["_time"][:], info["scenario_id"][:] = False, None
    assert everyone.all()
    assert info["_phase"].all()
    assert reader.of_robots(everyone, terms)["scenario_id"].tolist() == ["a", "b"]
