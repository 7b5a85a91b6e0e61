import json
import math

import pytest
from push_recovery.controllers.errors import PushRecoveryError
from push_recovery.envs.scenario.arrays import assign_pushes, empty_pushes
from push_recovery.envs.scenario.push import Kick, Push
from push_recovery.envs.scenario.scenario import Scenario

KICK = Kick((0.3, -0.4, 0.1), 2.5)


def test_json_round_trip():
    scenario = Scenario("a", (Push((1.0, 0.0, 0.0), 0.1, 1.0),), kicks=(KICK, Kick((0, 1, 0), 3)))
    text = scenario.to_json()
    assert Scenario.from_json(text) == scenario
    assert json.loads(text)["kicks"][0] == {"velocity": [0.3, -0.4, 0.1], "start": 2.5}
    assert "kicks" not in json.loads(Scenario("a").to_json())  # hashes of suites without stay


def test_mirror_is_an_involution():
    mirror = Scenario("a", kicks=(KICK,)).mirrored()
    assert mirror.kicks == (Kick((0.3, 0.4, 0.1), 2.5),)
    assert mirror.mirrored() == Scenario("a", kicks=(KICK,))


def test_an_episode_ends_after_the_last_kick():
    scenario = Scenario("a", kicks=(Kick((0.1, 0, 0), 3.0), Kick((0.1, 0, 0), 1.0)), settle_time=4.0)
    assert scenario.end_time(0.0) == 7.0
    assert scenario.end_time(5.0) == 9.0


@pytest.mark.parametrize(
    "make",
    [
        lambda: Kick((1.0, 2.0), 0.0),  # type: ignore[arg-type]
        lambda: Kick((math.nan, 0.0, 0.0), 0.0),
        lambda: Kick((101.0, 0.0, 0.0), 0.0),
        lambda: Kick((0.0, 0.0, 0.0), -1.0),
        lambda: Scenario("a", kicks=(1,)),  # type: ignore[arg-type]
        lambda: Scenario("a", kicks=3),  # type: ignore[arg-type]
        lambda: Scenario.from_json('{"id": "a", "kicks": 3}'),
        lambda: Scenario.from_json('{"id": "a", "kicks": [{"velocity": [0, 0, 0]}]}'),
    ],
)
def test_bad_kicks(make):
    with pytest.raises(PushRecoveryError):
        make()


def test_a_kick_has_a_row_without_a_force_after_the_pushes():
    pushes = assign_pushes(
        empty_pushes(1, 1), 0, Scenario("a", (Push((9.0, 0.0, 0.0), 0.1, 1.0),), kicks=(KICK,))
    )
    assert pushes.start[0].tolist() == [1.0, 2.5]
    assert pushes.force[0].tolist() == [[9.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
