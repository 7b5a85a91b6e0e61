"""Pushes of every kind, from points whose scenario is written out by hand."""

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from push_recovery.envs.scenario.push import GaitEvent
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.score.draw import FACTORS, Point, count_of, varied_scenario, varied_scenarios, walk_of

MIDDLE = Point(*[0.5] * FACTORS)


def scenario(**changes: float) -> Scenario:
    return varied_scenario("mine", MIDDLE._replace(**changes), 7)


def test_a_single_push_at_the_pelvis():
    """Half the range of everything; direction 0.625 of a turn from -pi is psi = pi / 4."""
    found = scenario(direction=0.625, sides=0 / 16, pushes=7 / 16, walk=3 / 16)
    (push,) = found.pushes
    duration = 0.1  # sqrt(0.02 x 0.5)
    force = 105.0 / duration  # the middle of 50 and 160 N s
    assert push.force == pytest.approx((force * math.sqrt(0.5), force * math.sqrt(0.5), 0.0), abs=1e-3)
    assert (push.duration, push.body, push.offset, push.frame) == (0.1, "pelvis", (0.0, 0.0, 0.0), "heading")
    assert push.start == GaitEvent(4, "right", 0.5)
    assert (found.id, found.noise_seed, found.stance_side, found.command) == ("mine", 7, "right", Command())
    assert (count_of(found), walk_of(found)) == ("single", "in place")


def test_the_least_and_the_most():
    least = scenario(
        impulse=0.0, duration=0.0, pushes=0.0, sides=0.0, offset_x=0.0, offset_y=0.0, offset_z=0.0
    )
    assert least.pushes[0].impulse_magnitude == pytest.approx(50.0, abs=1e-4)
    assert least.pushes[0].duration == 0.02
    assert least.pushes[0].offset == (-0.08, -0.10, -0.08)
    most = 1.0 - 1e-9
    hard = scenario(
        impulse=most, duration=most, pushes=0.0, sides=1 / 16, offset_x=most, offset_y=most, offset_z=most
    )
    assert hard.pushes[0].impulse_magnitude == pytest.approx(110.0, abs=1e-3)
    assert (hard.pushes[0].duration, hard.pushes[0].body) == (0.5, "trunk")
    assert hard.pushes[0].offset == (0.10, 0.16, 0.25)


def test_the_second_of_two_comes_up_to_four_steps_later_from_anywhere():
    """Step 0 stands on the right, so step 4 does; 0.875 x 4 = 3.5 is half-way through step 8."""
    found = scenario(pushes=8 / 16, sides=0.0, direction=0.5, second_direction=0.25, second_time=0.875)
    first, second = found.pushes
    assert (first.start, second.start) == (GaitEvent(4, "right", 0.5), GaitEvent(8, "right", 0.5))
    assert first.impulse == pytest.approx((0.75 * 105.0, 0.0, 0.0), abs=1e-3)
    assert second.impulse == pytest.approx((0.0, -0.75 * 105.0, 0.0), abs=1e-3)
    soon = scenario(pushes=8 / 16, sides=0.0, second_time=0.0).pushes[1]
    assert soon.start == GaitEvent(5, "left", 0.0)


def test_a_repeated_push_comes_four_times_on_the_same_stance():
    """Step 0 stands on the left, the push on the right: the first such step from 4 on is 5."""
    found = scenario(pushes=12 / 16, sides=2 / 16, direction=0.5)
    assert [push.start for push in found.pushes] == [
        GaitEvent(4, "right", 0.5),
        *(GaitEvent(index, "right", 0.5) for index in (7, 9, 11)),
    ]
    indices = [push.start.step_index("left") for push in found.pushes]
    assert indices == [5, 7, 9, 11]
    assert {push.impulse for push in found.pushes} == {found.pushes[0].impulse}
    assert found.pushes[0].impulse_magnitude == pytest.approx(0.55 * 105.0, abs=1e-3)
    assert count_of(found) == "repeated"


@pytest.mark.parametrize(
    ("level", "sides", "command", "name"),
    [
        (4, 0, Command(0.3), "forward"),
        (7, 8, Command(-0.15), "backward"),
        (8, 8, Command(0.0, 0.125), "sideways"),
        (9, 0, Command(0.0, -0.125), "sideways"),
        (10, 8, Command(0.3, 0.1), "sideways"),
        (11, 0, Command(-0.15, -0.1), "sideways"),
        (12, 8, Command(turn=0.15), "turning"),
        (13, 0, Command(0.3, turn=-0.15), "turning"),
        (15, 8, Command(-0.15, turn=0.15), "turning"),
    ],
)
def test_commands_by_level_and_side(level, sides, command, name):
    found = scenario(walk=level / 16, sides=sides / 16, turn=0.25)
    assert found.command == command
    assert walk_of(found) == name
    assert not any(math.copysign(1.0, value) < 0 and value == 0 for value in vars(found.command).values())


def test_every_kind_is_there_as_often_as_stated():
    scenarios = varied_scenarios("any", 1, 5)
    assert [s.id for s in scenarios[:2]] == ["any-0000", "any-0001"]
    assert len(scenarios) == 256
    assert Counter(map(count_of, scenarios)) == {"single": 128, "double": 64, "repeated": 64}
    walks = Counter(map(walk_of, scenarios))
    assert walks == {"in place": 64, "forward": 48, "backward": 16, "sideways": 64, "turning": 64}
    sides = Counter((s.pushes[0].body, s.stance_side, s.pushes[0].start.side) for s in scenarios)
    assert set(sides) == set(itertools.product(("pelvis", "trunk"), ("left", "right"), ("left", "right")))
    assert set(sides.values()) == {32}
    pairs = Counter((s.pushes[0].body, count_of(s), walk_of(s)) for s in scenarios)
    assert pairs["trunk", "single", "in place"] == pytest.approx(16, abs=8)
    for body, least, most in (("pelvis", 50, 160), ("trunk", 30, 110)):
        single = [s.pushes[0] for s in scenarios if s.pushes[0].body == body and count_of(s) == "single"]
        impulse = [push.impulse_magnitude for push in single]
        assert least <= min(impulse) < least + 10 < most - 10 < max(impulse) <= most
    logs = np.log([s.pushes[0].duration for s in scenarios])
    assert np.ptp(np.histogram(logs, bins=16, range=(math.log(0.02), math.log(0.5)))[0]) <= 2


def test_what_does_not_push_has_a_count_too():
    assert count_of(Scenario("quiet")) == "none"
