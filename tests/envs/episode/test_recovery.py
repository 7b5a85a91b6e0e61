"""The recovered criterion against touchdowns written by hand.

Judged at every touchdown from the third on: recovered where the last two steps began within 5 cm of the
nominal DCM, after the last event, and the mean velocity over them is within 0.15 m/s of the command.
"""

import math

import numpy as np
import pytest
from push_recovery.envs.episode.recovery import GaitMonitor, record_standing, record_touchdown
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

GOOD, BAD = 0.049, 0.051  # of the DCM at the start of a step against the nominal one [m]
SPAN = 0.5  # of a step [s]
NEVER = None


def recovered_after(touchdowns, event=0.0, command=(0.4, 0.0, 0.0), heading=0.0, k=1) -> list[float | None]:
    """When robot k of three recovered, as known after each touchdown (time, x, y, error)."""
    monitor, known = GaitMonitor(3), []
    for time, x, y, error in touchdowns:
        com = np.array([x, y])
        record_touchdown(monitor.state, k, error, com, heading, time, event, np.array(command))
        known.append(monitor.recovered_at(k))
    assert monitor.recovered_at(0) is monitor.recovered_at(2) is None
    return known


def walk(errors, speed=(0.4, 0.0)):
    """Touchdowns every SPAN of a robot at a constant speed [m/s], with these errors of the DCM."""
    return [(SPAN * i, speed[0] * SPAN * i, speed[1] * SPAN * i, error) for i, error in enumerate(errors)]


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ([GOOD] * 4, [NEVER, NEVER, 1.0, 1.0]),  # two steps have to be over
        ([0.0, 0.0, 0.0, 0.0], [NEVER, NEVER, 1.0, 1.0]),
        ([BAD] * 4, [NEVER] * 4),
        ([BAD, GOOD, GOOD, GOOD], [NEVER, NEVER, 1.0, 1.0]),  # a pair of steps counts, not what was before
        ([GOOD, BAD, GOOD, GOOD], [NEVER, NEVER, NEVER, 1.5]),
        ([GOOD, GOOD, BAD, GOOD, GOOD], [NEVER, NEVER, NEVER, NEVER, 2.0]),
        ([GOOD, GOOD, GOOD, BAD], [NEVER, NEVER, 1.0, NEVER]),  # taken back
        ([GOOD, GOOD, GOOD, BAD, GOOD, GOOD], [NEVER, NEVER, 1.0, NEVER, NEVER, 2.5]),  # and earned anew
    ],
)
def test_two_good_steps_in_a_row_are_recovered_until_a_bad_one(errors, expected):
    assert recovered_after(walk(errors)) == expected


@pytest.mark.parametrize(
    ("event", "expected"),
    [
        (0.0, [NEVER, NEVER, 1.0, 1.0, 1.0]),
        (0.5, [NEVER, NEVER, 1.0, 1.0, 1.0]),  # the earlier of the two steps begins as the push ends
        (0.501, [NEVER, NEVER, NEVER, 1.5, 1.5]),  # ended between touchdowns: one step later
        (0.999, [NEVER, NEVER, NEVER, 1.5, 1.5]),
        (1.001, [NEVER, NEVER, NEVER, NEVER, 2.0]),
        (1.9, [NEVER] * 5),
        (math.inf, [NEVER] * 5),  # still to come
    ],
)
def test_both_steps_begin_after_the_last_push_has_ended(event, expected):
    assert recovered_after(walk([GOOD] * 5), event) == expected


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("off", "recovers"), [(0.149, True), (0.151, False)])
def test_the_mean_speed_over_two_steps_is_near_the_command(axis, sign, off, recovers):
    speed = [0.3, -0.1]
    speed[axis] += sign * off
    found = recovered_after(walk([GOOD] * 3, speed), command=(0.3, -0.1, 0.0))
    assert found == [NEVER, NEVER, 1.0 if recovers else NEVER]


def test_speed_is_that_of_two_steps_together():
    """0.6 and 0.2 m/s make 0.4; either step alone is 0.2 off. Steps weigh by their time."""
    assert recovered_after([(0.0, 0, 0, 0), (0.5, 0.3, 0, 0), (1.0, 0.4, 0, 0)])[-1] == 1.0
    uneven = [(0.0, 0, 0, 0), (0.2, 0.2, 0, 0), (1.0, 0.4, 0, 0)]  # 1.0 m/s for 0.2 s, 0.25 m/s for 0.8 s
    assert recovered_after(uneven)[-1] == 1.0
    assert recovered_after(uneven, command=(0.56, 0.0, 0.0))[-1] is NEVER  # though the mean of both is 0.625


def test_speed_is_measured_along_the_heading():
    """To the left at 0.4 m/s, heading left: forward."""
    touchdowns = walk([GOOD] * 3, (0.0, 0.4))
    assert recovered_after(touchdowns, heading=math.pi / 2)[-1] == 1.0
    assert recovered_after(touchdowns, heading=-math.pi / 2)[-1] is NEVER
    assert recovered_after(touchdowns, heading=0.0)[-1] is NEVER
    assert recovered_after(touchdowns, heading=0.0, command=(0.0, 0.4, 0.0))[-1] == 1.0


def test_a_reset_forgets_the_touchdowns_of_its_robot_alone():
    monitor = GaitMonitor(2)
    for k in (0, 1):
        for time, x, y, error in walk([GOOD] * 3):
            record_touchdown(
                monitor.state, k, error, np.array([x, y]), 0.0, time, 0.0, np.array([0.4, 0.0, 0.0])
            )
    monitor.reset(0)
    assert (monitor.recovered_at(0), monitor.recovered_at(1)) == (None, 1.0)
    assert not any(field[0].any() for field in monitor.state[:-2])  # recovered_at and heading come last
    record_touchdown(monitor.state, 0, GOOD, np.zeros(2), 0.0, 0.5, 0.0, np.array([0.0, 0.0, 0.0]))
    assert monitor.recovered_at(0) is None


@pytest.mark.parametrize(("pushes", "end"), [((), 4.0), ((Push((9.0, 0.0, 0.0), 0.1, 1.0),), 5.1)])
def test_an_episode_lasts_four_seconds_after_the_last_push(pushes, end):
    scenario = Scenario("a", pushes)
    last = max((push.start + push.duration for push in pushes), default=0.0)
    assert scenario.end_time(last) == pytest.approx(end)


@pytest.mark.parametrize(
    ("error", "speed", "time", "expected"),
    [(0.049, 0.149, 1.0, 1.0), (0.051, 0.0, 1.0, NEVER), (0.0, 0.151, 1.0, NEVER), (0.0, 0.0, 0.99, NEVER)],
)
def test_a_robot_that_stands_has_recovered_near_rest_after_the_last_event(error, speed, time, expected):
    monitor = GaitMonitor(2)
    record_standing(monitor.state, 1, error, speed, time, 1.0)
    assert (monitor.recovered_at(0), monitor.recovered_at(1)) == (NEVER, expected)


def test_a_stander_has_recovered_since_the_first_good_moment_and_loses_it_to_a_bad_one():
    monitor, known = GaitMonitor(1), []
    for time, speed in ((1.0, 0.1), (1.01, 0.1), (1.02, 0.2), (1.03, 0.1)):
        record_standing(monitor.state, 0, 0.0, speed, time, 1.0)
        known.append(monitor.recovered_at(0))
    assert known == [1.0, 1.0, NEVER, 1.03]
