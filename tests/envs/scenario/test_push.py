import itertools
import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.envs.scenario.push import PENDING, GaitEvent, Push, polar_push
from push_recovery.envs.scenario.push_arrays import push_arrays
from push_recovery.envs.scenario.push_force import mean_force, resolve_starts, turn_forces


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


@pytest.mark.parametrize(
    ("step", "side", "first", "index"),
    [(4, "left", "left", 4), (4, "right", "left", 5), (4, "left", "right", 5)],
)
def test_event_falls_in_the_first_step_on_its_side(step, side, first, index):
    assert GaitEvent(step, side).step_index(first) == index


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


def test_a_mirrored_push_attacks_the_mirrored_point():
    mirror = Push((1.0, 2.0, 3.0), 0.1, 0.0, "trunk", (0.1, 0.2, 0.3)).mirrored()
    assert (mirror.force, mirror.offset, mirror.body) == ((1.0, -2.0, 3.0), (0.1, -0.2, 0.3), "trunk")
    np.testing.assert_allclose(
        np.cross(mirror.offset, mirror.force), np.cross((0.1, 0.2, 0.3), (1.0, 2.0, 3.0)) * [-1.0, 1.0, -1.0]
    )  # a moment is a pseudovector


def test_arrays_are_fresh_copies():
    pushes = [Push((10.0, 0.0, 0.0), 0.1, GaitEvent(2, "left"))]
    push_arrays(pushes, "left").start[:] = 1.0
    assert push_arrays(pushes, "left").start[0] == PENDING


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


@pytest.mark.parametrize("frame", ["world", "heading"])
def test_polar_push_and_mirror(frame):
    push = polar_push(100.0, math.radians(30), 0.2, GaitEvent(4, "left", 0.25), body="trunk", frame=frame)
    assert push.impulse_magnitude == pytest.approx(20.0, abs=1e-12)
    assert push.direction == pytest.approx(math.radians(30))
    mirror = push.mirrored()
    assert mirror.direction == pytest.approx(math.radians(-30))
    assert mirror.start == GaitEvent(4, "right", 0.25)
    assert mirror.frame == frame
    assert mirror.mirrored() == push
    assert math.copysign(1.0, Push((1.0, 0.0, 0.0), 0.1, 0.0).mirrored().force[1]) == 1.0


@pytest.mark.parametrize("frame", ["world", "heading"])
@pytest.mark.parametrize("start", [2.6, GaitEvent(4, "right", 0.5)])
def test_dict_round_trip(start, frame):
    push = Push((1.0, 2.0, 3.0), 0.1, start, "trunk", (0.1, 0.0, 0.2), frame)
    assert Push.from_dict(push.to_dict()) == push
    assert ("frame" in push.to_dict()) == (frame == "heading")


def test_accepts_arrays_and_stores_tuples():
    push = Push(np.array([1, 2, 3]), 1, 0)  # type: ignore[arg-type]
    assert push.force == (1.0, 2.0, 3.0)
    assert hash(push) == hash(Push((1.0, 2.0, 3.0), 1.0, 0.0))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"force": (1.0, math.nan, 0.0)}, ["force", "finite"]),
        ({"force": (1.0, 2.0)}, ["force", "3"]),
        ({"duration": 0.0}, ["duration", "0"]),
        ({"duration": -0.1}, ["duration", "-0.1"]),
        ({"start": -1.0}, ["start", "-1"]),
        ({"start": "soon"}, ["start", "soon"]),
        ({"body": "head"}, ["head", "pelvis", "trunk"]),
        ({"offset": (0.0, 0.0, math.inf)}, ["offset"]),
        ({"frame": "body"}, ["push frame", "body", "world, heading"]),
    ],
)
def test_bad_push_names_the_value(values, words):
    good = {"force": (1.0, 0.0, 0.0), "duration": 0.1, "start": 0.0}
    with pytest.raises(PushRecoveryError) as caught:
        Push(**{**good, **values})
    assert all(word in str(caught.value) for word in words)


def test_bad_event_names_the_value():
    with pytest.raises(UnknownNameError, match="left, right"):
        GaitEvent(4, "middle")  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match=r"fraction.*1\.5"):
        GaitEvent(4, "left", 1.5)
    with pytest.raises(InvalidValueError, match="step"):
        GaitEvent(-1, "left")
    with pytest.raises(UnknownNameError, match="when"):
        Push.from_dict({"force": [1, 0, 0], "duration": 0.1, "start": 0, "when": 1})
    with pytest.raises(InvalidValueError, match="duration"):
        Push.from_dict({"force": [1, 0, 0], "start": 0})


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_force_and_offset_have_bounds(axis, sign):
    def along(value):
        return tuple(sign * value if i == axis else 0.0 for i in range(3))

    Push(along(1e7), 3600.0, 0.0, offset=along(10.0))
    with pytest.raises(
        InvalidValueError, match=rf"Push\.force \[N\]\[{axis}\] must be in \[-1e\+07, 1e\+07\]"
    ):
        Push(along(1.001e7), 0.1, 0.0)
    with pytest.raises(InvalidValueError, match=rf"Push\.offset \[m\]\[{axis}\] must be in \[-10, 10\]"):
        Push(along(1.0), 0.1, 0.0, offset=along(10.1))


def test_duration_and_step_have_bounds():
    with pytest.raises(InvalidValueError, match=r"duration \[s\] must be in \(0, 3600\], got 3600\.5"):
        Push((1.0, 0.0, 0.0), 3600.5, 0.0)
    with pytest.raises(InvalidValueError, match=r"GaitEvent\.step must be an integer in \[0, 1000000000\]"):
        GaitEvent(10**30, "left")


@pytest.mark.parametrize(
    ("magnitude", "direction"),
    [(math.inf, 0.0), (1.1e7, 0.0), (1.0, math.inf), (1.0, math.nan), (1.0, "left")],
)
def test_a_polar_push_refuses_what_has_no_direction_or_size(magnitude, direction):
    with pytest.raises(InvalidValueError, match=r"push (magnitude|direction) \["):
        polar_push(magnitude, direction, 0.1, 1.0)
