"""A drag against projections worked out by hand."""

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.play.session import (
    LARGEST,
    dragged_impulse,
    limited,
    metres_per_pixel,
    polar_impulse,
    push_now,
)


def camera(azimuth, elevation):
    """Axes right, down, view of a camera that looks towards an azimuth [deg], downwards by an elevation."""
    a, e = np.radians([azimuth, elevation])
    view = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return np.stack([right, np.cross(view, right), view], axis=1)


def test_to_the_right_of_the_screen_pushes_to_the_right_of_the_view():
    axes = camera(90.0, 20.0)  # looks along y
    np.testing.assert_allclose(axes[:, 1] @ [0, 0, 1.0], -np.cos(np.radians(20.0)))  # down points down
    np.testing.assert_allclose(dragged_impulse(0.5 * axes[:, 0], axes), [50.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(dragged_impulse(-0.5 * axes[:, 0], axes), [-50.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("elevation", [0.0, 15.0, 60.0, 89.9])
def test_upwards_pushes_away_from_the_camera_whatever_its_height(elevation):
    axes = camera(180.0, elevation)  # looks along -x
    np.testing.assert_allclose(dragged_impulse(-0.3 * axes[:, 1], axes), [-30.0, 0.0], atol=1e-9)


def test_from_straight_above_the_push_follows_the_pointer():
    axes = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # right -y, down -x
    np.testing.assert_allclose(dragged_impulse([0.2, -0.1, 0.0], axes), [20.0, -10.0], atol=1e-9)


def test_a_pixel_is_what_a_pinhole_camera_sees():
    """At depth D a picture with the field of view fov is 2 D tan(fov / 2) high."""
    assert 600 * metres_per_pixel(3.0, np.radians(90.0), 600) == pytest.approx(6.0)


def test_the_largest_impulse_keeps_its_direction():
    far = limited([-900.0, 1200.0])
    assert np.hypot(*far) == pytest.approx(LARGEST)
    np.testing.assert_allclose(far / LARGEST, [-0.6, 0.8])
    np.testing.assert_array_equal(limited([3.0, -4.0]), [3.0, -4.0])
    np.testing.assert_array_equal(limited([0.0, 0.0]), [0.0, 0.0])


def test_a_push_has_the_impulse_and_begins_now():
    push = push_now([30.0, -12.5], 1.23, "trunk")
    assert push.impulse == pytest.approx((30.0, -12.5, 0.0))
    assert (push.start, push.duration, push.body, push.frame) == (1.23, 0.1, "trunk", "world")


def test_a_polar_impulse_turns_counter_clockwise():
    np.testing.assert_allclose(polar_impulse(20.0, 90.0), [0.0, 20.0], atol=1e-12)
    with pytest.raises(InvalidValueError, match="400"):
        polar_impulse(401.0, 0.0)
