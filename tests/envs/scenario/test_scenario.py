import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.envs.scenario.distribution import PushDistribution
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario

PUSH = Push((10.0, -20.0, 0.0), 0.1, GaitEvent(4, "left", 0.2))


def test_json_round_trip_is_exact():
    rng = np.random.default_rng(1)
    for _ in range(50):
        scenario = PushDistribution().sample(rng)
        text = scenario.to_json()
        assert Scenario.from_json(text) == scenario
        assert Scenario.from_json(text).to_json() == text


def test_mirror_is_an_involution():
    scenario = Scenario("a", (PUSH,), Command(0.3, 0.1), "right", noise_seed=3)
    mirror = scenario.mirrored()
    assert mirror.stance_side == "left"
    assert mirror.command == Command(0.3, -0.1)
    assert mirror.pushes[0].force == (10.0, 20.0, 0.0)
    assert mirror.id == "a~"
    assert mirror.mirrored() == scenario


def test_end_time():
    assert Scenario("a", (PUSH,)).end_time(3.0) == 7.0
    assert Scenario("a", (PUSH,)).end_time(math.inf) == math.inf
    assert Scenario("a", duration=60.0).end_time(0.0) == 60.0
    assert Scenario("a", (PUSH,)).side_of_step(5) == "right"


@pytest.mark.parametrize(
    "make",
    [
        lambda: Scenario(""),
        lambda: Scenario("a", stance_side="both"),  # type: ignore[arg-type]
        lambda: Scenario("a", duration=0.0),
        lambda: Scenario("a", settle_time=math.nan),
        lambda: Scenario("a", noise_seed=-1),
        lambda: Scenario("a", pushes=(1,)),  # type: ignore[arg-type]
        lambda: Command(vx=math.nan),
        lambda: Scenario.from_json("{"),
        lambda: Scenario.from_json("[]"),
        lambda: Scenario.from_json('{"id": "a", "pushes": 3}'),
        lambda: Scenario.from_json('{"id": "a", "surprise": 3}'),
    ],
)
def test_bad_scenario_is_an_error_of_this_package(make):
    with pytest.raises(PushRecoveryError):
        make()


@pytest.mark.parametrize("name", ["pushes", "changes"])
@pytest.mark.parametrize("value", [3, None])
def test_pushes_and_changes_are_sequences(name, value):
    with pytest.raises(InvalidValueError, match=rf"Scenario\.{name} must be a sequence"):
        Scenario("a", **{name: value})


def test_a_noise_seed_stays_one_that_json_can_hold():
    assert Scenario.from_json(Scenario("a", noise_seed=2**128 - 1).to_json()).noise_seed == 2**128 - 1
    with pytest.raises(InvalidValueError, match=r"Scenario\.noise_seed must be an integer in"):
        Scenario("a", noise_seed=2**128)


def test_a_sensing_is_said_only_where_it_is_not_exact():
    onboard = Scenario("a", sensing="onboard")
    assert "sensing" not in Scenario("a").to_dict()
    assert onboard.to_dict()["sensing"] == "onboard"
    assert Scenario.from_json(onboard.to_json()) == onboard
    assert onboard.mirrored().sensing == "onboard"
    with pytest.raises(UnknownNameError, match=r"sensing 'onbord'.*exact, onboard"):
        Scenario("a", sensing="onbord")
