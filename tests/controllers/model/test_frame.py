import math

import numpy as np
import pytest
from push_recovery.controllers.model.observation import (
    Frame,
    canonical,
    canonical_frame,
    heading_frame,
    in_world,
    point_in_world,
    side_sign,
)

LEFT, RIGHT = 0, 1


def test_the_swing_side_of_the_left_foot_is_the_right():
    assert side_sign(LEFT) == -1.0
    assert side_sign(RIGHT) == 1.0
    np.testing.assert_array_equal(side_sign(np.array([1, 0, 0, 1])), [1.0, -1.0, -1.0, 1.0])


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
    frame = canonical_frame(heading, stance)
    assert canonical(frame, *world) == pytest.approx(seen, abs=1e-15)
    assert in_world(frame, *seen) == pytest.approx(world, abs=1e-15)


def test_a_point_lies_off_the_sole_by_its_vector():
    # left foot at (10, 20), facing the world's +y: 0.5 ahead, 0.2 towards the swing foot, on its right (+x)
    frame = canonical_frame(math.pi / 2, LEFT)
    assert point_in_world(frame, 10.0, 20.0, 0.5, 0.2) == pytest.approx((10.2, 20.5), abs=1e-14)


def test_the_frame_of_the_heading_has_its_y_to_the_left():
    assert heading_frame(0.0) == Frame(1.0, 0.0, 1.0)
    assert canonical(heading_frame(math.pi / 2), -1.0, 0.0) == pytest.approx((0.0, 1.0), abs=1e-15)


def test_feet_exchanged_and_world_mirrored_is_one_problem():
    random = np.random.default_rng(0)
    for heading, x, y in random.normal(size=(20, 3)):
        left, right = canonical_frame(heading, LEFT), canonical_frame(-heading, RIGHT)
        assert canonical(left, x, y) == canonical(right, x, -y)
