"""What is taken for an observation, and what is refused with a word of why."""

import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model import observation as columns

LEFT, RIGHT = 0, 1


def test_the_swing_side_of_the_left_foot_is_the_right():
    assert columns.side_sign(LEFT) == -1.0
    assert columns.side_sign(RIGHT) == 1.0
    np.testing.assert_array_equal(columns.side_sign(np.array([1, 0, 0, 1])), [1.0, -1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("heading", "stance", "world", "seen"),
    [
        (0.0, LEFT, (1.0, 2.0), (1.0, -2.0)),
        (0.0, RIGHT, (1.0, 2.0), (1.0, 2.0)),
        # heading to the world's left (+y): what lies ahead of it is +y, and to its left is -x
        (math.pi / 2, LEFT, (1.0, 2.0), (2.0, 1.0)),
        (math.pi / 2, RIGHT, (1.0, 2.0), (2.0, -1.0)),
        # 30 degrees, by the unit vectors (sqrt(3)/2, 1/2) ahead and (-1/2, sqrt(3)/2) to the left
        (math.pi / 6, RIGHT, (2.0, 0.0), (math.sqrt(3.0), -1.0)),
        (math.pi / 6, LEFT, (2.0, 0.0), (math.sqrt(3.0), 1.0)),
    ],
)
def test_vectors_by_hand(heading, stance, world, seen):
    frame = columns.canonical_frame(heading, stance)
    assert columns.canonical(frame, *world) == pytest.approx(seen, abs=1e-15)
    assert columns.in_world(frame, *seen) == pytest.approx(world, abs=1e-15)


def test_a_point_lies_off_the_sole_by_its_vector():
    # left foot at (10, 20), facing the world's +y: 0.5 ahead, 0.2 towards the swing foot, on its right (+x)
    frame = columns.canonical_frame(math.pi / 2, LEFT)
    assert columns.point_in_world(frame, 10.0, 20.0, 0.5, 0.2) == pytest.approx((10.2, 20.5), abs=1e-14)


def test_the_frame_of_the_heading_has_its_y_to_the_left():
    assert columns.heading_frame(0.0) == columns.Frame(1.0, 0.0, 1.0)
    assert columns.canonical(columns.heading_frame(math.pi / 2), -1.0, 0.0) == pytest.approx(
        (0.0, 1.0), abs=1e-15
    )


def test_feet_exchanged_and_world_mirrored_is_one_problem():
    random = np.random.default_rng(0)
    for heading, x, y in random.normal(size=(20, 3)):
        left, right = columns.canonical_frame(heading, LEFT), columns.canonical_frame(-heading, RIGHT)
        assert columns.canonical(left, x, y) == columns.canonical(right, x, -y)


COUNTS = list(range(columns.OBSERVATION_SIZE))
TOO_LARGE = [10**400, *COUNTS[1:]]  # no float holds it


@pytest.mark.parametrize(
    "observation",
    [
        COUNTS,
        tuple(COUNTS),
        np.array(COUNTS, dtype=np.int8),
        np.array(COUNTS, dtype=np.float32),
        np.array(COUNTS, dtype=">f8"),  # of the other byte order
        np.array(COUNTS, dtype=object),
        np.arange(2.0 * columns.OBSERVATION_SIZE)[::2] / 2.0,
    ],
)
def test_real_numbers_of_any_type_are_taken(observation):
    batch, single = columns.as_batch(observation)
    assert single
    assert (batch.shape, batch.dtype, batch.flags.c_contiguous) == ((1, 36), np.float64, True)
    assert batch[0].tolist() == COUNTS


def test_a_batch_of_doubles_is_not_copied():
    observations = np.zeros((3, columns.OBSERVATION_SIZE))
    batch, single = columns.as_batch(observations)
    assert not single
    assert np.shares_memory(batch, observations)


@pytest.mark.parametrize(
    ("observation", "message"),
    [
        (np.zeros(36, dtype=complex), "array of real numbers: it holds complex128"),
        ([0.5 + 1j] + [0.0] * 35, "array of real numbers: it holds complex128"),
        (np.array([1j] * 36, dtype=object), "array of real numbers: .*complex"),
        (TOO_LARGE, "integer that is larger than any float"),
        ([COUNTS, TOO_LARGE], "integer that is larger than any float"),
        (["1.0"] * 36, "array of real numbers: it holds <U3"),
        ([[0.0] * 36, [0.0] * 35], "array of numbers"),
        (np.zeros(36, dtype="datetime64[s]"), "array of real numbers: it holds datetime64"),
        (np.zeros((2, 35)), r"must have shape \(36,\) or \(n, 36\), got \(2, 35\)"),
        (0.0, "must have shape"),
    ],
)
def test_anything_else_is_refused(observation, message):
    with pytest.raises(InvalidValueError, match=f"^observation .*{message}"):
        columns.as_batch(observation)
