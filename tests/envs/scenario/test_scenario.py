import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.push_distribution import PushDistribution
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


def test_distribution_is_a_function_of_the_generator():
    draw = [PushDistribution().sample(np.random.default_rng(7)) for _ in range(2)]
    assert draw[0] == draw[1]
    rng = np.random.default_rng(0)
    sample = [PushDistribution().sample(rng) for _ in range(400)]
    impulses = np.array([s.pushes[0].impulse_magnitude for s in sample])
    assert impulses.min() >= 5.0 - 1e-9
    assert impulses.max() <= 80.0 + 1e-9
    assert abs(impulses.mean() - 42.5) < 4.0
    vx = np.array([s.command.vx for s in sample])
    vy = np.array([s.command.vy for s in sample])
    assert vx.max() <= 0.5
    assert vx.min() >= -0.25
    assert np.abs(vy).max() <= 0.2
    assert 0.15 < np.mean((vx == 0) & (vy == 0)) < 0.35
    assert {s.stance_side for s in sample} == {"left", "right"}
    assert len({s.id for s in sample}) == len(sample)


def test_distribution_round_trip_and_bounds():
    distribution = PushDistribution(impulse_max=40.0)
    assert PushDistribution.from_dict(distribution.to_dict()) == distribution
    with pytest.raises(InvalidValueError, match=r"impulse_max.*\[5"):
        PushDistribution(impulse_max=1.0)
    with pytest.raises(PushRecoveryError, match="impuls"):
        PushDistribution.from_dict({"impuls_min": 1.0})


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


def test_the_hardest_push_of_a_distribution_is_one_that_a_push_may_have():
    PushDistribution(impulse_max=1e7 * 0.1, push_duration=0.1)
    for impulse, duration in ((1e6 + 1.0, 0.1), (80.0, 1e-300), (1e308, 0.1)):
        with pytest.raises(InvalidValueError, match=r"push_duration must be at most 1e\+07 N"):
            PushDistribution(impulse_max=impulse, push_duration=duration)


@pytest.mark.parametrize(
    "values", [{"direction_min": -1e308}, {"direction_max": 1e308}, {"first_step": 10**30}]
)
def test_a_distribution_refuses_what_it_could_not_draw(values):
    with pytest.raises(InvalidValueError, match=rf"PushDistribution\.{next(iter(values))}"):
        PushDistribution(**values)


def test_a_noise_seed_stays_one_that_json_can_hold():
    assert Scenario.from_json(Scenario("a", noise_seed=2**128 - 1).to_json()).noise_seed == 2**128 - 1
    with pytest.raises(InvalidValueError, match=r"Scenario\.noise_seed must be an integer in"):
        Scenario("a", noise_seed=2**128)
