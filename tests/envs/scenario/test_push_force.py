"""What pushes deliver in a span of time, when their gait events come, and how they turn with the heading."""

import itertools
import math

import numpy as np
import pytest
from push_recovery.envs.scenario.arrays import mean_force, push_arrays, resolve_starts, turn_forces
from push_recovery.envs.scenario.push import PENDING, GaitEvent, Push, polar_push


def delivered(push: Push, edges: np.ndarray) -> np.ndarray:
    """Impulse summed over a partition of time."""
    arrays = push_arrays([push], "left")
    total, force = np.zeros(3), np.zeros(3)
    for t0, t1 in itertools.pairwise(edges):
        mean_force(arrays.force, arrays.duration, arrays.start, 0, t0, t1, force)
        total += force * (t1 - t0)
    return total


@pytest.mark.parametrize("rate", [10.0, 33.0, 50.0, 100.0, 240.0, 500.0, 997.0])
@pytest.mark.parametrize(("start", "duration"), [(2.6, 0.1), (0.0, 0.05), (1.23456, 0.0301), (3.0, 0.0004)])
def test_impulse_is_exact_at_every_rate(rate, start, duration):
    push = Push((123.0, -456.0, 7.0), duration, start)
    edges = np.arange(int(5 * rate) + 1) / rate
    np.testing.assert_allclose(delivered(push, edges), push.impulse, rtol=0, atol=1e-9)


def test_impulse_is_exact_on_random_partitions():
    rng = np.random.default_rng(0)
    push = Push((500.0, 300.0, -20.0), 0.1, 1.7)
    for _ in range(20):
        edges = np.concatenate([[0.0], np.sort(rng.uniform(0, 4, 300)), [4.0]])
        np.testing.assert_allclose(delivered(push, edges), push.impulse, rtol=0, atol=1e-9)


def test_no_force_outside_the_push():
    arrays = push_arrays([Push((10.0, 0.0, 0.0), 0.1, 1.0)], "left")
    out = np.ones(3)
    for t0, t1 in [(0.0, 1.0), (1.1, 1.2), (5.0, 6.0)]:
        assert not mean_force(arrays.force, arrays.duration, arrays.start, 0, t0, t1, out)
        assert not out.any()


def test_pending_push_has_no_force():
    arrays = push_arrays([Push((10.0, 0.0, 0.0), 0.1, GaitEvent(4, "left"))], "left")
    out = np.ones(3)
    assert arrays.start[0] == PENDING
    assert not mean_force(arrays.force, arrays.duration, arrays.start, 0, 0.0, 100.0, out)
    assert not out.any()


@pytest.mark.parametrize("tick", [0.01, 0.004, 0.1])
def test_event_resolves_to_its_moment(tick):
    push = Push((10.0, 0.0, 0.0), 0.1, GaitEvent(2, "left", 0.3))
    arrays = push_arrays([push], "left")
    duration = 0.65
    for k in range(int(4 * duration / tick)):
        t0 = k * tick
        index = int(t0 / duration + 1e-9)
        resolve_starts(
            arrays.start, arrays.step, arrays.fraction, index, index * duration, duration, t0, (k + 1) * tick
        )
    assert arrays.start[0] == pytest.approx(2.3 * duration, abs=1e-12)


def test_event_missed_by_an_early_touchdown_fires_at_once():
    arrays = push_arrays([Push((10.0, 0.0, 0.0), 0.1, GaitEvent(2, "left", 0.9))], "left")
    resolve_starts(arrays.start, arrays.step, arrays.fraction, 2, 1.0, 0.6, 1.4, 1.41)
    assert arrays.start[0] == PENDING
    resolve_starts(arrays.start, arrays.step, arrays.fraction, 3, 1.415, 0.6, 1.42, 1.43)
    assert arrays.start[0] == 1.42


@pytest.mark.parametrize(
    ("asked", "start"),
    [(0.6, 1.3), (0.4, 1.25), (0.8, 1.4)],  # as planned; cut so that the moment is over; made longer
)
def test_an_event_follows_the_duration_that_is_planned_in_mid_step(asked, start):
    """Step 2 began at 1 s with T = 0.6 s; at 1.25 s another T is asked for."""
    arrays = push_arrays([Push((10.0, 0.0, 0.0), 0.1, GaitEvent(2, "left", 0.5))], "left")
    for tick in range(100):
        t0 = 1.0 + 0.01 * tick
        duration = 0.6 if tick < 25 else asked
        resolve_starts(arrays.start, arrays.step, arrays.fraction, 2, 1.0, duration, t0, t0 + 0.01)
    assert arrays.start[0] == pytest.approx(start, abs=1e-12)


def test_a_force_turns_with_the_heading_once_when_its_push_starts():
    along, fixed = polar_push(10.0, 0.3, 0.1, 1.0, frame="heading"), polar_push(10.0, 0.3, 0.1, 1.0)
    late = Push((0.0, 10.0, -3.0), 0.1, GaitEvent(4, "left"), frame="heading")
    arrays = push_arrays([along, fixed, late], "left")
    before = arrays.force.copy()
    turn_forces(arrays.force, arrays.frame, arrays.start, 2.0, 1.0)  # none has started yet
    np.testing.assert_array_equal(arrays.force, before)
    for heading in (2.0, 2.5):  # the second time nothing is left to turn
        turn_forces(arrays.force, arrays.frame, arrays.start, heading, 1.002)
        np.testing.assert_allclose(arrays.force[0], [10 * math.cos(2.3), 10 * math.sin(2.3), 0.0], atol=1e-12)
    np.testing.assert_array_equal(arrays.force[1:], before[1:])
    arrays.start[2] = 3.0
    turn_forces(arrays.force, arrays.frame, arrays.start, math.pi / 2, 3.002)
    np.testing.assert_allclose(arrays.force[2], [-10.0, 0.0, -3.0], atol=1e-12)


def test_at_heading_0_the_frames_are_the_same():
    force = (123.4, -56.7, 8.9)
    arrays = push_arrays([Push(force, 0.1, 1.0, frame="heading")], "left")
    turn_forces(arrays.force, arrays.frame, arrays.start, 0.0, 1.002)
    assert tuple(arrays.force[0]) == force
